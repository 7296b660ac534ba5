"""Write docs/theory.md from the catalogue of effects; `make docs` runs it and a test compares."""

from __future__ import annotations

import inspect
from pathlib import Path
from types import ModuleType

from hydro.core.effects import Effect, Parameter, describe
from hydro.core.effects.catalogue import FAMILIES

PAGE = Path(__file__).with_name("theory.md")
TEMPLATE = Path(__file__).parent / "templates" / "theory.md.in"
"""Conventions and references; the sections of the families replace `{{effects}}`."""


def page() -> str:
    """Return the whole page: conventions, balance, one section per family and one entry per effect."""
    contents = "\n".join(
        f"- [{_title(family)}](#{_title(family).lower().replace(' ', '-')}): "
        + ", ".join(f"[`{effect.name}`](#{effect.name})" for effect in family.EFFECTS)
        for family in FAMILIES
    )
    sections = [_section(family) for family in FAMILIES]
    return TEMPLATE.read_text().replace("{{effects}}", "\n".join([contents, "", *sections]))


def _section(family: ModuleType) -> str:
    """Return the section of a family of effects."""
    entries = "\n".join(_entry(effect) for effect in family.EFFECTS)
    return f"## {_title(family)}\n\n{_paragraphs(inspect.getdoc(family) or '')}\n\n{entries}"


def _entry(effect: Effect) -> str:
    """Return the entry of an effect: description, equation, parameters, and similar effects."""
    rows = "\n".join(_row(effect, parameter) for parameter in effect.parameters)
    alike = ", ".join(f"[`{name}`](#{name})" for name in effect.lookalikes)
    plausible = "; ".join(dict.fromkeys(one.plausible.source for one in effect.parameters if one.plausible))
    return f"""### `{effect.name}`

    {effect.definition}

{_paragraphs(effect.description)}

| parameter | unit | numbers | bounds | plausible | if left out | meaning |
|---|---|---|---|---|---|---|
{rows}

- *Kind*: {effect.kind}
- *Needs*: {effect.excitation}
- *Easily taken for*: {alike}
- *Plausible by*: {plausible}
- *Source*: {effect.source}
"""


def _row(effect: Effect, parameter: Parameter) -> str:
    """Return the table row of a parameter."""
    cells = (
        f"`{parameter.name}`",
        describe.unit(parameter),
        describe.size(parameter),
        describe.bounds(parameter),
        describe.plausible(parameter),
        describe.when_left_out(effect, parameter),
        parameter.meaning,
    )
    return f"| {' | '.join(cells)} |"


def _title(family: ModuleType) -> str:
    """Return the heading of a family: the capitalised name of its file."""
    return family.__name__.rpartition(".")[2].capitalize()


def _paragraphs(text: str) -> str:
    """Return the paragraphs of a docstring, each on one line; indented parts stay equations."""
    parts = [part if part.startswith("    ") else " ".join(part.split()) for part in text.split("\n\n")]
    return "\n\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
