"""Cases: the change, the vehicle, and the flights before and after."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from benchmarks.apart.changes import MIDDLE
from benchmarks.apart.flights import MODES
from benchmarks.apart.vehicles import MAKERS, Vehicle

ROV, HOVER, FIXED, DRIVEN = "rov", "hover", "fixed", "driven"
PLACES = 48
"""Number of places over which vehicles are distributed: more than cases, so that cases may be added."""
FITTED = 0.4
"""Share of files whose effects are fitted to flights; the others are used as stated."""
SPREAD = {True: 0.3, False: 0.1}
"""Log-scale spread of the errors of a file's numbers, for files fitted afterwards and for others."""
LARGER = 2.2
"""Initial size of a small weight on an open frame, because the file's error would hide a smaller one."""
SMALL = ("payload_plus", "payload_float", "trapped_water", "net_buoyancy")


@dataclass(frozen=True)
class Case:
    """One recording to diagnose.

    Attributes:
        name: Name of the case's folder.
        kind: Kind of the change, one of `CHANGES`.
        vehicles: Makers of vehicles, one of which is drawn.
    """

    name: str
    kind: str
    vehicles: tuple[str, ...]


CASES = (
    Case("current_steady", "current_steady", (ROV, HOVER, FIXED)),
    Case("current_steady_2", "current_steady", (DRIVEN,)),
    Case("current_shear", "current_shear", (ROV, HOVER)),
    Case("current_time", "current_time", (ROV, HOVER, DRIVEN)),
    Case("payload_plus", "payload", (ROV, HOVER)),
    Case("payload_torpedo", "payload", (FIXED, DRIVEN)),
    Case("payload_float", "float", (ROV, HOVER)),
    Case("cg_shift", "cg_shift", (ROV, HOVER, FIXED, DRIVEN)),
    Case("trapped_water", "trapped_water", (ROV, HOVER, FIXED)),
    Case("net_buoyancy", "net_buoyancy", (ROV, HOVER, FIXED, DRIVEN)),
    Case("thr_one", "thr_one", (ROV, HOVER, FIXED)),
    Case("thr_two", "thr_two", (ROV, HOVER)),
    Case("thr_dead", "thr_dead", (ROV, HOVER, FIXED)),
    Case("lag", "lag", (ROV, HOVER, FIXED)),
    Case("delay", "delay", (ROV, HOVER, FIXED)),
    Case("deadband", "deadband", (ROV, HOVER, FIXED)),
    Case("curve", "curve", (ROV, HOVER)),
    Case("asymmetry", "asymmetry", (ROV, HOVER)),
    Case("added_mass", "added_mass", (ROV, HOVER, FIXED, DRIVEN)),
    Case("linear", "linear", (ROV, HOVER)),
    Case("quadratic", "quadratic", (ROV, HOVER)),
    Case("quadratic_2", "quadratic", (FIXED, DRIVEN)),
    Case("appendage", "appendage", (ROV, HOVER)),
    Case("appendage_torpedo", "appendage", (FIXED, DRIVEN)),
    Case("fin_trim", "fin_trim", (DRIVEN,)),
    Case("fin_trim_fixed", "fin_trim", (FIXED,)),
    Case("fin_lost", "fin_lost", (DRIVEN,)),
    Case("fin_lost_fixed", "fin_lost", (FIXED,)),
    Case("tether", "tether", (ROV, HOVER)),
    Case("memory", "memory", (ROV, HOVER, FIXED)),
    Case("inflow", "inflow", (ROV, HOVER)),
    Case("suction", "suction", (ROV, HOVER)),
    Case("dvl_scale", "dvl_scale", (ROV, HOVER, FIXED, DRIVEN)),
    Case("dvl_yaw", "dvl_yaw", (ROV, HOVER, FIXED, DRIVEN)),
    Case("dvl_late", "dvl_late", (ROV, HOVER, FIXED)),
    Case("heading_bias", "heading_bias", (ROV, HOVER, FIXED, DRIVEN)),
    Case("exchanged", "exchanged", (ROV, HOVER, FIXED)),
    Case("reversed", "reversed", (ROV, HOVER, FIXED)),
    Case("unchanged_1", "unchanged", (ROV,)),
    Case("unchanged_2", "unchanged", (HOVER,)),
    Case("unchanged_3", "unchanged", (FIXED,)),
    Case("unchanged_4", "unchanged", (DRIVEN,)),
)
"""All cases; the order sets their numbers, and with these the random draws of a seed."""
UNCHANGED = "unchanged"


@dataclass(frozen=True)
class Drawn:
    """A case of a seed.

    Attributes:
        seed: Seed of all cases.
        place: Index of the case in `CASES`.
        case: The change.
        maker: Maker of the vehicle.
        vehicle: The unchanged vehicle.
        fitted: Whether the vehicle file is fitted to flights.
        modes: Modes in which the sessions are flown, by recording: `fit`, `before` and `after`.
        rows: Number of rows that are kept of each session, by recording.
        depth: Depth near which sessions after the change begin [m].
        excursion: Greatest change of depth between way-points after the change [m].
    """

    seed: int
    place: int
    case: Case
    maker: str
    vehicle: Vehicle
    fitted: bool
    modes: Mapping[str, Sequence[str]]
    rows: Mapping[str, Sequence[int]]
    depth: float = MIDDLE
    excursion: float = 3.0

    @property
    def size(self) -> float:
        """Return the initial size of the change; 1 for all cases of seed 1, as in its first tables."""
        return LARGER if self.seed > 1 and self.maker == ROV and self.case.name in SMALL else 1.0

    def rng(self, *stream: int) -> np.random.Generator:
        """Return the random generator of the case."""
        return np.random.default_rng([self.seed, self.place, *stream])


def draw(seed: int, place: int) -> Drawn:
    """Return the case of a seed at a place of `CASES`."""
    case = CASES[place]
    rng = np.random.default_rng([seed, place, 7])
    dealt = int(np.random.default_rng([seed, 77]).permutation(PLACES)[place])
    maker = case.vehicles[(seed * 5 + place + dealt) % len(case.vehicles)]
    vehicle = MAKERS[maker](rng)
    fitted = bool(rng.uniform() < FITTED)

    def modes(counts: Sequence[int]) -> list[str]:
        each = [mode for mode, count in zip(MODES, counts, strict=True) for _ in range(count)]
        return [str(mode) for mode in rng.permutation(each)]

    flown = {"fit": modes((2, 1, 1)), "before": modes((4, 3, 2))}
    flown["after"] = modes([(2, 1, 1), (1, 1, 2), (2, 2, 0)][int(rng.integers(3))])
    depth, excursion = MIDDLE, 3.0
    if case.kind == "suction":  # near the surface
        depth, excursion, flown["after"] = 1.8, 1.6, ["way"] * 4
    if case.kind in ("current_shear", "tether"):  # over the depths that show them
        excursion, flown["after"] = 5.0, ["way", "axes", "way", "steps"]
    rows = {name: [int(v) for v in rng.integers(3000, 4001, len(each))] for name, each in flown.items()}
    return Drawn(seed, place, case, maker, vehicle, fitted, flown, rows, depth, excursion)
