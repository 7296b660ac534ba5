"""Part of the panel of step 1: describe a vehicle that has no file yet."""

from __future__ import annotations

from nicegui import ui

from hydro.app import own_vehicle
from hydro.app.bench import Bench
from hydro.app.buttons import button
from hydro.core.errors import HydroError
from hydro.core.guessing.vehicle_choice import hull_of

OWN = "own positions"
"""Choice of thrusters that are given one by one."""
NAME = "my-vehicle.toml"
"""Name of the file that the page offers."""
FIELDS = ("dry mass [kg]", "length [m]", "width [m]", "height [m]", "maximum thrust [N]")
"""Labels of the form's fields."""


def show(bench: Bench) -> None:
    """Put the form on the page that describes a vehicle without a file.

    Args:
        bench: State and actions of the tab.
    """
    count = bench.commands
    hull = own_vehicle.usual_hull(count)
    values = hull.text.split() if hull is not None else []
    ui.html(
        "<p>Mass and size give estimates of inertia, added mass and drag. "
        "Leave the thrust empty for T200 thrusters.</p>",
        sanitize=False,
    )
    with ui.element("div").classes("fields"):
        fields = [
            ui.input(label, value=values[number] if number < len(values) else "").props(
                "dense outlined inputmode=decimal"
            )
            for number, label in enumerate(FIELDS)
        ]
    layouts = [*own_vehicle.layouts_with(count), OWN]
    layout = ui.select(layouts, value=layouts[-2], label="thrusters").props("dense outlined options-dense")
    with ui.element("div").bind_visibility_from(layout, "value", value=OWN):
        ui.html(
            "<p>A line for each thruster, in the order of the commands: x, y, z [m] and its direction "
            "(x forward, y right, z down), then its maximum thrust [N].</p>",
            sanitize=False,
        )
        lines = (
            ui.textarea(placeholder="-0.5,0,0,1,0,0,40").props("dense outlined autogrow").classes("w-full")
        )
    with ui.element("div").classes("row"):
        name = ui.input(value=NAME).props("dense outlined")

        def write() -> None:
            texts = [one.strip() for one in str(lines.value or "").splitlines() if one.strip()]
            try:
                given = hull_of(" ".join(str(one.value).strip().replace(",", ".") for one in fields))
                path = bench.destination(str(name.value), ".toml")
                own = layout.value == OWN
                written = own_vehicle.write_estimated(
                    path, given, "none" if own else str(layout.value), texts if own else ()
                )
            except HydroError as error:
                bench.say(str(error))
                return
            bench.choose_vehicle(written)
            bench.folds["own"] = False
            bench.forget_problem()
            bench.refresh()

        button(bench, "Write the vehicle file", write)
