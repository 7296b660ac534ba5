"""Panel of step 5: save the vehicle, the study and its report, and show the commands that do the same."""

from __future__ import annotations

from functools import partial
from html import escape

from nicegui import ui

from hydro.app import shown_commands
from hydro.app.bench import MODIFIED, Bench
from hydro.app.buttons import button
from hydro.app.panel import begun
from hydro.core.errors import HydroError


def show(bench: Bench) -> None:
    """Put the panel of step 5 on the page: save the vehicle, the study and its report.

    The panel also shows the commands that do the same as the session.

    Args:
        bench: State and actions of the tab.
    """
    session = bench.session
    if begun(bench, "Keep the result") is None:
        return
    folder = bench.desk.places.folders[0]
    ui.html(f"<p>Files are saved in {escape(str(folder))}.</p>", sanitize=False)
    ui.html("<h3>Vehicle file, with its covariance</h3>", sanitize=False)
    with ui.element("div").classes("row"):
        name = ui.input(value=MODIFIED).props("dense outlined")

        def save() -> None:
            try:
                done(bench.save_vehicle(str(name.value)))
            except HydroError as error:
                bench.say(str(error))

        button(bench, "Save", save, look="first", key="save vehicle")
    ui.html("<h3>Study folder, as hydro explain writes it, and its report</h3>", sanitize=False)
    with ui.element("div").classes("row"):
        study = ui.input(value="study").props("dense outlined")

        async def save_study(report: bool) -> None:
            try:
                done(await bench.save_study(str(study.value), report))
            except HydroError as error:
                bench.say(str(error))

        save_alone, save_both = partial(save_study, False), partial(save_study, True)
        button(bench, "Save", save_alone, look="first", key="save study").set_enabled(session.diagnosed)
        button(bench, "Save with report", save_both).set_enabled(session.diagnosed)
    if not session.diagnosed:
        ui.html("<p>A study begins with a diagnosis.</p>", sanitize=False)
    if bench.saved:
        lines = "".join(f"<div class='said'>saved {escape(one)}</div>" for one in bench.saved)
        ui.html(lines, sanitize=False)
    ui.html("<h3>Commands that do the same</h3>", sanitize=False)
    ui.html(f"<pre class='commands'>{escape(shown_commands.shell(session))}</pre>", sanitize=False)
    ui.html("<h3>The same in Python</h3>", sanitize=False)
    ui.html(f"<pre class='commands'>{escape(shown_commands.python(session))}</pre>", sanitize=False)

    def done(path: str) -> None:
        """List what was written."""
        if path:
            bench.saved = [path, *bench.saved][:6]
            bench.refresh()
