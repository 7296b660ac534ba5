"""`hydro diagnose` and `hydro add`: files, pipes, comments, provenance, and bad input in one line."""

from __future__ import annotations

import re
import shlex
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from command_lines import parse, pasted_from
from streams_here import piped
from tables import raw, shorten

from hydro import cli
from hydro.commands import shell
from hydro.core.diagnosis.findings import Diagnosis, Finding, Prediction
from hydro.core.effects.wording import without_uncertainty
from hydro.core.experiment.discrimination import Rival
from hydro.core.experiment.flight import Question
from hydro.core.prediction.parameters import free
from hydro.io import table
from hydro.io import vehicle as vehicles

VEHICLE = Path(__file__).resolve().parents[1] / "datasets" / "vehicles" / "auv151.toml"
STONEFISH = VEHICLE.parents[1] / "stonefish"
NOISE = np.repeat([0.02, 0.001, 0.01, 0.002], 3)
CURRENT = {"v_N": 0.2, "v_E": -0.1, "v_D": 0.0}
DAMPING = {"diagonal": [90.0, 260.0, 380.0, 10.0, 40.0, 30.0]}
FOUND = (
    Finding("missing", "ocean_current", ("ocean_current",), 0.8, 0.7, 0.9, 1.0, 5e-4, CURRENT, CURRENT),
    Finding("retune", "quadratic_damping", ("quadratic_damping",), 0.5, parameters=DAMPING),
    Finding("not_excited", "body_lift", ("body_lift",), excited=False, advice="fly turns"),
)


@pytest.fixture
def diagnosis(tmp_path: Path) -> Path:
    recording = table.make("raw", raw(), stage="import")
    frame = Diagnosis(FOUND, vehicles.read(VEHICLE)[0], (9.0, 5.0, 1.0)).frame()
    made = table.make(
        "diagnosis", frame, stage="diagnose", inputs=[recording], vehicle_text=VEHICLE.read_text()
    )
    table.write(made, tmp_path / "d.parquet")
    return tmp_path / "d.parquet"


def test_add_keeps_the_comments_of_the_file(diagnosis: Path, tmp_path: Path) -> None:
    target = tmp_path / "vehicle2.toml"
    assert cli.main(["add", str(VEHICLE), str(diagnosis), "-o", str(target)]) == 0
    known, text = vehicles.read(target)
    for line in VEHICLE.read_text().splitlines():
        assert "#" not in line or line.partition("#")[2] in text
    (current,) = known.effects("ocean_current")
    assert {key: current[key] for key in CURRENT} == CURRENT
    assert current["standard_error"] == CURRENT
    assert current["fit"]["data"] == table.make("raw", raw(), stage="import").provenance.content
    (damping,) = known.effects("quadratic_damping")
    assert damping["diagonal"] == DAMPING["diagonal"]
    assert known.effects("body_lift") == ()


def test_add_leaves_out_suspects_and_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    suspect = Finding("suspect", "body_lift", ("body_lift",), 0.2, confidence=0.5, parameters={"a_Y": 1.0})
    made = Diagnosis((*FOUND[:2], suspect), vehicles.read(VEHICLE)[0], (9.0, 5.0, 1.0)).frame()
    artefact = table.make("diagnosis", made, stage="diagnose", vehicle_text=VEHICLE.read_text())
    table.write(artefact, tmp_path / "d.parquet")
    target = tmp_path / "vehicle2.toml"
    assert cli.main(["add", str(VEHICLE), str(tmp_path / "d.parquet"), "-o", str(target)]) == 0
    assert vehicles.read(target)[0].effects("body_lift") == ()
    assert "only unconfirmed effects: body_lift (confidence 50%)" in capsys.readouterr().err


def test_add_leaves_out_unsure_new_values(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The headline states them as not certain, so they are added by name only."""
    unsure = replace(FOUND[1], confidence=0.86)
    made = Diagnosis((FOUND[0], unsure), vehicles.read(VEHICLE)[0], (9.0, 5.0, 1.0)).frame()
    artefact = table.make("diagnosis", made, stage="diagnose", vehicle_text=VEHICLE.read_text())
    table.write(artefact, tmp_path / "d.parquet")
    target = tmp_path / "vehicle2.toml"
    assert cli.main(["add", str(VEHICLE), str(tmp_path / "d.parquet"), "-o", str(target)]) == 0
    assert "only unconfirmed effects: quadratic_damping (confidence 86%)" in capsys.readouterr().err
    before = vehicles.read(VEHICLE)[0]
    assert vehicles.read(target)[0].effects("quadratic_damping") == before.effects("quadratic_damping")


def test_add_with_effect_adds_only_the_named_finding(diagnosis: Path, tmp_path: Path) -> None:
    target = tmp_path / "vehicle2.toml"
    line = ["add", str(VEHICLE), str(diagnosis), "--effect", "ocean_current", "-o", str(target)]
    assert cli.main(line) == 0
    known, before = vehicles.read(target)[0], vehicles.read(VEHICLE)[0]
    assert known.effects("quadratic_damping") == before.effects("quadratic_damping")
    assert len(known.effect) == len(before.effect) + 1


def test_the_diagnosis_of_another_vehicle_is_refused(
    diagnosis: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text, edited, target = VEHICLE.read_text(), tmp_path / "edited; rm.toml", tmp_path / "vehicle2.toml"
    mass = re.search(r"^mass = ([\d.]+)", text, re.MULTILINE)
    assert mass is not None
    more = f'{text}\n[[effect]]\nname = "payload"\nmass = 2.0\nz = 0.1\n'
    heavier = text.replace(mass[0], f"mass = {1.02 * float(mass[1])}")
    for other, part in ((heavier, "rigid_body"), (more, "effect payload")):
        edited.write_text(other)
        assert cli.main(["add", str(edited), str(diagnosis), "-o", str(target)]) == 1
        again = f"run `hydro diagnose '{edited}' RECORDING -o {diagnosis}`"
        assert capsys.readouterr().err == (
            f"hydro: {diagnosis}: made from another vehicle than {edited}, they differ in {part}: {again}\n"
        )
        assert not target.exists()
    lost = table.make("diagnosis", table.read(diagnosis).frame, stage="diagnose")
    table.write(lost, tmp_path / "lost.parquet")
    assert cli.main(["add", str(VEHICLE), str(tmp_path / "lost.parquet"), "-o", str(target)]) == 1
    assert "does not say of which vehicle it is: run `hydro diagnose" in capsys.readouterr().err


def test_add_accepts_a_file_changed_only_by_comments_known_marks_or_its_own_findings(
    diagnosis: Path, tmp_path: Path
) -> None:
    text, first, second = VEHICLE.read_text(), tmp_path / "1.toml", tmp_path / "2.toml"
    first.write_text(vehicles.hold_known(f"# Mine.\n{text}", ["added_mass"]))
    line = ["--effect", "ocean_current", "-o", str(second)]
    assert cli.main(["add", str(first), str(diagnosis), *line]) == 0
    assert cli.main(["add", str(second), str(diagnosis), "-o", str(tmp_path / "3.toml")]) == 0
    assert (
        vehicles.read(tmp_path / "3.toml")[0].effects("quadratic_damping")[0]["diagonal"]
        == DAMPING["diagonal"]
    )


def test_add_reads_a_diagnosis_from_a_pipe(diagnosis: Path, tmp_path: Path) -> None:
    target = tmp_path / "vehicle2.toml"
    assert cli.main(["add", str(VEHICLE), str(diagnosis), "-o", str(target)]) == 0
    assert piped("add", VEHICLE, stdin=diagnosis.read_bytes()).stdout == target.read_bytes()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["add", VEHICLE, "d.parquet", "--effect", "payload"], "no finding payload"),
        (["add", VEHICLE, "raw.parquet"], "a raw table, but this needs diagnosis"),
        (["diagnose", VEHICLE, "nowhere.parquet"], "nowhere.parquet"),
        (["diagnose", "nowhere.toml", "raw.parquet"], "nowhere.toml"),
        (["diagnose", VEHICLE, "raw.parquet"], "3 command columns"),
    ],
)
def test_bad_input_gives_a_one_line_error(arguments, words, diagnosis: Path, monkeypatch, capsys) -> None:
    monkeypatch.chdir(diagnosis.parent)
    table.write(table.make("raw", raw(), stage="import"), "raw.parquet")
    assert cli.main([*map(str, arguments), "-o", "out"]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words in told
    assert not Path("out").exists()


@pytest.fixture
def unsure(monkeypatch: pytest.MonkeyPatch) -> None:
    """A diagnosis that leaves a thruster's gain unseen, without the work."""
    known = vehicles.read(STONEFISH / "vehicle.toml")[0]
    unknown = free(known, ["net_buoyancy"])
    model = Rival("net_buoyancy", unknown, unknown.starts[0], np.eye(len(unknown.entries)))
    asked = Question(
        (), model, ("thruster_asymmetry",), NOISE, np.array([0, 0, 3.0, 0, 0, 0]), np.zeros((1, 4))
    )
    made = Diagnosis(FOUND, known, (9.0, 5.0, 1.0), question=asked)
    monkeypatch.setattr("hydro.core.diagnosis.pipeline.diagnose_log", lambda *_, **__: made)


def test_next_run_writes_commands_that_can_be_simulated(unsure, tmp_path, capsys) -> None:
    next_, out = tmp_path / "next.parquet", tmp_path / "d.parquet"
    line = ["diagnose", STONEFISH / "vehicle.toml", STONEFISH / "replay90.parquet", "--next-run", next_]
    line += ["--thrust", 0.2, "--seconds", 15, "--space", 20, "--depth", 1, 9, "-o", out]
    assert cli.main([*map(str, line)]) == 0
    told = capsys.readouterr().err
    assert "expected standard error of thruster_asymmetry" in told
    assert "every predicted position stays within" in told
    flight = table.read(next_, "commands")
    assert flight.provenance.stage == "diagnose"
    assert flight.frame["cmd_1"].abs().max() <= 0.2**0.5 + 1e-6
    target = tmp_path / "raw.parquet"
    assert cli.main(["simulate", str(STONEFISH / "vehicle.toml"), str(next_), "-o", str(target)]) == 0
    assert table.read(target, "raw").frame.height == flight.frame.height


def test_the_old_name_of_next_run_warns_and_works(unsure, tmp_path, capsys) -> None:
    line = ["diagnose", STONEFISH / "vehicle.toml", STONEFISH / "replay90.parquet", "--fly", tmp_path / "n"]
    line += ["--thrust", 2, "-o", tmp_path / "d.parquet"]
    assert cli.main([*map(str, line)]) == 1
    told = capsys.readouterr().err
    assert "--fly is now called --next-run" in told
    assert "is not a share of full thrust" in told


def test_next_run_without_enough_space_gives_a_one_line_error_and_keeps_the_diagnosis(
    unsure, tmp_path, capsys
) -> None:
    next_, out = tmp_path / "next.parquet", tmp_path / "d.parquet"
    line = ["diagnose", STONEFISH / "vehicle.toml", STONEFISH / "replay90.parquet", "--next-run", next_]
    assert cli.main([*map(str, [*line, "--space", 1e-4, "-o", out])]) == 1
    assert "no manoeuvre keeps every prediction" in capsys.readouterr().err.splitlines()[-1]
    assert out.exists()
    assert not next_.exists()
    assert cli.main([*map(str, [*line, "--thrust", 2, "-o", out])]) == 1
    assert "is not a share of full thrust" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "terminal"), [("sample", True), ("sample", False), ("replay90", True)])
def test_a_long_diagnosis_prints_its_expected_duration_first(
    name, terminal, unsure, tmp_path, capsys, monkeypatch
) -> None:
    monkeypatch.delenv("HYDRO_THREADS", raising=False)
    monkeypatch.setattr("os.cpu_count", lambda: 2)
    monkeypatch.setattr("sys.stderr.isatty", lambda: terminal)
    line = ["diagnose", STONEFISH / "vehicle.toml", STONEFISH / f"{name}.parquet", "-o", tmp_path / "d"]
    assert cli.main([*map(str, line)]) == 0
    told = "hydro: 59,914 rows: 8 s to 2 minutes on 2 processors, longer the more is missing\n"
    assert capsys.readouterr().err.startswith(told) == (terminal and name == "sample")


def test_explain_prints_the_expected_duration_of_its_first_step(capsys, monkeypatch) -> None:
    monkeypatch.delenv("HYDRO_THREADS", raising=False)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    frame = table.read(STONEFISH / "replay90.parquet").frame
    shell.tell_duration(frame, shell.expected_seconds(frame, steps=True), steps=True)
    assert capsys.readouterr().err == (
        "hydro: 4,500 rows: first step 6 s to 70 s on one processor, longer the more is missing\n"
    )


def predicting(folder: Path, added: float, *, alone: float) -> Path:
    """A diagnosis of a file that is off by 0.3 m/s, with the errors once its findings are added."""
    found = [replace(one, error_added=alone) if one.parameters else one for one in FOUND]
    frame = Diagnosis(tuple(found), vehicles.read(VEHICLE)[0], (9.0, 5.0, 1.0)).frame()
    known = {"horizon": 5.0, "given": 0.3, "added": added, "spread": 0.01, "floor": 0.02}
    made = table.make(
        "diagnosis",
        frame,
        stage="diagnose",
        parameters={"prediction": known},
        vehicle_text=VEHICLE.read_text(),
    )
    table.write(made, folder / "d.parquet")
    return folder / "d.parquet"


def test_add_refuses_findings_that_do_not_lower_the_error_without_force(tmp_path: Path, capsys) -> None:
    """All together, and one that is named by itself."""
    made = predicting(tmp_path, 0.295, alone=0.1)
    line = ["add", str(VEHICLE), str(made), "-o", str(tmp_path / "v.toml")]
    assert cli.main(line) == 1
    (told,) = capsys.readouterr().err.splitlines()
    assert "does not lower the error 5 s ahead" in told
    assert "0.3 m/s before, 0.295 m/s after; --force adds it all the same" in told
    assert not (tmp_path / "v.toml").exists()
    assert cli.main([*line, "--effect", "ocean_current"]) == 0
    assert cli.main([*line, "--force"]) == 0
    made = predicting(tmp_path, 0.05, alone=0.31)
    assert cli.main(line) == 0
    assert cli.main([*line, "--effect", "ocean_current"]) == 1


@pytest.mark.slow
def test_diagnose_prints_the_headline_first_and_stores_it(tmp_path: Path, capsys, monkeypatch) -> None:
    """In sentences on the terminal, with the errors; and the same in the footer of the diagnosis."""
    monkeypatch.chdir(tmp_path)
    shutil.copytree(VEHICLE.parents[1] / "hidden", "hidden")
    shorten(Path("hidden"), 30.0)
    line = ["diagnose", "hidden/vehicle.toml", "hidden/measured.parquet"]
    assert cli.main([*line, "-o", "d.parquet"]) == 0
    told = [one for one in capsys.readouterr().err.splitlines() if not one.startswith("hydro: ")]
    assert told[0].startswith("The model needs 3 corrections: Thruster 5 delivers 70 % of its")
    assert len(told) <= 40
    assert max(map(len, told)) <= 80
    text = " ".join(told)
    assert "flows toward 323° (NW)" in text
    assert "1. Thruster gain: very likely, more than 98 %." in text
    assert "3. New values of quadratic damping: very likely, more than 98 %." in text
    assert "Yaw drag is 1.3 times the file's value" in text
    assert "need not sum to 100 %" in text
    assert "Look up an effect: hydro effects thruster_gain" in told
    following = pasted_from("\n".join(told))
    assert f"hydro add {line[1]} d.parquet -o vehicle-1.toml" in following
    for one in following:
        parse(one)
    assert cli.main(shlex.split(following[0])[1:]) == 0, "the first command works as it is printed"
    assert vehicles.read("vehicle-1.toml")[0].effects("ocean_current")
    kept = table.read("d.parquet", "diagnosis").provenance.parameters
    assert kept["headline"].startswith("The model needs 3 corrections: Thruster 5 delivers 70 %")
    sentences = table.read("d.parquet", "diagnosis").frame["sentence"]
    assert sentences[0].startswith("Thruster 5 delivers 70 %")
    assert all(without_uncertainty(one) in kept["headline"] for one in sentences[:2])
    known = Prediction(**kept["prediction"])
    assert known.falls
    assert known.added == pytest.approx(known.floor, rel=0.2)
