"""Beginning and end that the panels of the workbench share."""

from __future__ import annotations

from html import escape

from nicegui import ui

from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.app.frame import STEPS
from hydro.app.live import Live


def begun(bench: Bench, title: str) -> Live | None:
    """Show the title of a panel, and return the open recording.

    Args:
        bench: The workbench.
        title: Title of the panel.

    Returns:
        The recording; None if none is open, which the panel then says.
    """
    ui.html(f"<h2>{escape(title)}</h2>", sanitize=False)
    live = bench.session.live
    if live is None:
        ui.html("<p>Open a recording first.</p>", sanitize=False)
    return live


def onward(bench: Bench, step: int) -> None:
    """Make a button that shows a later step.

    Args:
        bench: The workbench.
        step: Number of the step, 2 to 5.
    """
    button(bench, f"Next: {step} {STEPS[step - 1]}", lambda: bench.show_step(step)).classes("next")
