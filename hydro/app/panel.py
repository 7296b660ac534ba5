"""Beginning and end that the panels of the workbench share."""

from __future__ import annotations

from html import escape

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.frame import STEPS
from hydro.app.live import Live


def begun(bench: Bench, title: str) -> Live | None:
    """Show the title of a panel on the page, and return the open recording.

    Without a recording, the panel shows a sentence that none is open.

    Args:
        bench: State and actions of the tab.
        title: Title of the panel.

    Returns:
        The recording; None if none is open.
    """
    ui.html(f"<h2>{escape(title)}</h2>", sanitize=False)
    live = bench.session.live
    if live is None:
        ui.html("<p>Open a recording first.</p>", sanitize=False)
    return live


def onward(bench: Bench, step: int) -> None:
    """Put a button on the page that shows a later step of the workbench.

    Args:
        bench: State and actions of the tab.
        step: Number of the step, 2 to 5.
    """
    button(bench, f"Next: {step} {STEPS[step - 1]}", lambda: bench.show_step(step)).classes("next")
