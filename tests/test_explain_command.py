"""`hydro explain`: the files of a study, going on with it, and bad input in one line."""

from __future__ import annotations

import json
import re
import shlex
from dataclasses import replace
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import polars as pl
import pytest
from command_lines import pasted_from
from streams_here import piped
from terminal import fits, on_terminal

import hydro
from hydro import cli
from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.findings import Diagnosis, Finding, extended
from hydro.core.diagnosis.status import Reference, status
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation import leftover
from hydro.core.evaluation.velocity_errors import Squares
from hydro.core.explanation import explain as loop
from hydro.core.explanation import trials
from hydro.core.simulation.estimates import Estimate, Estimates
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.core.vehicle.plausible import between
from hydro.io import provenance, table
from hydro.io import vehicle as vehicles
from hydro.io.study import NO_FORCES
from hydro.report.page import render
from hydro.report.sources import gather

VEHICLE = Path(__file__).resolve().parents[1] / "datasets" / "vehicles" / "auv151.toml"
CURRENT = {"v_N": 0.2, "v_E": -0.1, "v_D": 0.0}
SPREAD = {"v_N": 0.01, "v_E": 0.01, "v_D": 0.01}
LEFT_OUT = Squares(np.full((2, 6), 0.01), np.ones((2, 6)))
LINE = ("explain", str(VEHICLE), "measured.parquet", "--holdout", "held.parquet", "-o", "study")
FILES = [
    f"{kind}-{k}.{end}" for k in (0, 1) for kind, end in (("comparison", "parquet"), ("vehicle", "toml"))
]
FILES += ["diagnosis-0.parquet", "diagnosis-1.parquet"]
FILES += [f"{name}.parquet" for name in ("ladder", "replay", "leftover", "sessions", "bands")]
FILES += ["vehicle-1.covariance.parquet"]

COMPARED: dict[str, pl.DataFrame] = {}
"""Comparisons by vehicle and session: the same in every test, and a second each."""
STUDY: dict[str, bytes] = {}
"""Files of the study of LINE, made by the first test that begins with one."""


@cache
def recording(seed: int, seconds: float = 12.0) -> pl.DataFrame:
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * 50)) / 50
    demand = {f"cmd_{i}": 0.4 * np.sin((0.2 + 0.05 * i) * t + seed) for i in range(1, 9)}
    known = extended(vehicles.read(VEHICLE)[0], [{"name": "ocean_current", **CURRENT}])
    moved = simulate(known, pl.DataFrame({"session": [f"run-{seed}"] * len(t), "t": t, **demand}))
    logged = disturb(moved.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return moved.with_columns(pl.DataFrame(logged, schema=[*POSE, *VELOCITY]))


@pytest.fixture
def counted(tmp_path, monkeypatch) -> list[str]:
    """Two recordings in the working folder; a current is found once; every computation is counted."""
    monkeypatch.chdir(tmp_path)
    for name, seed in (("measured", 1), ("held", 2)):
        table.write(table.make("raw", recording(seed), stage="import"), f"{name}.parquet")
    calls: list[str] = []
    true = trials.compare

    def compare(vehicle, raw, record, yardstick, progress):
        calls.append("compare")
        key = repr((vehicle, raw["session"][0]))
        if key not in COMPARED:
            COMPARED[key] = true(vehicle, raw, record=record, yardstick=yardstick)
        return COMPARED[key]

    def diagnose(vehicle, log, progress, hull, further, file, in_vain, beyond, provisional):
        calls.append("diagnose")
        there = vehicle.effects("ocean_current")
        one = Finding(
            "missing", "ocean_current", ("ocean_current",), 0.8, 0.7, 0.9, 1.0, 5e-4, CURRENT, SPREAD
        )
        found = (Finding("nothing_missing") if there else one,)
        return Diagnosis(found, vehicle, (9.0, 5.0, 1.0), status=status(found, Reference(vehicle, 0.02)))

    def together(vehicle, recordings, wanted, file, tried):
        calls.append("fit")
        fitted = ({"name": "ocean_current", **CURRENT, "standard_error": SPREAD},)
        entries = tuple(Estimate("ocean_current", name, (), "m/s", value) for name, value in CURRENT.items())
        estimates = Estimates(entries, np.diag([SPREAD[one.parameter] ** 2 for one in entries]))
        return SimpleNamespace(tables=lambda: fitted, estimates=lambda: estimates)

    monkeypatch.setattr(trials, "compare", compare)
    monkeypatch.setattr(trials, "_fit_together", together)
    monkeypatch.setattr(loop, "diagnose_log", diagnose)
    monkeypatch.setattr(trials.Recordings, "left_out", lambda *_: LEFT_OUT)  # the log is short
    return calls


def run(*more: str) -> int:
    return cli.main([*LINE, *more])


def begin_with_a_study() -> None:
    """Put a finished study of LINE in the working folder: computed once, copied afterwards."""
    if STUDY:
        Path("study").mkdir()
        for name, content in STUDY.items():
            Path("study", name).write_bytes(content)
    else:
        assert run() == 0
        STUDY.update(contents())


def contents() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in Path("study").iterdir()}


def test_a_study_writes_its_files(counted, capsys):
    assert run("--details") == 0
    assert sorted(contents()) == sorted(FILES)
    for name in FILES:
        assert cli.main(["check", f"study/{name}"]) == 0
    ladder = table.read("study/ladder.parquet", "ladder")
    hashes = [table.read(f"{name}.parquet").provenance.content for name in ("measured", "held")]
    assert [one.content for one in ladder.provenance.inputs if one.kind == "raw"] == hashes
    assert ladder.frame["step"].unique().to_list() == [0, 1]
    replay = table.read("study/replay.parquet", "replay").frame
    assert replay["session"].unique().to_list() == ["run-2"], "what is held out is shown"
    assert replay["variant"].unique(maintain_order=True).to_list() == ["measured", "step-0", "step-1"]
    told = capsys.readouterr().err
    for words in (
        "step 0, the file as given",
        "step 1, ocean current",
        "noise floor",
        "v_N: 0.20 ± 0.01 [m/s]",
        "vehicle-1.toml",
    ):
        assert words in told
    assert told.index("held-out") < told.index("It ends here: nothing more is found.")


def test_the_answer_of_explain_fits_one_screen(counted, capsys, monkeypatch):
    """With the headline of a diagnosis, errors before and after, the steps and the next command."""
    text = on_terminal([*LINE], 80, monkeypatch)
    assert fits(text), text
    lines = text.splitlines()
    assert len(lines) <= 40
    assert lines[0].startswith("The model needs 1 correction: A current of 0.22 m/s")
    assert "Look up an effect: hydro effects ocean_current" in lines
    rows = [line.split() for line in lines if re.match(r"  (?:[uvwpqr]|all) \[", line)]
    assert [row[0] for row in rows] == [*"uvwpqr", "all"]
    before, after, floor = (float(one) for one in rows[-1][2:5])
    assert floor <= after < before
    assert "1, ocean current: error" in text
    (following,) = pasted_from(text)
    assert cli.main(shlex.split(following)[1:]) == 0
    assert Path("report.html").exists()


def test_text_and_details_print_to_a_pipe(counted, monkeypatch):
    done = piped(*LINE, "--text")
    assert done.stdout.decode().startswith("The model needs 1 correction")
    assert b"step 1, ocean current" in done.stderr, "steps are told as they are done"
    details = piped(*LINE, "--text", "--details").stdout.decode()
    assert "v_N: 0.20 ± 0.01 [m/s]" in details


def test_a_step_that_no_test_confirmed_is_called_unconfirmed(counted, monkeypatch, capsys):
    """The current is suspected alone, and a trial adds it."""
    once = loop.diagnose_log

    def suspected(*given, **more):
        found = once(*given, **more)
        return replace(found, findings=tuple(_doubted(one) for one in found.findings))

    monkeypatch.setattr(loop, "diagnose_log", suspected)
    tables = ({"name": "ocean_current", **CURRENT, "standard_error": SPREAD},)
    trial = loop.Trial(("ocean_current",), tables, extended(vehicles.read(VEHICLE)[0], list(tables)))
    monkeypatch.setattr(loop, "best_trial", lambda last, *_: None if last.tables else trial)
    assert run() == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "Not certain: A current of 0.22 m/s" in told
    assert "step 1, ocean current (unconfirmed)" in told
    assert "correction" not in told
    assert run("--json") == 0
    made = json.loads(capsys.readouterr().out)
    assert made["headline"].endswith("(unconfirmed).")
    assert [step["stated"] for step in made["steps"]] == [False, False]


def _doubted(one: Finding) -> Finding:
    return replace(one, verdict="suspect", confidence=0.5) if one.verdict == "missing" else one


def test_a_study_has_the_bands_of_its_best_step(counted):
    """A current that is known to 1 cm/s: within each 20 s from one beginning the track's band widens."""
    begin_with_a_study()
    made = table.read("study/bands.parquet", "bands")
    assert made.provenance.parameters["step"] == 1
    frame = made.frame
    assert frame["session"].unique().to_list() == ["run-2"]
    assert (frame["x_low"] <= frame["x"]).mean() > 0.95
    since = frame["t"].to_numpy()
    width = (frame["x_high"] - frame["x_low"]).to_numpy()
    assert width[since > 10.0].min() > 5.0 * width[since < 1.0].max()
    page = render(gather(["study"]))
    assert "95 % band from the errors of its values" in page


def test_a_study_stores_sessions_and_unexplained_forces_of_the_recordings(counted):
    begin_with_a_study()
    listed = table.read("study/sessions.parquet", "sessions").frame
    assert listed.rows() == [("fit", "run-1", 600, 0.02), ("holdout", "run-2", 600, 0.02)]
    told = table.read("study/replay.parquet", "replay").frame.filter(variant="measured")
    given = table.read("held.parquet", "raw").frame[::5]
    commands = [f"cmd_{i}" for i in range(1, 9)]
    np.testing.assert_allclose(told.select(commands), given.select(commands), atol=1e-6)
    left = table.read("study/leftover.parquet", "leftover").frame
    assert left["step"].unique().to_list() == [0, 1]


def test_a_recording_without_unexplained_forces_stores_the_reason(counted, monkeypatch):
    def refuse(vehicles, raw, record):
        raise DataError("samples are of u in 10%")

    monkeypatch.setattr(leftover, "leftover", refuse)
    assert run() == 0
    assert "leftover.parquet" not in contents()
    made = table.read("study/sessions.parquet", "sessions").provenance
    assert made.parameters == {NO_FORCES: "samples are of u in 10%"}


def test_the_vehicle_file_of_a_step_keeps_its_comments(counted):
    begin_with_a_study()
    first, text = vehicles.read("study/vehicle-1.toml")
    assert Path("study/vehicle-0.toml").read_text() == VEHICLE.read_text()
    assert text.startswith(VEHICLE.read_text().rstrip())
    (current,) = first.effects("ocean_current")
    content = table.read("measured.parquet").provenance.content
    origin = {"data": content, "method": "explain"}
    assert current == {"name": "ocean_current", **CURRENT, "standard_error": SPREAD, "fit": origin}
    compared = table.read("study/comparison-1.parquet", "comparison").provenance
    assert compared.vehicle == text
    assert (
        cli.main(
            [
                "compare",
                str(VEHICLE),
                "measured.parquet",
                "--against",
                "study/comparison-1.parquet",
                "-o",
                "c",
            ]
        )
        == 0
    )


def test_explain_reports_implausible_values(counted, capsys, monkeypatch):
    """Of what a study has fitted; a current of 0.2 m/s is nothing to tell."""
    assert cli.main(list(LINE)) == 0
    assert "Not plausible" not in capsys.readouterr().err
    narrow = between(-0.1, 0.1, "m/s", "a pond")
    (known,) = (one for one in CATALOGUE["ocean_current"].parameters if one.name == "v_N")
    monkeypatch.setitem(known.__dict__, "plausible", narrow)
    assert cli.main(list(LINE)) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "Not plausible, so it may stand for something else: ocean_current.v_N = 0.2 m/s is" in told


def test_explain_in_python_gives_the_same_result(counted):
    begin_with_a_study()
    raw, heldout = (hydro.read(f"{name}.parquet") for name in ("measured", "held"))
    known = hydro.vehicle(VEHICLE)
    steps = list(hydro.explain(known, raw, holdout=heldout))
    assert pl.concat(step.ladder for step in steps).equals(hydro.read("study/ladder.parquet"))
    found = hydro.read("study/diagnosis-0.parquet", "diagnosis")
    assert steps[0].diagnosis.equals(found)
    assert hydro.add(known, found) == steps[1].vehicle
    compared = hydro.compare(steps[1].vehicle, raw, against=steps[0].comparison)
    apart = pl.col("by") != "place"  # the earlier places are looked at again
    assert compared.drop("before").filter(apart).equals(steps[1].comparison.filter(apart))
    with pytest.raises(DataError, match="no finding payload"):
        hydro.add(known, found, ["payload"])


def test_a_completed_study_is_not_repeated(counted, capsys):
    begin_with_a_study()
    before = contents()
    counted.clear()
    capsys.readouterr()
    assert run() == 0
    assert counted == []
    assert contents() == before
    assert capsys.readouterr().err.count("already done") == 2


def test_a_study_that_ended_without_a_better_prediction_is_not_repeated(counted, monkeypatch):
    tried: list[int] = []
    monkeypatch.setattr(loop, "best_trial", lambda last, *_: tried.append(last.number))
    assert run() == 0
    before = contents()
    assert loop.NO_BETTER in table.read("study/ladder.parquet").provenance.parameters["ended"]
    assert run() == 0
    assert tried == [0]
    assert contents() == before


def test_a_completed_study_of_a_file_from_another_study_is_not_repeated(counted):
    begin_with_a_study()
    line = ["explain", "study/vehicle-1.toml", "held.parquet", "-o", "next"]
    assert cli.main(line) == 0
    counted.clear()
    assert cli.main(line) == 0
    assert counted == []


@pytest.mark.parametrize("lost", ["diagnosis-1.parquet", "vehicle-1.toml", "comparison-1.parquet"])
def test_an_interrupted_study_resumes(counted, lost):
    begin_with_a_study()
    before = contents()
    Path("study", lost).unlink()
    counted.clear()
    assert run() == 0
    assert counted == ["fit", "compare", "compare", "diagnose"]
    assert contents() == before


def test_an_edited_vehicle_file_of_a_study_is_written_again(counted):
    begin_with_a_study()
    before = contents()
    Path("study/vehicle-1.toml").write_text(
        before["vehicle-1.toml"].decode().replace("v_N = 0.2", "v_N = 0.3")
    )
    assert run() == 0
    assert contents() == before


def test_another_study_replaces_the_files_in_the_folder(counted, capsys):
    begin_with_a_study()
    Path("study/notes.txt").write_text("mine")
    Path("study/vehicle-7.toml").write_text("of an older one")
    capsys.readouterr()
    assert cli.main(["explain", str(VEHICLE), "measured.parquet", "-o", "study"]) == 0
    assert "files of another study there are replaced" in capsys.readouterr().err
    assert sorted(contents()) == sorted([*FILES, "notes.txt"])
    assert set(table.read("study/ladder.parquet").frame["dataset"]) == {"fit"}
    assert table.read("study/replay.parquet").frame["session"].unique().to_list() == ["run-1"]


def test_another_version_of_hydro_starts_the_study_again(counted, monkeypatch):
    begin_with_a_study()
    counted.clear()
    monkeypatch.setattr(provenance, "package_version", lambda: "9.9")
    assert run() == 0
    assert counted.count("diagnose") == 2


def test_explain_reads_a_recording_from_a_pipe(counted, monkeypatch):
    begin_with_a_study()
    before = contents()
    with open("measured.parquet", "rb") as stream:
        monkeypatch.setattr("sys.stdin", type("Stdin", (), {"buffer": stream})())
        assert cli.main(["explain", str(VEHICLE), "--holdout", "held.parquet", "-o", "other"]) == 0
    assert {path.name: path.read_bytes() for path in Path("other").iterdir()} == before


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--holdout", "held.parquet", "-o", "held.parquet"], "held.parquet: a file, not a folder"),
        (["--holdout", "held.parquet", "-o", "held.parquet/study"], "part of this path is a file"),
        (["--holdout", "measured.parquet", "-o", "study"], "measured.parquet: the same rows"),
        (["--holdout", "seven.parquet", "-o", "study"], "seven.parquet: the table has 7 command columns"),
        (["--holdout", "short.parquet", "-o", "study"], "short.parquet: no session lasts 5 s"),
        (["--holdout", "nowhere.parquet", "-o", "study"], "nowhere.parquet: no such file"),
        (["--holdout", str(VEHICLE), "-o", "study"], "this is a vehicle file"),
    ],
)
def test_bad_input_gives_a_one_line_error(counted, arguments, words, capsys):
    for name, frame in (("seven", recording(3).drop("cmd_8")), ("short", recording(3, 4.0))):
        table.write(table.make("raw", frame, stage="import"), f"{name}.parquet")
    assert cli.main(["explain", str(VEHICLE), "measured.parquet", *arguments]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words in told
    assert not Path("study").exists()
    assert counted == []


@pytest.mark.parametrize("seconds", [0.1, 0.3, 0.6, 4.0])
def test_a_too_short_recording_gives_a_one_line_error(counted, seconds, capsys):
    table.write(table.make("raw", recording(3, seconds), stage="import"), "short.parquet")
    assert cli.main(["explain", str(VEHICLE), "short.parquet", "-o", "study"]) == 1
    assert "short.parquet: no session lasts 5 s" in capsys.readouterr().err
