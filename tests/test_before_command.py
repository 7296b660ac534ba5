"""`--before` of compare, explain and report: what has changed, with a model of the hull held fixed."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pytest
from command_lines import pasted_from
from recordings import WEAK, damped, flown
from streams_here import on_terminal
from terminal import fits

import hydro
from hydro import cli
from hydro.core.diagnosis import pipeline
from hydro.core.errors import UsageError
from hydro.core.vehicle.description import Vehicle
from hydro.io import table
from hydro.io import vehicle as vehicles
from hydro.io.provenance import content_hash
from hydro.report import change
from hydro.report.page import render
from hydro.report.sources import gather


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that knows nothing of the hull, and the vehicle before, after and without a change."""
    folder = tmp_path_factory.mktemp("before")
    hydro.write_vehicle(damped(), folder / "vehicle.toml")
    recordings = {"earlier": flown(seed=10, rows=1000), "same": flown(seed=70, rows=1000)}
    for name, seed in (("after", 40), ("heldout", 100)):
        recordings[name] = flown(WEAK, seed=seed).filter(pl.col("session") < "s2")
    for name, frame in recordings.items():
        hydro.write(frame, folder / f"{name}.parquet", "raw")
    return folder


@pytest.fixture(scope="module", autouse=True)
def learnt_once() -> Iterator[None]:
    """Learn the hull of each recording once for all commands of this file, which mostly read the same one."""
    learnt: dict[tuple[bytes, str], Any] = {}
    learn = pipeline.hull_of

    def kept(vehicle: Vehicle, before: pl.DataFrame, law: Any = None) -> Any:
        if law is not None:
            return learn(vehicle, before, law)
        key = msgspec.json.encode(vehicle), content_hash(before)
        if key not in learnt:
            learnt[key] = learn(vehicle, before)
        return learnt[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(pipeline, "hull_of", kept)
        yield


@pytest.fixture(autouse=True)
def there(work: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(work)


def run(*arguments: object) -> int:
    return cli.main([str(one) for one in arguments])


def times(comparison: pl.DataFrame) -> dict[str, float]:
    return dict(change.errors(comparison).select("axis", "ratio").iter_rows())


def test_compare_prints_errors_and_floor_axis_by_axis(capsys) -> None:
    found = {}
    for name in ("after", "same"):
        line = ["compare", "vehicle.toml", f"{name}.parquet", "--before", "earlier.parquet"]
        assert run(*line, "-o", f"{name}-compared.parquet") == 0
        found[name] = table.read(f"{name}-compared.parquet", "comparison")
    told = capsys.readouterr().err
    assert "On the earlier recording (earlier), the error" in told
    unchanged, changed = times(found["same"].frame), times(found["after"].frame)
    assert max(unchanged.values()) < 1.5, "a hull alike in both recordings leaves what it left"
    most = max(changed, key=lambda axis: changed[axis])
    assert changed[most] > 2.0
    assert f"most in {most}, {changed[most]:.1f} times" in told
    rows = found["same"].frame.filter(level="hull", place="after", axis="v")
    alone, beside = (rows.filter(by=by)["rmse"].item() for by in ("file alone", "with the hull"))
    assert beside < 0.5 * alone, "without the hull's model the file errs much more"
    footer = found["after"].provenance
    assert footer.parameters["before"]["recording"] == "earlier"
    earlier = table.read("earlier.parquet").provenance.content
    assert [one.content for one in footer.inputs if one.kind == "raw"][1:] == [earlier]
    python = hydro.compare(
        hydro.vehicle("vehicle.toml"), hydro.read("same.parquet"), before=hydro.read("earlier.parquet")
    )
    assert python.equals(found["same"].frame)


def test_the_answer_for_a_changed_vehicle_fits_one_screen() -> None:
    line = ["compare", "vehicle.toml", "after.parquet", "--before", "earlier.parquet"]
    code, printed = on_terminal(*line, columns=80)
    assert code == 0
    assert fits(printed.replace("\r", "").strip())
    assert len(printed.splitlines()) <= 40
    assert printed.strip().startswith("The error after is ")
    (following,) = pasted_from(printed)
    assert following == (
        "hydro diagnose vehicle.toml after.parquet --before earlier.parquet -o diagnosis.parquet"
    )


def test_compare_reports_exchanged_command_columns(capsys) -> None:
    exchanged = hydro.read("same.parquet").with_columns(cmd_1="cmd_2", cmd_2="cmd_1")
    hydro.write(exchanged, "exchanged.parquet", "raw")
    assert (
        run("compare", "vehicle.toml", "exchanged.parquet", "--before", "earlier.parquet", "-o", "x.parquet")
        == 0
    )
    told = capsys.readouterr().err
    assert "exchanged.parquet: columns 1 and 2 are swapped" in told
    assert max(times(table.read("x.parquet", "comparison").frame).values()) < 1.5


def test_changes_are_added_until_nothing_more_has_changed(capsys) -> None:
    line = ["explain", "vehicle.toml", "after.parquet", "--before", "earlier.parquet"]
    line += ["--holdout", "heldout.parquet", "-o", "study"]
    assert run(*line) == 0
    told = capsys.readouterr().err
    assert "It ends here: nothing more has changed." in told
    first, _ = vehicles.read("study/vehicle-0.toml")
    last, _ = vehicles.read("study/vehicle-1.toml")
    (gain,) = last.effects("thruster_gain")
    assert gain["g"] == pytest.approx([0.0, -0.3, *6 * [0.0]], abs=0.05)
    assert 0.0 < gain["standard_error"]["g"][1] < 0.05
    assert last.effect[: len(first.effect)] == first.effect, "the file's own values are held"
    ladder = hydro.read("study/ladder.parquet").filter(axis="floor")
    for dataset in ("fit", "holdout"):
        before, after = ladder.filter(dataset=dataset).sort("step")["rmse"]
        assert after < 0.7 * before
        assert after < 1.3, "what is left is what the model of the hull leaves"
    assert hydro.read("study/diagnosis-1.parquet")["verdict"].to_list() == ["nothing_missing"]
    page = render(gather(["study"]))
    assert "What has changed since the recording “earlier”?" in page
    assert "with thruster gain" in page
    assert "Noise explains the remaining error" not in page
    assert run(*line) == 0
    assert "(already done)" in capsys.readouterr().err


def test_held_out_data_too_short_for_a_floor_are_refused_by_name(capsys) -> None:
    hydro.write(hydro.read("heldout.parquet").filter(session="s0").head(300), "short.parquet", "raw")
    line = ["explain", "vehicle.toml", "after.parquet", "--before", "earlier.parquet"]
    assert run(*line, "--holdout", "short.parquet", "-o", "never") == 1
    told = capsys.readouterr().err
    assert told.startswith("hydro: short.parquet: 6 s without a gap are too short")
    assert told.count("\n") == 1
    assert not Path("never").exists()


def test_explain_in_python_makes_one_step_if_nothing_changed() -> None:
    vehicle, before = hydro.vehicle("vehicle.toml"), hydro.read("earlier.parquet")
    study = hydro.explain(vehicle, hydro.read("same.parquet"), before=before)
    (step,) = study
    assert step.diagnosis["verdict"].to_list() == ["nothing_missing"]
    assert "no change stands out from the error of the hull-force model" in step.diagnosis["advice"][0]
    assert step.diagnosis.changed
    assert step.diagnosis.headline.startswith("Nothing has changed")
    assert "No change found" in repr(step.diagnosis)
    assert study.ending in repr(study)
    assert study.vehicle == vehicle


@pytest.fixture(scope="module")
def network(work: Path) -> Path:
    """A small network of the recording before, by the commands that a user would give."""
    steps = (
        ("labels", "earlier.parquet", "--vehicle", "vehicle.toml", "-o", "labels.parquet"),
        ("split", "labels.parquet", "-o", "split.parquet"),
        ("train", "split.parquet", "--model", "mlp", "--epochs", "25", "-o", "net.parquet"),
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(work)
        for step in steps:
            assert run(*step) == 0
    return work / "net.parquet"


@pytest.mark.slow
def test_a_network_instead_of_the_regression_names_the_change(
    network: Path, capsys, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python diagnoses the same recording with the same model of the hull: it is computed once."""
    diagnosed: list[tuple[str, Any]] = []
    diagnose = pipeline.diagnose_log

    def once(vehicle: Vehicle, log: Any, *, hull: Any, **others: Any) -> Any:
        asked = repr((vehicle, content_hash(log.raw), hull.given, hull.left, type(hull.law)))
        if not diagnosed or diagnosed[0][0] != asked:
            diagnosed.append((asked, diagnose(vehicle, log, hull=hull, **others)))
        return diagnosed[-1][1]

    monkeypatch.setattr(pipeline, "diagnose_log", once)
    line = ["diagnose", "vehicle.toml", "after.parquet", "--before", "same.parquet"]
    line += ["--model", "net.parquet"]
    assert run(*line, "-o", "diagnosis.parquet") == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "with the network net, which was not trained on it" in told
    made = table.read("diagnosis.parquet", "diagnosis")
    first = made.frame.row(0, named=True)
    assert (first["verdict"], first["effect"]) == ("missing", "thruster_gain")
    assert made.provenance.parameters["before"]["network"] == "net"
    assert "model" in [one.kind for one in made.provenance.inputs]
    known, earlier = hydro.vehicle("vehicle.toml"), hydro.read("same.parquet")
    after, model = hydro.read("after.parquet"), hydro.read_model(network)
    assert hydro.diagnose(known, after, before=earlier, model=model).equals(made.frame)
    assert len(diagnosed) == 1


def test_a_network_trained_on_the_earlier_recording_gives_a_warning(network: Path, capsys) -> None:
    line = ["compare", "vehicle.toml", "after.parquet", "--before", "earlier.parquet"]
    assert run(*line, "--model", "net.parquet", "-o", "compared.parquet") == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "hydro: net.parquet: was trained on earlier.parquet" in told
    assert "with the network net, which was trained on it" in told


@pytest.mark.slow
@pytest.mark.parametrize("command", ["compare", "diagnose", "explain"])
def test_a_network_of_another_vehicle_is_refused_in_one_line(command: str, network: Path, capsys) -> None:
    body = msgspec.structs.replace(damped().rigid_body, mass=91.0)
    hydro.write_vehicle(msgspec.structs.replace(damped(), rigid_body=body), "heavier.toml")
    line = [command, "heavier.toml", "after.parquet", "--before", "earlier.parquet", "--model", "net.parquet"]
    assert run(*line, "-o", "never") == 1
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("hydro: net.parquet: ")
    assert "made with another vehicle file (rigid_body differ)" in told
    assert not list(Path("never").glob("*")) if Path("never").is_dir() else not Path("never").exists()


@pytest.mark.parametrize("command", ["compare", "diagnose", "explain"])
@pytest.mark.parametrize(
    ("more", "code", "words"),
    [
        (["--model", "net.parquet"], 2, "--model needs --before"),
        (["--before", "after.parquet"], 1, "the same rows as the measured recording"),
        (["--before", "nowhere.parquet"], 1, "nowhere.parquet: no such file"),
        (["--before", "vehicle.toml"], 1, "this is a vehicle file"),
        (["--before", "earlier.parquet", "--model", "earlier.parquet"], 1, "but this needs model"),
    ],
)
def test_bad_input_gives_a_one_line_error(command, more, code, words, capsys) -> None:
    assert run(command, "vehicle.toml", "after.parquet", *more, "-o", "never") == code
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert words in told
    assert not Path("never").exists()


def test_a_model_without_before_is_refused_in_python() -> None:
    known, raw = hydro.vehicle("vehicle.toml"), hydro.read("after.parquet")
    for call in (hydro.compare, hydro.diagnose):
        with pytest.raises(UsageError, match="model needs before"):
            call(known, raw, model=object())
