"""`hydro rl`: training, flights in both simulators, pictures and the study, on episodes of ten steps."""

from __future__ import annotations

import importlib.util
import os
import re
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from terminal import fits, on_terminal

from hydro import cli
from hydro.io import table
from hydro.sim import film
from hydro.study import policies

ROOT = Path(__file__).resolve().parents[1]
VEHICLE = str(ROOT / "datasets" / "vehicles" / "auv151.toml")
EXAMPLES = {
    re.search(r"hydro rl (\w+)", line)[1]: line
    for family in cli.FAMILIES
    if family.NAME == "rl"
    for line in family.COMMANDS.values()
}
SMALL = [
    word
    for choice in (
        *("vehicles=4", "record=40", "evaluate=80", "episodes=3"),
        *("sac.random=40", "sac.batch=16", "sac.layers=[16]", "settings.task.steps=10", "pilot=0"),
    )
    for word in ("--set", choice)
]


def rl(*arguments: object) -> int:
    return cli.main(["rl", *map(str, arguments)])


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A training of two evaluations."""
    folder = tmp_path_factory.mktemp("rl") / "run"
    assert rl("train", VEHICLE, "--steps", 160, *SMALL, "-o", folder) == 0
    return folder


def test_training_refuses_a_vehicle_that_the_scripted_pilot_cannot_steer(
    tmp_path: Path, datasets: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """REMUS 100 with its weak tunnel thrusters reaches about half of the goals of open water in time."""
    vehicle, folder = datasets / "vehicles" / "remus100.toml", tmp_path / "no"
    assert rl("train", vehicle, "--steps", 160, *SMALL[:-4], "-o", folder) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert re.search(r"remus100.toml: the scripted pilot with a map reaches \d\d ?% of the goals", said)
    assert "--set pilot=0" in said
    assert not folder.exists()


@pytest.mark.parametrize("name", ["train", "eval", "watch", "curves", "study"])
def test_help_has_a_paragraph_and_an_example(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert rl(name, "--help") == 0
    text = capsys.readouterr().out
    assert f"Usage: hydro rl {name}" in text
    assert EXAMPLES[name] in " ".join(text.replace("\\\n", " ").split())


def test_training_prints_its_settings_and_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rl("train", VEHICLE, "--steps", 80, *SMALL, "-o", tmp_path / "run") == 0
    told = capsys.readouterr()
    assert told.out == ""
    assert re.search(r"sac\.batch +16", told.err)
    assert re.search(
        r"paper: 80 steps, \d+ SAC updates, \d+ steps/s, point_to_point, success 0%, at most 0 min left; "
        r"without exploration 0% of 3",
        told.err,
    )
    assert "continue with more --steps" in told.err
    assert "the paper does not state, chosen here: sac.layers" in told.err
    assert rl("train", VEHICLE, "--steps", 160, *SMALL, "-o", tmp_path / "run") == 0
    assert "resumes after 80 steps" in capsys.readouterr().err
    steps = table.read(tmp_path / "run" / "curves.parquet").frame["steps"]
    assert steps.to_list() == [40, 80, 120, 160]


def test_an_old_option_value_works_with_a_warning(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = ["train", VEHICLE, "--steps", 80, *SMALL, "-o", tmp_path / "run"]
    assert rl(*line, "--set", "ladder.ready=0.8") == 0
    told = capsys.readouterr().err
    assert told.count("--set ladder.ready is called curriculum.ready now") == 1
    assert re.search(r"curriculum\.ready +0\.8", told)


def test_every_table_passes_its_schema_and_records_its_inputs(
    run: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in sorted(run.glob("*.parquet")):
        assert cli.main(["check", str(path)]) == 0
    capsys.readouterr()
    assert cli.main(["show", str(run / "policy.parquet")]) == 0
    assert "vehicle" in capsys.readouterr().out


def test_a_training_can_start_from_another_and_records_it(run: Path, tmp_path: Path) -> None:
    line = ["train", VEHICLE, "--condition", "R_0", "--start", run, *SMALL, "-o", tmp_path / "on"]
    assert rl(*line, "--steps", 80) == 0
    origin = table.read(run / "policy.parquet", "policy").provenance.content
    inputs = table.read(tmp_path / "on" / "run.parquet", "run").provenance.inputs
    assert ("policy", origin) in [(each.kind, each.content) for each in inputs]
    assert rl(*line, "--steps", 160) == 0


@pytest.mark.parametrize("simulator", ["student", "teacher"])
def test_a_policy_is_tested_in_both_simulators(run: Path, tmp_path: Path, simulator: str) -> None:
    out, details = tmp_path / "result.parquet", tmp_path / "episodes.parquet"
    assert rl("eval", run, "--in", simulator, "--episodes", 5, "--details", details, "-o", out) == 0
    result, episodes = table.read(out, "evaluations").frame, table.read(details, "episodes").frame
    assert result.select("flown_by", "plant", "purpose", "episodes", "steps").rows() == [
        ("policy", simulator, "test", 5, 160),
        ("helmsman", simulator, "test", 5, 0),
    ]
    assert episodes.height == 5
    assert result["success"][0] == (episodes["outcome"] == "success").mean()
    again = tmp_path / "again.parquet"
    assert rl("eval", run, "--in", simulator, "--episodes", 5, "-o", again) == 0
    assert again.read_bytes() == out.read_bytes()


def test_eval_of_a_vehicle_file_tests_the_scripted_pilot(tmp_path: Path) -> None:
    out = tmp_path / "pilot.parquet"
    assert rl("eval", VEHICLE, "--stage", 3, "--level", 8, "--episodes", 3, "-o", out) == 0
    blind, row = table.read(out, "evaluations").frame.rows(named=True)
    assert (blind["flown_by"], blind["success"]) == ("helmsman", 0.0)
    assert (row["flown_by"], row["task"], row["level"]) == ("helmsman with map", "forest", 8)
    assert row["success"] == 1.0
    assert 0.0 < row["tracking_error"] < 0.5


def test_settings_are_tested_with_the_pilot(run: Path, tmp_path: Path) -> None:
    """Without a covariance there is no posterior, and in open water no plan to leave out."""
    out = tmp_path / "settings.parquet"
    assert rl("eval", run, "--setting", "all", "--episodes", 3, "-o", out) == 0
    result = table.read(out, "evaluations").frame
    settings = ["nominal", "current", "load", "dead_thruster", "half_time"]
    assert result["setting"].unique(maintain_order=True).to_list() == settings
    assert result["flown_by"].to_list() == ["policy", "helmsman"] * len(settings)
    assert result.filter(flown_by="helmsman")["reward"].n_unique() == len(settings)


def test_the_setting_no_plan_leaves_out_plan_and_map(tmp_path: Path) -> None:
    out = tmp_path / "planless.parquet"
    line = ["eval", VEHICLE, "--task", "forest", "--level", 8, "--setting", "no_plan", "--episodes", 3]
    assert rl(*line, "-o", out) == 0
    (row,) = table.read(out, "evaluations").frame.rows(named=True)
    assert (row["flown_by"], row["setting"], row["success"]) == ("helmsman", "no_plan", 0.0)


def test_truth_tests_the_policy_in_another_vehicle(tmp_path: Path, datasets: Path) -> None:
    """A vehicle with three times the drag arrives later than the file says."""
    slow = tmp_path / "slow.toml"
    slow.write_text(Path(VEHICLE).read_text().replace("diagonal = [95.0,", "diagonal = [300.0,"))
    times = []
    for truth in ([], ["--truth", slow]):
        out = tmp_path / "truth.parquet"
        assert rl("eval", VEHICLE, "--episodes", 4, *truth, "-o", out) == 0
        times.append(table.read(out, "evaluations").frame["time_to_goal"].item())
    assert times[1] > times[0] + 0.2
    five = datasets / "vehicles" / "remus100.toml"
    assert rl("eval", VEHICLE, "--truth", five, "--episodes", 1, "-o", tmp_path / "x") == 2


def test_posterior_draws_vehicles_from_the_covariance(tmp_path: Path) -> None:
    """The run keeps a copy, from which its policy is tested."""
    from hydro.core.simulation.estimates import Estimate, Estimates
    from hydro.io import covariance

    vehicle = tmp_path / "vehicle.toml"
    vehicle.write_text(Path(VEHICLE).read_text())
    drag = Estimate("quadratic_damping", "diagonal", (0,), "kg/m", 95.0)
    covariance.write(
        Estimates((drag,), covariance=pl.DataFrame({"a": [100.0]}).to_numpy()),
        vehicle,
        stage="fit",
        inputs=[],
        vehicle_text=vehicle.read_text(),
    )
    run = tmp_path / "run"
    line = ["train", vehicle, "--steps", 80, "--randomise", "posterior", "--randomise", "current=0.2"]
    assert rl(*line, *SMALL, "-o", run) == 0
    assert (run / "covariance.parquet").exists()
    out = tmp_path / "drawn.parquet"
    assert rl("eval", run, "--setting", "posterior", "--no-pilot", "--episodes", 3, "-o", out) == 0
    assert table.read(out, "evaluations").frame["setting"].to_list() == ["posterior"]


def test_a_single_task_can_be_trained(tmp_path: Path) -> None:
    line = ["train", VEHICLE, "--task", "station-keeping", "--steps", 80, *SMALL, "-o", tmp_path / "run"]
    assert rl(*line) == 0
    found = table.read(tmp_path / "run" / "evaluations.parquet", "evaluations").frame
    assert set(found["task"]) == {"station_keeping"}


def test_no_pilot_tests_the_policy_alone(run: Path, tmp_path: Path) -> None:
    out = tmp_path / "alone.parquet"
    assert rl("eval", run, "--no-pilot", "--episodes", 3, "-o", out) == 0
    assert table.read(out, "evaluations").frame["flown_by"].to_list() == ["policy"]


def test_the_result_of_eval_fits_a_terminal(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(run.parent)
    text = on_terminal(["rl", "eval", run.name, "--episodes", "3"], 80, monkeypatch)
    assert "success" in text
    assert fits(text), text


def test_watch_and_curves_write_pictures(run: Path, tmp_path: Path) -> None:
    assert rl("watch", run, "--stage", 3, "--level", 8, "-o", tmp_path / "flight.png") == 0
    assert rl("curves", run, run, "-o", tmp_path / "curves.png") == 0
    for name in ("flight.png", "curves.png"):
        assert (tmp_path / name).read_bytes().startswith(b"\x89PNG")


@pytest.mark.skipif(
    "MUJOCO_GL" not in os.environ or importlib.util.find_spec("imageio_ffmpeg") is None,
    reason="films need MUJOCO_GL and imageio-ffmpeg",
)
def test_watch_writes_a_film(run: Path, tmp_path: Path) -> None:
    assert rl("watch", run, "-o", tmp_path / "flight.mp4") == 0
    assert b"ftyp" in (tmp_path / "flight.mp4").read_bytes()[:32]


def test_a_film_of_two_runs_shows_the_same_tasks_as_long_as_they_fit(
    run: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    monkeypatch.setattr(film, "film", lambda panels, *_, **__: shown.extend(panels))
    line = ["watch", run, "--beside", run, "--seconds", 4.5, "--in", "kernels", "-o", tmp_path / "two.mp4"]
    assert rl(*line) == 0
    first, second = shown
    lasting = [len(flown.pose) * flown.period + film.HOLD for flown in first.flights]
    assert len(lasting) == 3, f"3 of {lasting} fit into 4.5 s"
    starts = np.array([flown.pose[0] for flown in first.flights])
    assert len(np.unique(starts[:, 0])) == 3, "three tasks"
    assert (starts == [flown.pose[0] for flown in second.flights]).all()
    assert f"{run.name} arrived in 0 of 3 tasks" in " ".join(capsys.readouterr().err.split())


def test_a_picture_of_two_runs_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert rl("watch", run, "--beside", run, "-o", tmp_path / "two.png") == 2
    assert "name an .mp4" in capsys.readouterr().err


def test_a_study_runs_possible_conditions_and_names_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = ["study", VEHICLE, "--seeds", 1, "--stages", 1, "--steps", 80, "--episodes", 3, *SMALL]
    line += [word for name in ("R_effects", "R_MLP", "R_identified") for word in ("--condition", name)]
    assert rl(*line, "-o", tmp_path) == 0
    told = capsys.readouterr().err
    assert "not run: R_MLP, for want of its residual model" in told
    assert "not run: R_identified, for want of a file" in told
    tests = table.read(tmp_path / "tests.parquet", "evaluations").frame
    assert tests.select("flown_by", "plant").rows() == [
        (who, simulator) for simulator in policies.SIMULATORS for who in ("policy", "helmsman")
    ]
    assert set(tests["condition"]) == {"R_effects"}
    assert (tmp_path / "curves.png").exists()
    assert rl(*line, "-o", tmp_path) == 0
    assert "0 of 5 steps run" in capsys.readouterr().err


def test_a_study_trains_with_the_identified_file_and_tests_in_the_simulator_of_its_vehicle(
    tmp_path: Path,
) -> None:
    identified = tmp_path / "identified.toml"
    study = policies.Study(tmp_path, Path(VEHICLE), identified=identified, seeds=2, stages=2)
    runs, left = policies.runs(study)
    assert [run.condition for run in runs] == ["R_0", "R_0+M_A", "R_effects", "R_identified"] * 2
    assert len(left) == 3
    of_it = tmp_path / "R_identified-seed0"
    training, *flights = (step for step in policies.steps(study, runs) if of_it in step.writes[0].parents)
    assert training.line[:3] == ("rl", "train", str(identified))
    assert training.reads == (identified,)
    assert [step.writes[0].name for step in flights] == [
        f"{simulator}-{stage}.parquet" for simulator in policies.SIMULATORS for stage in (1, 2)
    ]
    for step in flights:
        in_teacher = "teacher" in step.line
        assert step.line.count("--truth") == step.reads.count(Path(VEHICLE)) == in_teacher
        assert ("--pilot" in step.line) != in_teacher


@pytest.mark.parametrize(
    ("line", "told", "code"),
    [
        (("train", VEHICLE, "--set", "sac.size=3", "-o", "x"), "no choice is called 'sac.size'", 2),
        (("train", VEHICLE, "--set", "sac.batch", "-o", "x"), "give a name and a value", 2),
        (("train", VEHICLE, "--condition", "R_1", "-o", "x"), "there is no condition 'R_1'", 2),
        (("train", VEHICLE, "--condition", "R_MLP", "-o", "x"), "needs a residual model", 2),
        (("train", VEHICLE, "--start", "nowhere", "-o", "x"), "nowhere", 1),
        (
            ("train", VEHICLE, "--task", "dock", "-o", "x"),
            "there is no task 'dock': choose one of docking",
            2,
        ),
        (("train", VEHICLE, "--randomise", "much", "-o", "x"), "give posterior, a share such as 0.2", 2),
        (("train", VEHICLE, "--randomise", "posterior", "-o", "x"), "no covariance of its numbers", 2),
        (("train", VEHICLE, "--randomise", "wind=1", "-o", "x"), "no choice is called", 2),
        (
            ("train", VEHICLE, "--condition", "R_0", "--randomise", "0.2", "-o", "x"),
            "R_0 ignores the parameters",
            2,
        ),
        (("eval", VEHICLE, "--setting", "storm", "-o", "x"), "there is no setting 'storm'", 2),
        (("eval", VEHICLE, "--setting", "no_plan", "-o", "x"), "needs a planned path", 2),
        (("eval", VEHICLE, "--task", "slalom", "--stage", "2", "-o", "x"), "give one of them", 2),
        (("eval", VEHICLE, "--task", "slalom", "--level", "9", "-o", "x"), "choose 0 to 4", 2),
        *(
            (("train", VEHICLE, "--set", choice, "-o", "x"), f"{choice.split('=')[0]} is", 2)
            for choice in (
                *("sac.batch=0", "sac.capacity=-1", "sac.layers=[16,0]", "sac.horizon=0", "sac.rate=0"),
                *("sac.average=0", "sac.discount=1.5", "sac.random=-1", "vehicles=0", "episodes=0"),
            )
        ),
        (("eval", "nowhere", "-o", "x.parquet"), "nowhere", 1),
        (("eval", "nowhere.toml", "-o", "x.parquet"), "nowhere.toml: no such file", 1),
        (("watch", "nowhere", "-o", "x.gif"), "name a .png for a picture", 2),
        (("curves", "nowhere", "-o", "x.png"), "nowhere", 1),
        (("study", VEHICLE, "--condition", "R_MLP", "-o", "x"), "add --model FILE", 2),
        (("study", VEHICLE, "--condition", "R_1", "-o", "x"), "no condition is called 'R_1'", 2),
    ],
)
def test_mistakes_give_one_line_errors(
    line: tuple[str, ...],
    told: str,
    code: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert rl(*line) == code
    err = capsys.readouterr().err
    assert told in err
    assert err.startswith("hydro: ")
    assert err.count("\n") == 1
    assert not any(tmp_path.iterdir()), "what is refused leaves nothing behind"


def test_curves_are_means_over_seeds_that_keep_their_last_value() -> None:
    from hydro.report.training import curves_table

    def points(seed: int, successes: list[float]) -> list[dict[str, object]]:
        return [
            {
                "condition": "R_0",
                "seed": seed,
                "steps": 10 * (k + 1),
                "purpose": "curve",
                "success": s,
                "reward": 2 * s,
            }
            for k, s in enumerate(successes)
        ]

    rows = [*points(0, [0.0, 0.5, 1.0]), *points(1, [0.2, 1.0])]
    found = curves_table(pl.DataFrame(rows))
    assert found["steps"].to_list() == [10, 20, 30]
    assert found["success"].to_list() == pytest.approx([0.1, 0.75, 1.0])
    assert found["success_sd"].to_list() == pytest.approx([0.2 / 2**0.5, 0.5 / 2**0.5, 0.0])
    assert found["seeds"].to_list() == [2, 2, 2]
