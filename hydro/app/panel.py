"""First lines that the panels of the workbench share."""

from __future__ import annotations

from html import escape

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.live import Live


def begun(bench: Bench, title: str) -> Live | None:
    """Show the title of a panel, and return the open recording; if none is open, say so and return None.

    Args:
        bench: The workbench.
        title: Title of the panel.
    """
    ui.html(f"<h2>{escape(title)}</h2>", sanitize=False)
    live = bench.session.live
    if live is None:
        ui.html("<p>Open a recording first.</p>", sanitize=False)
    return live
