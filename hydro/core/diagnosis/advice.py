"""What to do about a finding, in a sentence or two."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from hydro.core.diagnosis.manoeuvres import FLIGHT_LENGTH, Flight
from hydro.core.effects import CATALOGUE

ONE_SAMPLE = 1.05  # samples below which a delay is taken for a convention of the log
QUICKER, HALF = 1.5, 0.75  # samples up to which a lag that is less is taken for the same, or for half of it
PLAIN = 0.05  # of a whole power, within which a curve is taken for the other that a file can name
CLEAR = 10.0
"""Standard deviations of the noise by which a manoeuvre must part two effects to be flown once."""

MANOEUVRES: tuple[tuple[frozenset[str], str], ...] = (
    (
        frozenset({"ocean_current", "tether", "sensor_bias"}),
        "hold one thrust and turn slowly through all headings: a current stays in the north and east, a "
        "tether pulls toward its anchor, a bias turns with the vehicle",
    ),
    (
        frozenset({"thruster_lag", "command_delay", "sensor_delay", "added_mass", "fluid_memory"}),
        "a chirp on surge, sway and yaw from 0.05 to 2 Hz: lag, delay and added mass part in how they grow "
        "with frequency",
    ),
    (
        frozenset(
            {
                "added_mass_coriolis",
                "body_lift",
                "added_mass_coupling",
                "coupled_damping",
                "crossflow_drag",
                "cross_axis_drag",
                "sensor_lever_arm",
            }
        ),
        "straight runs at several drift angles, at half and at full speed, then turns on the spot",
    ),
    (
        frozenset({"net_buoyancy", "buoyancy_offset", "payload", "surface_suction"}),
        "hold still at tilts of 10 to 20 degrees in roll and pitch, both ways, at two depths",
    ),
    (
        frozenset({"sensor_scale", "sensor_misalignment", "sensor_bias", "sensor_delay", "ocean_current"}),
        "straight runs ahead and sideways, there and back, over distances known from the pose",
    ),
    (
        frozenset(
            {
                "thruster_gain",
                "thruster_asymmetry",
                "thruster_deadband",
                "thruster_curve",
                "thruster_inflow",
                "linear_damping",
                "quadratic_damping",
            }
        ),
        "a powered step from rest to full speed with the thrusters in turn, then coast down without thrust",
    ),
)
"""Effects that are taken for one another, and the motion that parts them."""


def separating(members: Sequence[str], flight: Flight | None = None) -> str:
    """The manoeuvre that tells the members of a tie set apart.

    Args:
        members: Names of the effects.
        flight: What `manoeuvres.best` predicts for them; without, what is known of such effects in general.
    """
    if flight is not None and flight.difference > 0.0:
        return f"to tell them apart: {_predicted(flight)}"
    count, words = max((len(group & set(members)), words) for group, words in MANOEUVRES)
    if count >= 2:
        return f"to tell them apart: {words}"
    needs = "; ".join(f"for {name}, {CATALOGUE[name].excitation}" for name in members)
    return f"to tell them apart: {needs}"


def _predicted(flight: Flight) -> str:
    """What to fly for how long, and what it is expected to show."""
    words, seen = flight.manoeuvre.words, flight.difference
    expected = (
        f"predicted difference in {FLIGHT_LENGTH:g} s: {float(f'{seen:.2g}'):g} times the sensors' noise"
    )
    if seen >= CLEAR:
        return f"{words} ({expected})"
    minutes = FLIGHT_LENGTH / 60.0 * (CLEAR / seen) ** 2
    return (
        f"{words}, for {minutes:.0f} min or more ({expected})"
        if minutes < 120.0
        else f"{words} ({expected}, too little)"
    )


def adding(effect: str, parameters: Mapping[str, Any], dt: float) -> str:
    """What adding a missing effect means; a delay of a sample is none of the vehicle's."""
    if effect in ("command_delay", "sensor_delay") and abs(float(parameters["d"])) <= ONE_SAMPLE * dt:
        return (
            "no more than one sample: most likely a convention of the log (whether a command is logged "
            "before or after it acts), not the vehicle; settle it in the log before believing lag or delay"
        )
    if effect == "thruster_lag" and -HALF * dt <= float(parameters["dT"]) < 0.0:
        return (
            "thrusters quicker by a part of a sample: most likely the source of the log holds forces over a "
            "row, or integrates by Euler's rule at the log's rate; nothing of the vehicle, nothing to shift"
        )
    if effect == "thruster_lag" and -QUICKER * dt <= float(parameters["dT"]) < 0.0:
        return (
            "thrusters quicker by about one sample: most likely the log writes a command one row after it "
            "acts; shift the command columns up by one row and diagnose again"
        )
    if effect == "thruster_curve" and abs(abs(float(parameters["da"])) - 1.0) < PLAIN:
        curve = "quadratic" if float(parameters["da"]) > 0.0 else "linear"
        return (
            f'the thrust curve is {curve}: set `curve = "{curve}"` in every [[thruster]] of the file, and '
            "diagnose again; `hydro add` does it as well"
        )
    return f"add it with `hydro add`; {CATALOGUE[effect].definition}"


def retuning(effect: str) -> str:
    """What to do with an effect of the file that has other values."""
    return f"the recording asks for other values of {effect}; `hydro add` replaces them"


def exciting(effect: str, entries: Sequence[str], flight: Flight | None = None) -> str:
    """Which motion would show an effect that the recording does not.

    Args:
        effect: Its name.
        entries: What of it is not determined, in words; all of it where nothing is said.
        flight: What `manoeuvres.showing` predicts for it at plain size.
    """
    what = ", ".join(entries) or "it"
    shows = flight is not None and flight.difference >= CLEAR
    motion = _predicted(flight) if flight is not None and shows else CATALOGUE[effect].excitation
    return f"this recording could not show {what}; fly {motion}"
