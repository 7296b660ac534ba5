"""Hidden effects of each study: drawn from its kind and seed alone, not from the order of the work."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from benchmarks.hidden_effects import vehicles
from benchmarks.recovery import TRUTHS
from hydro.core.effects import CATALOGUE, validate
from hydro.core.effects.record import Role
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle

KINDS = ("one", "two", "three", "unknown", "form", "none", "later")
WEAKEST, STRONGEST = 0.15, 4.0
"""Bounds of the factor on an effect's usual size, drawn log-uniformly."""
NEWEST = (
    "current_shear",
    "current_trend",
    "drifting_ballast",
    "power_drag",
    "offset_drag",
    "control_surface",
    "propeller_torque",
    "reference_point",
)
LATER = ("thruster_curve", *NEWEST)
"""Effects newer than published figures; only the kind `later` has them, so that seeds keep their cases."""
BY_LAW = tuple(
    name for name in TRUTHS if not (CATALOGUE[name].is_random or Role.WHOLE_HULL in CATALOGUE[name].roles)
)
"""Effects that a flight here can hide, and that a diagnosis of a file with drag can name.

Random effects are drawn by the plant, not by a case.
"""
HIDDEN = tuple(name for name in BY_LAW if name not in LATER)
FIXED = {
    "tether": ("slack", "attachment", "anchor"),
    "surface_suction": ("decay",),
    "fluid_memory": ("rates",),
    "payload": ("x", "y", "z"),
    "current_shear": ("z_0",),
    "current_trend": ("t_0",),
    "drifting_ballast": ("tilt", "T"),
    "power_drag": ("n",),
    "offset_drag": ("position",),
    "control_surface": ("position", "roll", "deflection", "stall"),
}
"""Parameters for the place or the rate of an effect, not for its strength."""
ALSO = {"current that grows with depth": ("current_shear",)}
"""Additional names of a form that the catalogue now has."""
SIZES = (
    "cubic",
    "power",
    "wash",
    "wash_pitch",
    "tide",
    "tide_east",
    "slosh_mass",
    "wall",
    "hysteresis",
    "swell",
)
"""Parameters for the strength of effects that the catalogue lacks, see `plant.FOREIGN`."""
WITHIN = {
    "added_mass_coriolis": 0.9,
    "buoyancy_offset": 0.02,
    "ocean_current": 0.8,
    "current_shear": 0.2,
    "current_trend": 0.01,
    "thruster_gain": 0.9,
    "thruster_asymmetry": 0.8,
    "thruster_lag": 0.4,
    "command_delay": 0.4,
    "thruster_deadband": 0.3,
    "thruster_inflow": 0.4,
    "propeller_torque": 0.1,
    "sensor_scale": 0.2,
    "sensor_misalignment": 0.2,
    "sensor_delay": 0.4,
    "sensor_lever_arm": 1.0,
    "reference_point": 1.0,
    "sensor_bias": 0.2,
}
"""Greatest magnitude of the parameters of some effects on a vehicle that can still be used."""
CONTAINED = ({"payload", "net_buoyancy"}, {"payload", "buoyancy_offset"}, {"payload", "added_mass"})
"""Pairs of effects of which one can imitate the other: they are never hidden together."""
SOURCES = {"independent": 0.6, "simulate": 0.4}
"""Probability of each simulator."""
NOISES = (1.0, 2.0, 3.0)
ATTEMPTS = 200


@dataclass(frozen=True)
class Case:
    """Truth of one study.

    Attributes:
        kind: One of KINDS.
        seed: Seed of everything random.
        preset: Vehicle.
        source: Simulator.
        noise: Noise of the sensors, in multiples of the ordinary noise.
        depth: Depth at which sessions begin [m].
        hidden: `[[effect]]` tables that the file lacks.
        foreign: Values of effects that the catalogue does not have, by name.
        called: Correct names: effects of the catalogue; empty for effects outside the catalogue.
        title: The hidden effect in a few words.
    """

    kind: str
    seed: int
    preset: str
    source: str
    noise: float
    depth: float
    hidden: tuple[Mapping[str, Any], ...]
    foreign: Mapping[str, float] = field(default_factory=dict)
    called: tuple[str, ...] = ()
    title: str = ""


def draw(kind: str, seed: int, source: str | None = None) -> Case:
    """Draw the case of a kind and seed.

    Successive seeds go through the effects in turn, so that as many studies as effects hide each effect once.

    Args:
        kind: One of KINDS.
        seed: Seed of the case.
        source: Simulator; drawn by default.

    Raises:
        DataError: No vehicle can have the hidden effects.
    """
    rng = np.random.default_rng([seed, KINDS.index(kind)])
    drawn = str(rng.choice(list(SOURCES), p=list(SOURCES.values())))
    source = source or drawn
    if kind in ("unknown", "form"):
        source = "independent"
    noise = float(rng.choice(NOISES))
    for _ in range(ATTEMPTS):
        name = str(rng.choice(vehicles.PRESETS))
        vehicle = vehicles.preset(name)
        hidden, foreign, called, title = _DRAWS.get(kind, _several)(kind, seed, rng, vehicle)
        try:
            validate(vehicles.joined(vehicle, hidden))
        except DataError:
            continue
        near = any(table["name"] == "surface_suction" for table in hidden)
        hidden = [at_depth(table, 1.5 if near else 15.0) for table in hidden]
        return Case(
            kind, seed, name, source, noise, 1.5 if near else 15.0, tuple(hidden), foreign, called, title
        )
    raise DataError(f"no vehicle can have what seed {seed} of kind {kind} hides")


def at_depth(table: Mapping[str, Any], depth: float) -> Mapping[str, Any]:
    """Return the table of an effect with its reference depth `z_0`, if it has one, set to `depth` [m]."""
    return {**table, "z_0": depth} if "z_0" in table else table


Drawn = tuple[list[dict[str, Any]], dict[str, float], tuple[str, ...], str]


def _several(kind: str, seed: int, rng: np.random.Generator, vehicle: Vehicle) -> Drawn:
    """Draw none, one, two or three effects of the catalogue, or one that was added later, by kind."""
    if kind == "later":
        name = LATER[seed % len(LATER)]
        return [strong(name, rng, vehicle)], {}, (name,), name
    count = ("none", "one", "two", "three").index(kind)
    names = [HIDDEN[seed % len(HIDDEN)]] if count else []
    while len(names) < count:
        name = str(rng.choice(HIDDEN))
        if name not in names and not any({name, other} in CONTAINED for other in names):
            names.append(name)
    return [strong(name, rng, vehicle) for name in names], {}, tuple(sorted(names)), " + ".join(names)


def _later(kind: str, seed: int, rng: np.random.Generator, vehicle: Vehicle) -> Drawn:
    """Draw one of the effects in LATER, which were added to the catalogue later."""
    name = LATER[seed % len(LATER)]
    return [strong(name, rng, vehicle)], {}, (name,), name


def strong(name: str, rng: np.random.Generator, vehicle: Vehicle) -> dict[str, Any]:
    """Return the table of an effect at a random place and of random strength."""
    table = {"name": name, **TRUTHS[name](rng, vehicle)}
    factor = float(np.exp(rng.uniform(np.log(WEAKEST), np.log(STRONGEST))))
    return times(table, factor)


def stronger(case: Case, which: Sequence[bool]) -> Case:
    """Return a case in which the hidden effects marked in `which` are twice as strong, within limits."""
    pairs = zip(case.hidden, which, strict=True)
    return replace(case, hidden=tuple(times(table, 2.0 if more else 1.0) for table, more in pairs))


def weaker(case: Case) -> Case:
    """Return a case in which all hidden effects are half as strong."""
    foreign = {k: v * (0.5 if k in SIZES else 1.0) for k, v in case.foreign.items()}
    return replace(case, hidden=tuple(times(table, 0.5) for table in case.hidden), foreign=foreign)


def times(table: Mapping[str, Any], factor: float) -> dict[str, Any]:
    """Return the table of an effect whose strength is multiplied by a factor."""
    fixed, bound = ("name", *FIXED.get(table["name"], ())), WITHIN.get(table["name"], np.inf)
    return {
        k: v if k in fixed else np.clip(factor * np.asarray(v, float), -bound, bound).tolist()
        for k, v in table.items()
    }


def _unknown(kind: str, seed: int, rng: np.random.Generator, vehicle: Vehicle) -> Drawn:
    """Draw effects that the catalogue does not have, or did not have at first."""
    mass, size = vehicle.rigid_body.mass, float(np.exp(rng.uniform(np.log(0.2), np.log(STRONGEST))))
    east = float(rng.uniform(-0.3, 0.3))
    titles: dict[str, dict[str, float]] = {
        "drag that grows with the cube of speed": {"cubic": 0.5 * size},
        "drag that grows with |u|^1.5": {"power": 0.5 * size},
        "propeller wash on the hull": {"wash": 0.2 * size, "wash_pitch": 0.05 * size * vehicle.hull.length},
        "tidal current": {
            "tide": 0.25 * size,
            "tide_east": east * size,
            "tide_rate": 2 * np.pi / float(rng.uniform(15.0, 60.0)),
        },
        "loose mass that swings": {
            "slosh_mass": 0.15 * size * mass,
            "slosh_rate": float(rng.uniform(1.5, 4.0)),
            "slosh_z": 0.1,
        },
        "pull of a wall along the way north": {
            "wall": 0.1 * size * mass,
            "wall_x": float(rng.uniform(-2.0, 2.0)),
            "wall_width": float(rng.uniform(1.0, 3.0)),
        },
        "force with hysteresis": {"hysteresis": 0.1 * size * mass, "hysteresis_path": 0.3},
        "swell": {"swell": 0.1 * size * mass, "swell_rate": 2 * np.pi / float(rng.uniform(4.0, 10.0))},
    }
    title = list(titles)[seed % len(titles)]
    called = ("power_drag",) if {"cubic", "power"} & set(titles[title]) else ()
    return [], titles[title], called, title


def _form(kind: str, seed: int, rng: np.random.Generator, vehicle: Vehicle) -> Drawn:
    """Draw an effect of the catalogue in another functional form."""
    titles: dict[str, tuple[str, dict[str, float]]] = {
        "current that grows with depth": ("ocean_current", {"shear": 0.1, "depth": 15.0}),
        "thruster gains that drift": ("thruster_gain", {"gain_drift": 0.02}),
        "second-order thruster lag": ("thruster_lag", {}),
        "lift that stalls": ("body_lift", {"stall": 0.5}),
        "buoyancy that falls with depth": ("net_buoyancy", {"compression": -0.1, "depth": 15.0}),
        "tether that stiffens": ("tether", {"stiffening": 0.1}),
        "cross-flow drag of a tapered hull": ("crossflow_drag", {"taper": 0.5}),
    }
    title = list(titles)[seed % len(titles)]
    name, foreign = titles[title]
    table = strong(name, rng, vehicle)
    if name == "thruster_lag":  # a further lag behind the rotor's takes the place of a longer one
        return [], {"second_lag": max(float(table["dT"]), 0.01)}, (name,), title
    called = (name, *ALSO.get(title, ()))
    return [table], foreign, tuple(sorted(called)), title


_DRAWS = {"unknown": _unknown, "form": _form, "later": _later}
