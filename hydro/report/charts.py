"""Collection of the interactive figures of a page."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

AS_TEXT = {"<": "\\u003c", ">": "\\u003e", "&": "\\u0026"}
"""Escapes of characters that could end a script element."""


@dataclass
class Charts:
    """Collection of the figures of a page, by place: one figure, or one for each choice of a selector.

    Attributes:
        held: Figures as JSON text, a list for each place by its name.
    """

    held: dict[str, list[str]] = field(default_factory=dict)

    def add(self, name: str, *drawn: Figure) -> str:
        """Store the figures of one place on the page, one per choice of a selector; return `name`."""
        self.held[name] = [one.to_json() for one in drawn]
        return name

    def json(self) -> str:
        """Return all figures as JSON text that is safe in a script element of the page."""
        whole = ",".join(f'"{name}":[{",".join(drawn)}]' for name, drawn in self.held.items())
        for sign, text in AS_TEXT.items():
            whole = whole.replace(sign, text)
        return f"{{{whole}}}"
