"""Asking for help loads nothing heavy: what is loaded is counted, for timing depends on the machine."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

HEAVY = (
    "numpy",
    "polars",
    "pyarrow",
    "numba",
    "scipy",
    "torch",
    "mujoco",
    "matplotlib",
    "filterpy",
    "msgspec",
    "rich",
)


@pytest.mark.parametrize("arguments", [["--help"], ["labels", "--help"], ["replay", "--help"], ["--version"]])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    script = (
        f"import sys; from hydro.cli import main; code = main({arguments}); "
        "print(*sys.modules, file=sys.stderr); sys.exit(code)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    loaded = {name.split(".")[0] for name in done.stderr.split()}
    assert "typer" in loaded
    assert not loaded & set(HEAVY)
    assert done.stdout


@pytest.mark.parametrize(("command", "threads"), [("labels", "1"), ("train", "None")])
def test_linear_algebra_has_one_thread_but_where_it_trains(command: str, threads: str) -> None:
    script = (
        f"import os; from hydro.cli import main; main(['{command}', '--help']); "
        "print(os.environ.get('OPENBLAS_NUM_THREADS'))"
    )
    free = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, env=free
    )
    assert done.stdout.splitlines()[-1] == threads


def test_importing_hydro_loads_nothing_heavy_and_offers_its_functions() -> None:
    script = "import sys, hydro; print(*sys.modules); print(*hydro.__all__, file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert not {name.split(".")[0] for name in done.stdout.split()} & set(HEAVY)
    assert {"read", "write", "vehicle", "labels", "split", "train", "evaluate", "replay"} <= set(
        done.stderr.split()
    )
