"""Follow "Add an effect" of CONTRIBUTING.md to the letter, in a copy of the package."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import numpy as np
import polars as pl
import pytest

import hydro
from hydro.io import vehicle as vehicles

ROOT = Path(__file__).resolve().parents[1]
SECTION = (ROOT / "CONTRIBUTING.md").read_text().split("## Add an effect")[1].split("\n## ")[0]
KERNEL, RECORD, TEST = (block.group(1) for block in re.finditer(r"```python\n(.*?)```", SECTION, re.DOTALL))
IMPORTS = """
import numpy as np
from bench import equipped, neutral

from hydro.core.effects import assemble
from hydro.core.simulation.simulate import trajectory


"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with the kernel, the record and the test of the page where the page puts them."""
    folder = tmp_path_factory.mktemp("contributor")
    for part in ("hydro", "schemas", "datasets/vehicles"):
        shutil.copytree(ROOT / part, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
    family = folder / "hydro" / "core" / "effects" / "damping.py"
    before, records = family.read_text().split("\n\nEFFECTS = (\n")
    assert records.endswith("\n)\n")
    record = textwrap.indent(textwrap.dedent(RECORD), "    ")
    kernel, records = textwrap.dedent(KERNEL), records.removesuffix(")\n")
    family.write_text(f"{before}\n\n{kernel}\n\nEFFECTS = (\n{records}{record})\n")
    shutil.copy(ROOT / "tests" / "core" / "effects" / "bench.py", folder)
    (folder / "test_cubic.py").write_text(IMPORTS + textwrap.dedent(TEST))
    return folder


def run(copy: Path, *line: object, **environment: str) -> str:
    """What a Python command prints that knows the copy alone."""
    environment = os.environ | {"PYTHONPATH": str(copy), "HYDRO_CACHE_DIR": str(copy / "cache")} | environment
    done = subprocess.run(
        [sys.executable, *map(str, line)],
        cwd=copy,
        env=environment,
        capture_output=True,
        text=True,
        timeout=900,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_section_fits_a_page() -> None:
    assert len(SECTION.splitlines()) < 66


def test_the_catalogue_lists_the_new_effect(copy: Path) -> None:
    told = json.loads(run(copy, "-m", "hydro.cli", "effects", "cubic_damping"))
    assert (told["kind"], told["definition"]) == ("wrench", "-D_C nu_r^3")
    assert told["description"].startswith("Wrench -D_C nu_r^3")
    assert str(copy) in run(copy, "-c", "import hydro; print(hydro.__file__)")


CUBIC = [300.0, 0.0, 0.0, 0.0, 0.0, 0.0]
VEHICLE = (ROOT / "datasets" / "vehicles" / "auv151.toml").read_text()
WITH_EFFECT = f'{VEHICLE}\n[[effect]]\nname = "cubic_damping"\ndiagonal = {CUBIC}\n'
WITH_FORMULA = f'{VEHICLE}\n[[effect]]\nname = "formula"\nforces = ["X u^3"]\nforce = [{-CUBIC[0]}]\n'
"""The same force, of which the program without the new effect knows the formula alone."""
STEPS = """
import pytest
from hydro import cli

assert pytest.main(["-q", "-p", "no:cacheprovider", "test_cubic.py"]) == 0
assert cli.main(["simulate", "cubic.toml", "commands.parquet", "-o", "flown.parquet"]) == 0
"""


@pytest.mark.slow
def test_its_closed_form_holds_and_a_vehicle_file_flies_with_it(copy: Path) -> None:
    """Kernels are interpreted here, which gives the same bits: few steps cost less than compiling them."""
    ahead = {f"cmd_{i + 1}": [0.4 if i < 4 else 0.0] * 100 for i in range(8)}
    commands = pl.DataFrame({"session": ["ahead"] * 100, "t": [0.02 * k for k in range(100)], **ahead})
    commands.write_parquet(copy / "commands.parquet")
    (copy / "cubic.toml").write_text(WITH_EFFECT)
    assert "1 passed" in run(copy, "-c", STEPS, NUMBA_DISABLE_JIT="1")
    flown = pl.read_parquet(copy / "flown.parquet")["u"].to_numpy()
    without, formula = (
        hydro.simulate(vehicles.parse(text), commands)["u"].to_numpy() for text in (VEHICLE, WITH_FORMULA)
    )
    np.testing.assert_allclose(flown, formula, atol=1e-9)
    assert 0.1 < flown[-1] < 0.9 * without[-1]


NOISE = {**dict.fromkeys("xyz", 0.01), **dict.fromkeys("uvw", 0.005)}
"""Standard deviations [m, m/s] of position and velocity; of angles and rates 0.001."""


@pytest.fixture(scope="module")
def recorded(copy: Path) -> Path:
    """26 s at 25 Hz of a vehicle with the formula of the new effect, up to full speed, with noise."""
    t = np.arange(650) * 0.04
    ahead = 0.7 * np.sin(2.0 * np.pi * t / 27.0) * (0.4 + 0.6 * np.sin(2.0 * np.pi * t / 52.0) ** 2)
    commands = {
        f"cmd_{i + 1}": (ahead if i < 4 else 0.0) + 0.3 * np.sin(2.0 * np.pi * t / (5.0 + 1.3 * i) + i)
        for i in range(8)
    }
    rows = pl.DataFrame({"session": ["a"] * len(t), "t": t, **commands})
    motion, rng = hydro.simulate(vehicles.parse(WITH_FORMULA), rows), np.random.default_rng(2)
    motion.with_columns(
        pl.col(name) + NOISE.get(name, 0.001) * rng.standard_normal(len(t))
        for name in motion.columns
        if name not in ("session", "t", *commands)
    ).write_parquet(copy / "measured.parquet")
    return copy


def near_the_truth(values: list[float], errors: list[float]) -> bool:
    """Whether every axis is found within three standard errors."""
    return bool((np.abs(np.array(values) - CUBIC) <= 3.0 * np.array(errors)).all())


@pytest.mark.slow
def test_an_explanation_fits_it_names_it_and_adds_it(recorded: Path) -> None:
    explain = ("explain", "datasets/vehicles/auv151.toml", "measured.parquet", "-o", "study")
    run(recorded, "-m", "hydro.cli", *explain, NUMBA_OPT="1")  # compiling takes most of the time
    first = pl.read_parquet(recorded / "study" / "diagnosis-0.parquet").row(0, named=True)
    assert first["verdict"] in ("missing", "cannot_tell_apart")
    assert first["effect"] == "cubic_damping"
    values, errors = (
        tomllib.loads(f"t = {first[name]}")["t"]["diagonal"] for name in ("parameters", "standard_errors")
    )
    assert near_the_truth(values, errors)
    added = tomllib.loads((recorded / "study" / "vehicle-1.toml").read_text())["effect"]
    assert "cubic_damping" in [table["name"] for table in added]
