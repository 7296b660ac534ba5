"""Tables of trainings that benchmarks make with commands of their own."""

from __future__ import annotations

import sys

import polars as pl
import pytest

from benchmarks import ablations, commands, posterior
from hydro.rl.training.config import RECIPES
from hydro.rl.training.runs import changed


def test_a_command_is_run_once_and_its_time_is_kept(tmp_path, monkeypatch):
    ran: list[list[str]] = []

    class Process:
        def __init__(self, line, env):
            ran.append(line)
            self.pid, self.returncode = 7, None

        def __enter__(self):
            return self

        def __exit__(self, *_):
            return None

    used = type("Used", (), {"ru_utime": 12.34, "ru_stime": 0.5})
    monkeypatch.setattr(commands.subprocess, "Popen", Process)
    monkeypatch.setattr(commands.os, "wait4", lambda *_: (7, 0, used))
    out = tmp_path / "runs" / "one-0"
    assert commands.made(["rl", "train"], out)
    assert not commands.made(["rl", "train"], out)
    assert ran == [[sys.executable, "-m", "hydro", "rl", "train", "-o", str(out)]]
    assert commands.seconds(out) == pytest.approx(12.8)


def test_a_command_that_fails_ends_the_program_and_leaves_no_time(tmp_path, capfd):
    with pytest.raises(SystemExit):
        commands.made(["check", "nowhere.parquet"], tmp_path / "out")
    assert "hydro" in capfd.readouterr().err
    assert not commands.beside(tmp_path / "out").exists()


def test_variants_are_told_by_medians_and_who_has_not_passed_counts_as_the_last_step():
    row = ablations.row("all of it", [(40_000, 60.0), (None, 300.0), (20_000, 30.0)])
    assert row["passed"] == "2 of 3"
    assert row["steps until then"] == "40,000 (20,000 to 200,000)"
    assert row["processor time"] == "1.0 min (0.5 to 5.0)"


def test_every_variant_takes_back_what_it_says():
    made = {
        name: changed(RECIPES["imitation"], dict(one.split("=") for one in (*ablations.PLAIN, *choices)))
        for name, choices in ablations.VARIANTS.items()
    }
    whole, bare = made["all of it"], made["none of it"]
    assert (whole.clone, whole.corrections, whole.demonstrations, whole.sac.norm) == (0, 0, 40, True)
    assert made["without demonstrations"].demonstrations == bare.demonstrations == 0
    assert not made["without layer normalisation"].sac.norm
    assert made["256 wide, not 128"].sac.layers == bare.sac.layers == (256, 256)
    assert made["batches of 512, not 256"].sac.batch == bare.sac.batch == 2 * whole.sac.batch
    assert len({repr(one) for one in made.values()}) == len(made)


def test_flights_of_a_study_are_told_by_who_flew_and_where():
    flight = {
        "task": "forest", "flown_by": "policy", "plant": "teacher", "setting": "dead_thruster", "seed": 0,
        "success": 0.9, "success_low": 0.8, "success_high": 0.95, "collision": 0.0, "time_to_goal": 17.0,
    }  # fmt: skip
    better, pilot = {"seed": 1, "success": 1.0}, {"flown_by": "helmsman", "trained": ""}
    found = [flight | {"trained": "its values"}, flight | better | {"trained": "its values"}, flight | pilot]
    rows = posterior.by_flyer(found)
    assert [row["flown by"] for row in rows] == ["policy trained on its values", "helmsman"]
    assert rows[0]["teacher, dead thruster"] == "90% (80.0 to 95.0) [90 to 100], 17.0 s"
    assert pl.DataFrame(rows).columns == ["flown by", "teacher, dead thruster"]
