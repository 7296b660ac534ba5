"""Commands without the packages of an extra: they work, or one line names the extra."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from tables import shorten

ROOT = Path(__file__).resolve().parents[1]
HIDDEN = ROOT / "datasets" / "hidden"
WITHOUT = """
import sys

HIDDEN = {"torch", "torchrl", "tensordict", "gymnasium"}


class Without:
    def __init__(self, finder):
        self.finder = finder

    def __getattr__(self, name):
        return getattr(self.finder, name)

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] not in HIDDEN:
            return self.finder.find_spec(name, path, target)


sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
from hydro.cli import main

sys.exit(main(sys.argv[1:]))
"""


def without(*arguments: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a process that cannot import torch, torchrl, tensordict and gymnasium."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    line = [sys.executable, "-c", WITHOUT, *map(str, arguments)]
    return subprocess.run(line, cwd=cwd, env=environment, capture_output=True, text=True, timeout=300)


def test_models_are_compared_and_exported_without_torch(tmp_path: Path) -> None:
    shutil.copytree(HIDDEN, tmp_path / "hidden")
    shorten(tmp_path / "hidden", 10.0, sessions=2)
    vehicle, measured = (tmp_path / "hidden" / name for name in ("vehicle.toml", "measured.parquet"))
    compared = without("compare", vehicle, measured, "-o", tmp_path / "errors.parquet", cwd=tmp_path)
    assert compared.returncode == 0, compared.stderr
    exported = without("export", vehicle, "--to", "mujoco", "-o", tmp_path / "model.xml", cwd=tmp_path)
    assert exported.returncode == 0, exported.stderr


@pytest.mark.parametrize(
    ("arguments", "extra", "package"),
    [
        (("train", "split.parquet", "-o", "model.parquet"), "learn", "torch"),
        (("rl", "curves", "run", "-o", "curves.png"), "rl", "gymnasium"),
    ],
)
def test_a_command_without_its_packages_names_the_extra(
    arguments: tuple[str, ...], extra: str, package: str, tmp_path: Path
) -> None:
    done = without(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr == (
        f"hydro: {package} is not installed: install hydro's extra `{extra}`: "
        f"pip install 'deep-hydro-sim[{extra}]'\n"
    )
