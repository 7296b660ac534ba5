"""Observability of the motion in a recording with missing sensors, axis by axis.

Fisher information gives the standard deviation of each component of a shot's initial state, given the
samples, the commands and the model.  A velocity without samples may be well known from changes of position or
attitude. A velocity that affects no sample is not observable, and neither are forces that act on it alone.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import polars as pl

from hydro.core.columns import POSE, POSE_UNITS, VELOCITY, VELOCITY_UNITS, Array, Mask
from hydro.core.effects.wording import AXES as WORDS
from hydro.core.effects.wording import group
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.tracking import shot_seconds, tracked
from hydro.core.recording.arrays import Recording, recording
from hydro.core.recording.shots import make_shots
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import UNIT_WRENCH

MOST_SHOTS = 60  # maximum number of shots, enough for a median
NOT_SHOWN = np.repeat([1.0, 0.5, 1.0, 0.5], 3)
"""Standard deviation above which a component is not observable [m, rad, m/s, rad/s]."""
SENSORS = ("position", "attitude", "velocity", "rates of turn")
AXES = (
    ("north", "east", "depth"),
    ("roll", "pitch", "heading"),
    ("surge", "sway", "heave"),
    ("roll rate", "pitch rate", "yaw rate"),
)


def not_shown(vehicle: Vehicle, raw: pl.DataFrame) -> tuple[str, ...]:
    """Return one line for each missing sensor: what the recording cannot show, and how exact the rest is.

    A last line names thrusters that the sensors show on one axis only.  Empty if no sensor is missing.

    Args:
        vehicle: The vehicle.
        raw: Raw table.

    Raises:
        DataError: The recording does not fit the vehicle, or is shorter than a shot.
    """
    return of_recording(vehicle, recording(vehicle, raw))


def of_recording(vehicle: Vehicle, record: Recording) -> tuple[str, ...]:
    """Return one line for each missing sensor: what the recording cannot show, and how exact the rest is.

    A last line names thrusters that the sensors show on one axis only.  Empty if no sensor is missing.

    Args:
        vehicle: The vehicle.
        record: The recording as arrays.
    """
    if record.seen is None or record.seen.any(axis=0).all():
        return ()
    never, known = np.logical_not(record.seen.any(axis=0)), _known(vehicle, record)
    lines = []
    for block, (sensor, axes) in enumerate(zip(SENSORS, AXES, strict=True)):
        places = [3 * block + i for i in range(3) if never[3 * block + i]]
        if places:
            names = [axes[place % 3] for place in places]
            lines.append(_line(sensor, places, names, known))
    return (*lines, *_on_one_axis(vehicle, never))


def _on_one_axis(vehicle: Vehicle, never: Mask) -> Iterator[str]:
    """Yield a line on the thrusters of which the sensors show a single axis, although they push on others.

    On a single axis, a weak thruster looks like more inertia and damping.

    Args:
        vehicle: The vehicle.
        never: Which channels of pose and velocity have no sample, (12,).
    """
    shown = ~(never[:6] & never[6:])
    acts = ~np.isclose(candidate(vehicle).thrusters[:, UNIT_WRENCH], 0.0)
    single = (acts[:, shown].sum(axis=1) == 1) & acts[:, ~shown].any(axis=1)
    words = [
        f"{group(there + 1)} {'show' if len(there) > 1 else 'shows'} in {WORDS[axis]} alone"
        for axis in np.flatnonzero(shown)
        if len(there := np.flatnonzero(single & acts[:, axis]))
    ]
    if words:
        yield f"{', '.join(words)}: a weak thruster then looks like more inertia and damping"


def _line(sensor: str, places: list[int], names: list[str], known: Array) -> str:
    """Describe the accuracy of the components of a missing sensor.

    Args:
        sensor: Name of the sensor.
        places: Channels of the sensor, 0 to 11.
        names: Names of these channels.
        known: Standard deviation of every channel, (12,).
    """
    columns, units = (*POSE, *VELOCITY), (*POSE_UNITS, *VELOCITY_UNITS)
    pairs = list(zip(places, names, strict=True))
    dark = [name for place, name in pairs if not known[place] < NOT_SHOWN[place]]
    light = [
        f"{name} ± {known[place]:.2g} {units[place]}"
        for place, name in pairs
        if known[place] < NOT_SHOWN[place]
    ]
    parts = [f"nothing shows {', '.join(dark)}, nor what acts there alone"] if dark else []
    parts += [f"the other sensors and the model give {', '.join(light)}"] if light else []
    return f"no {sensor} ({', '.join(columns[place] for place in places)}): {'; '.join(parts)}"


def _known(vehicle: Vehicle, record: Recording) -> Array:
    """Return the standard deviation of the initial states of shots, (12,).

    It is the median over the shots for a true model, or the uncertainty of filled channels if that is larger,
    since it includes the model error.
    """
    filled = tracked(vehicle, record)
    shots = make_shots(filled, seconds=shot_seconds(record), most=MOST_SHOTS)
    prepared = multiple_shooting.prepare(candidate(vehicle), shots)
    known = sensitivity.beginnings(prepared, shots)
    return known if filled.doubt is None else np.maximum(known, filled.doubt)
