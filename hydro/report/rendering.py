"""HTML pages from Jinja templates of this package, with plotly.js inside."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib import resources
from typing import Any

from hydro.report.charts import Charts


def rendered(
    template: str, charts: Charts, filters: tuple[Callable[..., Any], ...] = (), **context: Any
) -> str:
    """Return a page as HTML text that loads no other file.

    Args:
        template: File name of the template; it may include others.
        charts: Figures of the page.
        filters: Functions that the template uses as filters, by their names.
        context: Other values of the template.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined
    from markupsafe import Markup
    from plotly.offline import get_plotlyjs

    environment = Environment(
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        loader=FunctionLoader(_text),
    )
    environment.filters |= {shown.__name__: shown for shown in filters}
    return environment.get_template(template).render(
        context,
        charts=Markup(charts.json()),
        plotly=Markup(get_plotlyjs().replace("</script", "<\\/script")),
    )


@cache
def _text(name: str) -> str:
    """Return the text of a template."""
    return resources.files("hydro.report").joinpath(name).read_text(encoding="utf-8")
