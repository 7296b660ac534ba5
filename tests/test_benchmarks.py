"""The benchmarks run and write what they say; their figures are not judged here."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import polars as pl

ROOT = Path(__file__).resolve().parents[1]


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
    assert rows["case"].to_list() == ["bare", "R_0", "R_MLP", "R_PhysFeat", "R_effects"]
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
