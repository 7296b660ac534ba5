"""The study of one change as one command, its tables and its figure."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from recordings import damped, noisy

import hydro
from benchmarks import proof as benchmark
from hydro import cli
from hydro.core import effects
from hydro.core.diagnosis.findings import Diagnosis, Finding
from hydro.core.diagnosis.status import Reference, status
from hydro.core.errors import DataError
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.explanation import explain as loop
from hydro.core.explanation import trials
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.report import proof as report
from hydro.study import proof, proof_tables

PAYLOAD = {"name": "net_buoyancy", "dB": 40.0}
"""The change of the vehicle: 40 N of buoyancy."""


def moved(seed: int) -> pl.DataFrame:
    """A log of 20 s of the changed vehicle."""
    t = np.arange(1000) / 50
    demand = {f"cmd_{i}": 0.4 * np.sin((0.2 + 0.05 * i) * t + seed) for i in range(1, 9)}
    log = pl.DataFrame({"session": [f"run-{seed}"] * len(t), "t": t, **demand})
    return noisy(simulate(damped(PAYLOAD), log), seed)


def diagnosed(vehicle: Vehicle, log: object, *_: object, **__: object) -> Diagnosis:
    """Return what a diagnosis of the log finds, without its seconds of search."""
    value, spread = {"dB": 38.0}, {"dB": 1.0}
    there = Finding("missing", "net_buoyancy", ("net_buoyancy",), 0.8, 0.7, 0.9, 1.0, 5e-4, value, spread)
    found = Finding("nothing_missing") if vehicle.effects("net_buoyancy") else there
    return Diagnosis((found,), vehicle, (9.0, 5.0, 1.0), status=status((found,), Reference(vehicle, 0.02)))


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """A quick study of a vehicle that became lighter, and its command line."""
    folder = tmp_path_factory.mktemp("proof")
    for name, vehicle in (("vehicle", damped()), ("truth", damped(PAYLOAD))):
        hydro.write_vehicle(vehicle, folder / f"{name}.toml")
    for name, seed in (("log", 1), ("held", 2)):
        table.write(table.make("raw", moved(seed), stage="import"), folder / f"{name}.parquet")
    line = ["study", "proof", str(folder / "log.parquet"), "--vehicle", str(folder / "vehicle.toml")]
    line += ["--holdout", str(folder / "held.parquet"), "--truth", str(folder / "truth.toml"), "--quick"]
    line += ["-o", str(folder / "proof")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "diagnose_log", diagnosed)
        patch.setattr(trials.Recordings, "left_out", lambda *_: Squares(np.ones((2, 6)), np.ones((2, 6))))
        assert cli.main(line) == 0
    return folder / "proof", line


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*.parquet")}


def settings(folder: Path, **other: object) -> proof.Study:
    places = (folder.parent / name for name in ("vehicle.toml", "log.parquet", "held.parquet", "truth.toml"))
    return proof.Study(folder, *places, **other)


def test_a_quick_study_finds_the_change_and_flies_every_policy(quick: tuple[Path, list[str]]) -> None:
    folder, _ = quick
    study = proof.quick(settings(folder))
    errors = dict(proof_tables.errors(study).select("method", "error").iter_rows())
    assert list(errors)[:2] == ["file as given", "step 1: net_buoyancy"]
    assert errors["step 1: net_buoyancy"] < 0.3 * errors["file as given"]
    assert errors["file with the true change"] < 0.3 * errors["file as given"]
    assert {"zero velocity", "least squares"} < set(errors)
    first = proof_tables.named(study, proof.chosen(study)).row(0, named=True)
    assert first["value"] == "net_buoyancy dB"
    assert first["true"] == PAYLOAD["dB"]
    assert first["low"] < first["found"] < first["high"]
    assert first["found"] == pytest.approx(PAYLOAD["dB"], abs=2.0)
    flights = proof_tables.flights(study)
    assert set(flights.filter(flown_by="policy").select("file", "vehicle").iter_rows()) == {
        ("before", "changed"), ("before", "unchanged"), ("after", "changed"),
    }  # fmt: skip
    assert set(flights.filter(flown_by="helmsman")["vehicle"]) == {"changed", "unchanged"}
    assert flights.filter(flown_by="policy")["updates"].n_unique() == 1
    assert (folder / "proof.png").stat().st_size > 10_000


def test_a_study_that_lost_files_makes_the_same_bytes_again(
    quick: tuple[Path, list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    folder, line = quick
    before = contents(folder)
    for name in ("policy.parquet", "checkpoint.pt", "changed.parquet"):
        (folder / "after-seed0" / name).unlink()
    assert cli.main(line) == 0
    assert contents(folder) == before
    assert "2 of 9 steps run, the others were done" in capsys.readouterr().err


def test_every_file_is_made_before_it_is_read() -> None:
    study = settings(Path("proof"), before=Path("before.parquet"))
    made = {study.vehicle, study.log, study.holdout, study.truth, study.before}
    after = study.explained / "vehicle-1.toml"
    plan = [*proof.finding(study), *proof.trainings(study, after)]
    for step in plan:
        assert {path for path in step.reads if path != after} <= made, step.name
        made.update(step.writes)
    lines = [step.line for step in plan if step.line[:2] == ("rl", "train")]
    own = {str(study.vehicle), str(after), *(str(run.folder) for run in study.runs), *"01234"}
    assert len(lines) == 10
    assert len({tuple(word for word in line if word not in own) for line in lines}) == 1, "an equal budget"


def test_arrivals_of_all_seeds_have_wilsons_interval() -> None:
    row = {"flown_by": "policy", "file": "after", "vehicle": "changed", "updates": 1, "episodes": 50}
    shares = {"success_low": 0.0, "success_high": 1.0}
    flights = pl.DataFrame([row | shares | {"seed": k, "success": one} for k, one in enumerate((0.9, 0.7))])
    (found,) = proof_tables.pooled(flights).to_dicts()
    assert (found["seeds"], found["episodes"], found["least"], found["most"]) == (2, 100, 0.7, 0.9)
    assert [found[name] for name in ("success", "success_low", "success_high")] == pytest.approx(
        [0.8, 0.7112, 0.8666], abs=1e-4
    )  # Wilson's score interval of 80 of 100 by hand: (p + z²/2n ± z √(pq/n + z²/4n²)) / (1 + z²/n)


def test_values_are_named_by_their_place_and_those_of_the_truth_are_never_left_out() -> None:
    weak = {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, *[0.0] * 5]}
    found = {"name": "net_buoyancy", "dB": 3.0, "standard_error": {"dB": 1.0}}
    rows = proof_tables.changes(damped(), damped(found), damped(weak)).to_dicts()
    assert [row["value"] for row in rows] == ["net_buoyancy dB", "thruster_gain g[3]"]
    assert rows[0] | {"low": None} == {
        "value": "net_buoyancy dB", "given": None, "found": 3.0, "low": None, "high": pytest.approx(4.96),
        "true": 0.0,
    }  # fmt: skip
    assert (rows[1]["found"], rows[1]["low"], rows[1]["true"]) == (0.0, None, -0.4)


@pytest.mark.parametrize("effect", benchmark.CHANGES.values(), ids=benchmark.CHANGES)
def test_every_other_change_is_an_effect_of_the_bundled_vehicle(
    effect: dict[str, Any], datasets: Path
) -> None:
    text = (datasets / "changed" / "vehicle.toml").read_text()
    changed = vehicles.parse(vehicles.set_effect(text, effect))
    effects.validate(changed)
    assert changed.effects(effect["name"])


def test_a_study_without_a_finding_says_so(quick: tuple[Path, list[str]], tmp_path: Path) -> None:
    folder, _ = quick
    known = table.read(folder / "study" / "ladder.parquet", "ladder")
    (tmp_path / "study").mkdir()
    only = table.make("ladder", known.frame.filter(step=0), stage="test")
    table.write(only, tmp_path / "study" / "ladder.parquet")
    with pytest.raises(DataError, match="explain added nothing"):
        proof.chosen(settings(tmp_path))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--truth", "truth.toml"], "--truth truth.toml: name the log of the changed vehicle, too"),
        (["log.parquet", "--truth", "truth.toml"], "the study also needs --holdout RAW"),
        (["log.parquet", "--holdout", "held.parquet"], "the study also needs --truth FILE"),
    ],
)
def test_a_missing_file_is_named(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["study", "proof", *arguments, "-o", str(tmp_path / "proof")]) == 2
    assert told in capsys.readouterr().err


def test_the_figure_names_what_was_not_run_and_draws_every_value_of_the_truth() -> None:
    errors = pl.DataFrame({"method": ["file as given", "PySINDy"], "error": [0.7, None]})
    weak = {"name": "thruster_gain", "g": [0.0, 0.0, -0.4, *[0.0] * 5]}
    named = proof_tables.changes(damped(), damped(), damped(weak))
    row = {"flown_by": "policy", "file": "after", "vehicle": "changed", "episodes": 50, "success": 0.9}
    flights = pl.DataFrame([row])
    missing = ["PySINDy (not installed: pysindy)"]
    drawn = report.draw(
        {"a change": report.Shown(errors, named, proof_tables.pooled(flights), flights, (), missing)}
    )
    left, middle, right = drawn.axes
    assert drawn.get_supxlabel() == "a change, left out: PySINDy (not installed: pysindy)"
    assert [label.get_text() for label in left.get_yticklabels()] == ["file as given"]
    assert [label.get_text() for label in middle.get_yticklabels()] == ["thruster_gain\ng[3]"]
    assert "trained after,\nchanged vehicle (1)" in [label.get_text() for label in right.get_yticklabels()]


def test_the_kept_tables_are_drawn_with_every_method_and_every_missing_one() -> None:
    made = runpy.run_path(str(Path(__file__).resolve().parents[1] / "docs" / "draw_proof.py"))
    errors, named = made["kept"]("proof_errors"), made["kept"]("proof_named")
    changes = dict.fromkeys(row["change"] for row in errors)
    assert len(changes) == 2
    for change in changes:
        shown = made["shown"](change)
        assert shown.errors["method"].to_list() == [
            row["method"] for row in errors if row["change"] == change
        ]
        assert len(shown.missing) == shown.errors["error"].null_count()
        assert shown.named.height == sum(row["change"] == change for row in named)
        assert shown.pooled.filter(flown_by="helmsman").height == 2
