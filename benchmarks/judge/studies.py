"""Lists of studies: hidden effects, recordings, and right answers.

A study is drawn from its list and seed alone.  The suites that draw and fly the vehicles are
`hidden_effects`, `imperfect_base`, `imperfect_logs`, `subsets` and `apart`.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import tomlkit

from benchmarks.hidden_effects import cases, vehicles
from benchmarks.hidden_effects.study import flyable, shares, telling
from benchmarks.imperfect_base import base, changes
from benchmarks.imperfect_base.study import changed, standing_out
from benchmarks.imperfect_logs import study as logs
from benchmarks.subsets import ASYNCHRONOUS, SUBSETS, sampled
from hydro.core.evaluation.replay_error import Ahead
from hydro.core.vehicle.description import Vehicle, as_written
from hydro.io import vehicle as files

LEAST = 0.05
"""Minimum share of the file's squared 5 s error caused by each hidden effect of a clean study."""

APART_SEEDS = 1000
"""Seeds of a list of the independent simulator that share one seed of `benchmarks.apart`."""

COUNTED_FROM = frozenset({"current_shear", "current_trend"})
"""Currents that are zero at a depth or time which a fit chooses.

The choice leaves a steady current, so the name `ocean_current` is neither right nor wrong then.
"""


@dataclass(frozen=True)
class Study:
    """Recording to diagnose, with the truth.

    Attributes:
        given: Diagnosed vehicle file.
        measured: Raw table of the recording.
        called: Effects that a right answer names.
        truth: The vehicle that flew, in effects of the catalogue; None where they cannot express it.
        before: Raw table of the earlier recording of the unchanged vehicle; None without one.
        held_out: Raw table of a further session that the diagnosis does not see; None without one.
        errors: Prediction errors on held-out data; None where there are none.
        alias: Effects that stand for the right name; they count as neither right nor wrong.
        misjudged: Effects of the file whose values are wrong by design; naming one counts as neither right
            nor wrong.
        of_log: Effects of the diagnosed log alone, such as a late sensor; the held-out data lack them.
        facts: Further columns of the study's rows: preset, title, condition, noise, share and hidden.
    """

    given: Vehicle
    measured: pl.DataFrame
    called: tuple[str, ...]
    truth: Vehicle | None = None
    before: pl.DataFrame | None = None
    held_out: pl.DataFrame | None = None
    errors: Ahead | None = None
    alias: tuple[str, ...] = ()
    misjudged: tuple[str, ...] = ()
    of_log: tuple[str, ...] = ()
    facts: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Studies:
    """A list of studies.

    Attributes:
        about: Purpose of the list in a few words.
        count: Number of studies in the frozen table.
        seconds: Default length of a recording [s].
        prepare: Function that draws and flies the study of a seed, given the seconds and a common folder.
    """

    about: str
    count: int
    seconds: float
    prepare: Callable[[int, float, Path], Study]


def _clean(kind: str) -> Callable[[int, float, Path], Study]:
    """Return the function that prepares a study of `hidden_effects`, of a kind of its `cases`."""

    def prepare(seed: int, seconds: float, folder: Path) -> Study:
        case, flown = flyable(cases.draw(kind, seed), seconds)
        case, flown = telling(case, flown, seconds, LEAST)
        errors = Ahead(flown.held_out, flown.exact)
        share = shares(case, flown, errors, errors.of(flown.given))[0]
        return Study(
            flown.given,
            flown.measured,
            case.called,
            truth=None if case.foreign else vehicles.joined(flown.exact, case.hidden),
            held_out=flown.held_out,
            errors=errors,
            alias=("ocean_current",) if COUNTED_FROM & set(case.called) else (),
            misjudged=tuple(vehicles.damping_of(flown.given)),
            facts=_facts(case, share),
        )

    return prepare


def _panel(kind: str, with_before: bool) -> Callable[[int, float, Path], Study]:
    """Return the function that prepares a study of a hull of panels, with or without an earlier recording."""

    def prepare(seed: int, seconds: float, folder: Path) -> Study:
        case = changes.draw(kind, seed)
        known = base.of(case.preset, case.seed, base.UNCHANGED, folder / "bases")
        case = standing_out(case, known, seconds)[0]
        case, flown, errors = changed(case, known, seconds)
        share = shares(case, flown, errors, errors.of(known.vehicle))[0]
        return Study(
            flown.given,
            flown.measured,
            case.called,
            truth=vehicles.joined(known.vehicle, case.hidden),
            before=pl.read_parquet(known.unchanged) if with_before else None,
            held_out=flown.held_out,
            errors=errors,
            facts=_facts(case, share),
        )

    return prepare


def _log(kind: str, only: str | None = None) -> Callable[[int, float, Path], Study]:
    """Return the function that prepares a log with faults of sensors or recorded under feedback control.

    Args:
        kind: "one" effect hidden, or "none".
        only: The condition of every log; by default seeds cycle through all conditions.
    """

    def prepare(seed: int, seconds: float, folder: Path) -> Study:
        condition = only or logs.CONDITIONS[seed % len(logs.CONDITIONS)]
        case, flown = logs.logged(cases.draw(kind, seed, "independent"), condition, seconds)
        also = logs.ALSO.get(condition)
        errors = Ahead(flown.held_out, flown.exact)
        share = shares(case, flown, errors, errors.of(flown.given))[0]
        return Study(
            flown.given,
            flown.measured,
            tuple(sorted({*case.called, *([also] if also else [])})),
            held_out=flown.held_out,
            errors=errors,
            misjudged=tuple(vehicles.damping_of(flown.given)),
            of_log=tuple(name for name in [also] if name in logs.OF_LOG and name not in case.called),
            facts=_facts(case, share) | {"condition": condition},
        )

    return prepare


def _sparse(seed: int, seconds: float, folder: Path) -> Study:
    """Prepare a study of sensors that sample at 5, 10 and 50 Hz in one log."""
    case, flown = logs.clean(cases.draw("one", seed, "independent"), seconds)
    errors = Ahead(flown.held_out, flown.exact)
    share = shares(case, flown, errors, errors.of(flown.given))[0]
    return Study(
        flown.given,
        sampled(flown.measured, SUBSETS[ASYNCHRONOUS]),
        case.called,
        truth=vehicles.joined(flown.exact, case.hidden),
        held_out=flown.held_out,
        errors=errors,
        misjudged=tuple(vehicles.damping_of(flown.given)),
        facts=_facts(case, share) | {"condition": ASYNCHRONOUS},
    )


def _apart(with_before: bool) -> Callable[[int, float, Path], Study]:
    """Return the function that prepares a case of the simulator that shares no code with hydro.

    Seed 2007 is case 7 of seed 2 of `benchmarks.apart`.  Without the earlier recording, a `retune` concerns
    the file, whose values are wrong by design.
    """

    def prepare(seed: int, seconds: float, folder: Path) -> Study:
        from benchmarks.apart.cases import CASES
        from benchmarks.apart.judgement import NAMES
        from benchmarks.apart.make import make, record

        number, place = divmod(seed, APART_SEEDS)
        case = CASES[place % len(CASES)]
        there = folder / f"apart-{number}"
        make(number, there, [case.name])
        told, names = record(there / case.name), NAMES[case.kind]
        assert told is not None
        given = files.read(there / case.name / "vehicle.toml")[0]
        own = (str(table["name"]).split(":")[0] for table in given.effect)
        return Study(
            given,
            pl.read_parquet(there / case.name / "after.parquet"),
            names.right,
            before=pl.read_parquet(there / case.name / "before.parquet") if with_before else None,
            alias=names.alias,
            misjudged=() if with_before else tuple(own),
            facts={
                "preset": told["vehicle"],
                "title": case.name,
                "share": told["share5"],
                "hidden": _hidden((), told["truth"]),
            },
        )

    return prepare


def _facts(case: cases.Case, share: float) -> dict[str, Any]:
    """Return the columns of a drawn case; `share` is the part of the squared error that the change causes."""
    return {
        "preset": case.preset,
        "title": case.title,
        "noise": case.noise,
        "share": share,
        "hidden": _hidden(case.hidden, case.foreign),
    }


def _hidden(effects: Sequence[Mapping[str, Any]], foreign: Mapping[str, Any]) -> str:
    """Return the hidden tables of effects, and numbers without an effect, as JSON."""
    return json.dumps({"hidden": effects, "foreign": foreign})


def write(study: Study, folder: Path) -> None:
    """Write a study as files, for `hydro diagnose` and other programs.

    The files are vehicle.toml, after.parquet, truth.json and, if the study has them, before.parquet and
    held_out.parquet.
    """
    folder.mkdir(parents=True, exist_ok=True)
    content = {"format": study.given.format, **msgspec.to_builtins(as_written(study.given))}
    files.write(tomlkit.dumps(content), folder / "vehicle.toml")
    tables = {"before": study.before, "after": study.measured, "held_out": study.held_out}
    for name, table in tables.items():
        if table is not None:
            table.write_parquet(folder / f"{name}.parquet")
    truth = {"called": study.called, "alias": study.alias, **study.facts}
    truth |= json.loads(truth.get("hidden") or "{}")
    (folder / "truth.json").write_text(json.dumps(truth, indent=1) + "\n")


LISTS: Mapping[str, Studies] = {
    "clean-one": Studies("one effect of the catalogue hidden", 50, 300.0, _clean("one")),
    "clean-two": Studies("two effects hidden", 35, 300.0, _clean("two")),
    "clean-three": Studies("three effects hidden", 12, 300.0, _clean("three")),
    "clean-none": Studies("nothing hidden, damping up to 25 % wrong", 40, 300.0, _clean("none")),
    "panel-before": Studies(
        "hull of panels, one change, earlier recording", 48, 300.0, _panel("changed", True)
    ),
    "panel-plain": Studies(
        "hull of panels, one change, no earlier recording", 8, 300.0, _panel("changed", False)
    ),
    "unchanged-before": Studies(
        "hull of panels, no change, earlier recording", 24, 300.0, _panel("nothing", True)
    ),
    "unchanged-plain": Studies(
        "hull of panels, no change, no earlier recording", 5, 300.0, _panel("nothing", False)
    ),
    "logs": Studies("one effect hidden, log with faults or under feedback", 26, 160.0, _log("one")),
    "sparse": Studies("one effect hidden, sensors at 5, 10 and 50 Hz", 9, 180.0, _sparse),
    "apart-before": Studies("independent simulator, one change, earlier recording", 6, 0.0, _apart(True)),
    "apart-plain": Studies("independent simulator, one change, no earlier recording", 0, 0.0, _apart(False)),
    "clean-unknown": Studies("something hidden that the catalogue lacks", 0, 300.0, _clean("unknown")),
    "clean-form": Studies("one effect hidden in another functional form", 0, 300.0, _clean("form")),
    "clean-later": Studies("one effect hidden, of those added later", 0, 300.0, _clean("later")),
    "logs-none": Studies("nothing hidden, log with faults or under feedback", 0, 160.0, _log("none")),
    **{
        f"{name}:{re.sub('[ ,]+', '-', condition)}": Studies(condition, 0, 160.0, _log(kind, condition))
        for name, kind in (("logs", "one"), ("logs-none", "none"))
        for condition in logs.CONDITIONS
    },
}
"""Every list by its name; `logs:filtered` is a list of one condition of `logs`.

Recordings of the independent simulator have lengths of their own.
"""
