"""Frame of the page: top bar, and the places of panel, track, error ladder and curves.

The frame appears at once.  The libraries of the physics take a second to load; `Layout` then fills the
places.
"""

from __future__ import annotations

from nicegui import ui

STEPS = ("Load", "Compare", "Learn", "Add and tune", "Keep")
"""Title of each step."""
PRIMARY = "#1769aa"
"""Colour of buttons and of predicted curves."""
LOADING = "loading the physics …"
MAIN = """
<div class="upper">
  <div class="trackbox">
    <canvas id="track" tabindex="0" aria-label="track of the vehicle"></canvas>
    <div class="playback">
      <button id="play" title="play or pause (space)">▶</button>
      <input id="seek" type="range" min="0" max="1" step="0.05" value="0" aria-label="time">
      <select id="speed" aria-label="speed">
        <option value="0.5">0.5 x</option><option value="1" selected>1 x</option>
        <option value="4">4 x</option><option value="16">16 x</option>
      </select>
      <span id="clock"></span>
    </div>
  </div>
  <div class="ladder" id="ladder"></div>
</div>
<div class="legend"><span><i style="color:#39424e"></i>measured</span>
    <span><i style="color:#1769aa"></i>predicted</span><span><i class="band"></i>noise floor</span>
    <span>drag to zoom, double-click for all; space plays, arrows step</span></div>
<div class="plotbox">
  <div id="curves"></div>
  <canvas id="overlay"></canvas>
  <div class="cursor" id="cursor0"></div>
  <div class="cursor" id="cursor1"></div>
  <div class="cursor" id="cursor2"></div>
</div>
"""


class Frame:
    """Frame of the page of the workbench: the places of its parts, with the steps shown but not yet usable.

    Attributes:
        steps: Place of the steps.
        title: Label for the vehicle and the recording.
        busy: Place of the progress of work.
        error: Place of the error of the shown vehicle.
        history: Place of the buttons for undo and redo.
        panel: Place of the panel of the present step.
    """

    def __init__(self) -> None:
        """Make the elements."""
        ui.colors(primary=PRIMARY)
        with ui.element("div").classes("bench"):
            with ui.element("header").classes("top"):
                ui.label("hydro").classes("brand")
                with ui.element("div") as self.steps, ui.element("nav").classes("steps"):
                    for number, title in enumerate(STEPS, 1):
                        ui.button(f"{number} {title}", color=None).props("flat dense no-caps disable")
                self.title = ui.label().classes("what")
                with ui.element("div") as self.busy:
                    ui.label(LOADING).classes("busy")
                self.error = ui.html("", sanitize=False).classes("error")
                self.history = ui.element("div").classes("history")
            with ui.element("aside").classes("panel") as self.panel:
                ui.label(LOADING).classes("hint")
            ui.html(MAIN, sanitize=False).classes("main")
