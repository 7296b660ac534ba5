"""The benchmarks run and write what they say; their figures are not judged here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import polars as pl

ROOT = Path(__file__).resolve().parents[1]
ENGINES = ("mujoco", "kernels")


def run(*arguments):
    done = subprocess.run(
        [sys.executable, *map(str, arguments)], cwd=ROOT, text=True, capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_speed_beside_bare_mujoco(tmp_path):
    printed = run("benchmarks/student.py", "--quick", "-o", tmp_path / "rows.parquet")
    rows = pl.read_parquet(tmp_path / "rows.parquet")
    many = rows.filter(pl.col("what") == "batch")
    assert many.select("vehicles", "threads", "case").rows() == [
        (count, threads, case)
        for count in (1, 8)
        for threads in (1, 2)
        for case in ("bare", "effects", "network", "both")
    ]
    assert set(rows["what"]) == {"batch", "loop", "simulate", "teacher"}
    assert rows["per_second"].min() > 0
    assert (rows["ratio_low"] <= rows["ratio"]).all()
    assert (many.filter(pl.col("case") == "bare")["ratio"] == 1.0).all()
    assert "| quadratic drag in Python |" in printed


def test_accuracy_over_integrators_and_steps(tmp_path):
    run("benchmarks/accuracy.py", "--quick", "-o", tmp_path / "table.parquet", "--plot", tmp_path / "a.png")
    table = pl.read_parquet(tmp_path / "table.parquet")
    errors = {
        name: rows.sort("step")["velocity_error"].to_numpy() for (name,), rows in table.group_by("integrator")
    }
    assert set(errors) == {"euler", "implicitfast", "rk4"}
    assert all((error[1:] > error[:-1]).all() for error in errors.values()), "a longer step is less true"
    assert errors["rk4"].max() < 1e-6 < 1e-5 < min(errors["euler"].min(), errors["implicitfast"].min())
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")


def test_environment_beside_bare_mujoco(tmp_path):
    printed = run("benchmarks/environment.py", "--quick", "-o", tmp_path / "rows.parquet")
    rows = pl.read_parquet(tmp_path / "rows.parquet")
    cases = [
        f"{name}, {engine}" for name in ("R_0", "R_effects", "R_MLP", "R_PhysFeat") for engine in ENGINES
    ]
    assert rows.select("vehicles", "case").rows() == [(n, case) for n in (8, 64) for case in ("bare", *cases)]
    assert (rows["per_second"] > 0).all()
    assert printed.count("| sonar and observations |") == 4


def test_without_a_gpu_its_benchmark_ends_in_one_line():
    done = subprocess.run(
        [sys.executable, "benchmarks/gpu.py"],
        cwd=ROOT,
        env={**os.environ, "NUMBA_ENABLE_CUDASIM": "0", "CUDA_VISIBLE_DEVICES": ""},
        text=True,
        capture_output=True,
        check=False,
    )
    assert done.returncode == 1
    assert done.stderr.startswith("error: numba-cuda ")
    assert done.stderr.count("\n") == 1


def test_of_several_trainings_the_median_one_is_told_with_the_range_of_all():
    from benchmarks.policies import by_setting, by_task

    told = {"task": "slalom", "level": 4, "setting": "nominal", "episodes": 200, "plant": "teacher"}
    told |= {"success_low": 0.8, "success_high": 0.9, "tracking_error": 0.3, "energy": 6.0, "steps": 1}

    def flown(by, seed, success):
        own = {"flown_by": by, "condition": "R_effects", "seed": seed, "success": success}
        return told | own | {"collision": 1.0 - success, "time_to_goal": 20.0 + seed}

    policies = [flown("policy", seed, share) for seed, share in enumerate((0.9, 0.5, 0.7))]
    found = pl.DataFrame(policies + [flown("helmsman", seed, 1.0) for seed in range(3)])
    policy, pilot = by_task(found, {"slalom": "baffles"})
    assert policy["flown by"] == "R_effects"
    assert policy["in the teacher"].startswith("70% (80.0 to 90.0) [50 to 90], 22.0 s, "), "that of seed 2"
    assert pilot["in the teacher"].startswith("100% (80.0 to 90.0), 20.0 s"), "who learns nothing has one"
    words = [row["nominal"] for row in by_setting(found, {})]
    assert words == ["70% (80.0 to 90.0) [50 to 90], 22.0 s", "100% (80.0 to 90.0), 20.0 s"]
    pair = found.filter(pl.col("flown_by") == "policy").head(2)
    assert by_setting(pair, {})[0]["nominal"].startswith("50% (80.0 to 90.0) [50 to 90]"), "of two the worse"


def test_a_study_is_told_by_task_and_condition_beside_the_pilots_of_each_world():
    from benchmarks.paper_study import flights

    def flown(by, condition, plant, success, seed=0):
        told = {"task": "forest", "level": 12, "flown_by": by, "condition": condition, "plant": plant}
        told |= {"success_low": 0.8, "success_high": 0.9, "tracking_error": 0.3, "energy": 6.0, "seed": seed}
        return told | {"success": success, "collision": 0.0, "time_to_goal": 20.0}

    rows = [flown("helmsman with map", "R_0", "teacher", 1.0), flown("helmsman", "R_0", "teacher", 0.5)]
    for condition, pilot in (("R_0", 0.9), ("R_MLP", 0.8)):
        rows.append(flown("helmsman", condition, "student", 0.25))
        rows.append(flown("helmsman with map", condition, "student", pilot))
        rows += [flown("policy", condition, "student", share, k) for k, share in enumerate((1.0, 0.6, 0.7))]
        rows += [flown("policy", condition, "teacher", share, k) for k, share in enumerate((0.4, 0.6, 0.7))]
    found = flights(pl.DataFrame(rows), {"forest": "pillars"})
    assert [row["flown by"] for row in found] == [
        "helmsman with map",
        "helmsman",
        "policies of R_0",
        "policies of R_MLP",
    ]
    assert {row["task"] for row in found} == {"forest, 12 pillars"}
    assert found[0]["in the teacher"].startswith("100% (80.0 to 90.0), 20.0 s")
    of_mlp = found[-1]
    assert of_mlp["in the teacher"].startswith("60% (80.0 to 90.0) [40 to 70]")
    assert of_mlp["in their student"].startswith("70% (80.0 to 90.0) [60 to 100]")
    assert of_mlp["pilot by hand, in their student"].startswith("80%"), "that with a map, in their own world"
