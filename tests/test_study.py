"""A study goes on where it stopped: a step is run again only where something it depends on has changed."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from hydro import cli
from hydro.commands.shell import here, message
from hydro.io.table import conform
from hydro.report.seeds import ranking, seeds_together
from hydro.study.models import Recordings, Study, _beside_effects, _rounds
from hydro.study.steps import Runner, Step, StepFailed, apart
from hydro.study.summary import Run

PLAIN = Recordings(Path("raw"), Path("replay"), None, None, "none")


class Copier:
    """A command line `copy FROM TO` that keeps count."""

    def __init__(self) -> None:
        self.ran: list[str] = []

    def main(self, line: list[str], **_options: object) -> None:
        _, source, target = line
        Path(target).write_bytes(Path(source).read_bytes() + b"!")
        self.ran.append(Path(target).name)


@pytest.fixture
def chain(tmp_path):
    """a -> b -> c, and d apart."""
    (tmp_path / "a").write_text("data")
    (tmp_path / "x").write_text("else")

    def step(source: str, target: str) -> Step:
        return Step(
            ("copy", str(tmp_path / source), str(tmp_path / target)),
            (tmp_path / source,),
            (tmp_path / target,),
        )

    return tmp_path, [step("a", "b"), step("b", "c"), step("x", "d")]


def run(chain, workers: int = 1) -> list[str]:
    """What a new process would run."""
    folder, steps = chain
    root = Copier()
    assert Runner(folder, here(root), message).run(steps, workers) == len(root.ran)
    return root.ran


@pytest.mark.parametrize("workers", [2, 5])
def test_side_by_side_no_step_begins_before_what_it_reads_is_there(chain, workers):
    folder, steps = chain
    assert set(run((folder, steps[::-1]), workers)) == {"b", "c", "d"}
    assert (folder / "c").read_text() == "data!!"
    (folder / "b").unlink()
    assert run(chain, workers) == ["b"], "what it made again is what it was"


def test_side_by_side_no_two_steps_hold_one_folder(chain):
    """Commands hold a folder of figures while they run: a second one would be refused."""
    folder, steps = chain
    figures = (folder / "figures",)
    both = [replace(steps[0], holds=figures), replace(steps[2], holds=figures)]
    held, most = list[Step](), list[int]()

    def execute(step: Step) -> None:
        held.append(step)
        most.append(len(held))
        time.sleep(0.05)
        here(Copier())(step)
        held.remove(step)

    assert Runner(folder, execute, message).run(both, 2) == 2
    assert most == [1, 1]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_failure_ends_a_study_and_what_was_made_before_stays(chain, workers):
    folder, steps = chain
    broken = Step(("copy", str(folder / "none"), str(folder / "e")), (folder / "b",), (folder / "e",))
    with pytest.raises(FileNotFoundError):
        Runner(folder, here(Copier()), message).run([steps[0], broken], workers)
    assert run((folder, steps[:1]), workers) == []


def test_what_ran_beside_a_failure_is_not_lost(chain):
    folder, steps = chain
    broken = Step(("copy", str(folder / "none"), str(folder / "e")), (folder / "a",), (folder / "e",))
    with pytest.raises(FileNotFoundError):
        Runner(folder, here(Copier()), message).run([broken, steps[0]], 2)
    assert run((folder, steps[:1])) == []


def test_how_long_it_takes_is_told_by_steps_alike(chain, capsys, monkeypatch):
    folder, steps = chain
    clock = iter([0.0, 50.0, 100.0, 300.0, 300.0, 301.0])
    monkeypatch.setattr("time.perf_counter", lambda: next(clock))
    Runner(folder, here(Copier()), message).run(steps)
    told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("  ")]
    assert told == [
        "  wrote b in 50.0 s; steps left: 2, about 2 min",
        "  wrote c in 200.0 s; steps left: 1, about 2 min",
        "  wrote d in 1.0 s",
    ]
    (folder / "d").unlink()
    monkeypatch.undo()
    assert run(chain) == ["d"]
    assert "2 of 3 steps are done already" in capsys.readouterr().err


def test_what_has_not_changed_is_not_run_again(chain):
    folder, _ = chain
    assert run(chain) == ["b", "c", "d"]
    assert run(chain) == []
    (folder / "a").touch()
    assert run(chain) == [], "the content counts, not the time"
    (folder / "a").write_text("other")
    assert run(chain) == ["b", "c"]
    (folder / "c").unlink()
    assert run(chain) == ["c"]
    (folder / "d").write_text("spoilt")
    assert run(chain) == ["d"]


def test_an_interrupted_study_goes_on(chain):
    folder, steps = chain
    Runner(folder, here(Copier()), message).run(steps[:1])
    assert run(chain) == ["c", "d"]


@pytest.mark.parametrize("text", ["{", '{"a": ' * 20_000 + "1" + "}" * 20_000])
def test_a_broken_ledger_costs_time_only(text, chain, capsys):
    folder, _ = chain
    run(chain)
    (folder / "steps.json").write_text(text)
    assert run(chain) == ["b", "c", "d"]
    assert "every step is run again" in capsys.readouterr().err


def errors(model: str, run: str, value: float, axis: str = "all") -> dict[str, object]:
    return {
        "model": model,
        "variant": "",
        "dataset": "d",
        "axis": axis,
        "metric": "rmse",
        "value": value,
        "low": 0.9 * value,
        "high": 1.1 * value,
        "unit": "N",
        "run": run,
    }


def test_seeds_are_put_together_and_a_single_one_keeps_its_interval():
    table = pl.DataFrame([errors("a", "seed 0", 1.0), errors("a", "seed 1", 3.0), errors("b", "seed 0", 5.0)])
    found = seeds_together(table)
    assert found.equals(conform("metrics", found))
    assert found.select("model", "value", "low", "high").rows() == [
        ("a", 2.0, 1.0, 3.0),
        ("b", 5.0, 4.5, 5.5),
    ]


def test_ranking_counts_a_diverged_flight_as_the_worst():
    predicted = pl.DataFrame([errors(name, "seed 0", k + 1.0) for k, name in enumerate("abc")])
    replayed = pl.DataFrame([errors("a", "seed 0", 0.1), errors("b", "seed 0", 0.2)])
    found = ranking(predicted, replayed).filter(pl.col("metric") == "kendall_tau")
    assert found.select("axis", "value").rows() == [("all", pytest.approx(1.0))]
    assert ranking(predicted.head(2), replayed).is_empty()


def test_every_model_gets_its_first_seed_before_any_gets_its_second():
    rounds = _rounds(Study(Path("out"), PLAIN, models=("mlp", "moe"), seeds=2, minutes=(1.0, 3.0)))
    names = [[run.name for run in runs] for runs in rounds]
    assert names[:2] == [["mlp-seed0", "moe-seed0"], ["mlp-seed1", "moe-seed1"]]
    assert names[2] == ["mlp-seed0-1min", "moe-seed0-1min", "mlp-seed0-3min", "moe-seed0-3min"]
    assert [len(runs) for runs in _rounds(Study(Path("out"), PLAIN, models=("mlp",), seeds=3))] == [1, 1, 1]


def test_names_tell_runs_apart():
    assert Run("mlp", 2).name == "mlp-seed2"
    assert (Run("mlp", 0, 3.0).name, Run("mlp", 0, 3.0).label) == ("mlp-seed0-3min", "seed 0, 3 min")


def test_a_network_beside_effects_learns_what_they_leave_and_flies_with_them():
    data = Recordings(Path("raw"), Path("replay"), Path("test"), None, "dvl", Path("fitted.toml"))
    labels, _, train, replay = _beside_effects(Study(Path("out"), data, epochs=2))
    assert labels.line[1] == "out/noisy.parquet"
    assert {"--subtract", "effects", "--noise", "dvl", "fitted.toml"} <= set(labels.line)
    assert labels.reads == (Path("out/noisy.parquet"), Path("fitted.toml"))
    assert train.line[-4:] == ("--epochs", "2", "-o", "out/models/beside-effects.parquet")
    assert [replay.line[k + 1] for k, word in enumerate(replay.line) if word == "--variant"] == [
        "effects",
        "effects+MJ4",
    ]
    assert _beside_effects(Study(Path("out"), PLAIN)) == []


def test_a_step_that_fails_in_its_own_process_ends_the_study_with_its_exit_code(capfd):
    with pytest.raises(StepFailed, match="hydro labels no-such-file") as told:
        apart(Step(("labels", "no-such-file", "-o", "x"), (), ()))
    assert told.value.exit_code == 1
    assert "no-such-file" in capfd.readouterr().err


def test_noise_needs_data_without_to_test_on(tmp_path, capsys):
    line = ["study", "models", "raw.parquet", "--replay", "raw.parquet", "--noise", "dvl"]
    assert cli.main([*line, "-o", str(tmp_path / "study")]) == 2
    assert "--noise needs --test" in capsys.readouterr().err


def test_an_unknown_model_is_refused(tmp_path, capsys):
    line = ["study", "models", "raw.parquet", "--replay", "raw.parquet", "--model", "gpt"]
    assert cli.main([*line, "-o", str(tmp_path / "study")]) == 2
    assert "no model is called 'gpt'" in capsys.readouterr().err
    assert not (tmp_path / "study").exists()
