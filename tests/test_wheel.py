"""The wheel holds everything: installed alone, outside the checkout, it checks its own bundled data."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

WHERE = """
import hydro, json
from hydro.io import schema
raw = [field.name for field in schema.load("raw").fields]
print(json.dumps({"hydro": hydro.__file__, "schemas": str(schema.FOLDER), "raw": raw}))
"""


def run(*line: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command outside the checkout, without its paths in the environment."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    return subprocess.run(
        [str(part) for part in line], cwd=cwd, env=environment, capture_output=True, text=True, timeout=300
    )


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A virtual environment with the wheel alone; a path file lets it see the other packages of this one."""
    folder = tmp_path_factory.mktemp("wheel")
    built = run(
        sys.executable,
        "-m",
        "build",
        "--wheel",
        "--no-isolation",
        "--outdir",
        folder / "dist",
        ROOT,
        cwd=folder,
    )
    assert built.returncode == 0, built.stdout + built.stderr
    (wheel,) = (folder / "dist").glob("*.whl")
    venv.create(folder / "venv", with_pip=False)
    python = folder / "venv" / "bin" / "python"
    pip = (sys.executable, "-m", "pip", "--python", python, "install", "--quiet", "--no-deps", "--no-index")
    done = run(*pip, wheel, cwd=folder)
    assert done.returncode == 0, done.stderr
    site = run(
        python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))", cwd=folder
    ).stdout.strip()
    (Path(site) / "neighbours.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder / "venv"


@pytest.mark.slow
def test_the_wheel_alone_checks_its_bundled_data(installed: Path, tmp_path: Path) -> None:
    where = json.loads(run(installed / "bin" / "python", "-c", WHERE, cwd=tmp_path).stdout)
    package = Path(where["hydro"]).parent
    assert package.is_relative_to(installed)
    version = run(installed / "bin" / "hydro", "--version", cwd=tmp_path)
    assert re.search(r"\d+\.\d+\.\d+", version.stdout), version.stderr
    assert Path(where["schemas"]) == package / "_schemas"
    assert {"session", "t", "u", "r", "cmd_{n}"} <= set(where["raw"])
    data = package / "_datasets" / "stonefish"
    files = [data / name for name in ("sample.parquet", "replay90.parquet", "vehicle.toml")]
    files += [
        data.parent / "hidden" / name for name in ("measured.parquet", "heldout.parquet", "vehicle.toml")
    ]
    done = run(installed / "bin" / "hydro", "check", *files, cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (package / "py.typed").exists()


@pytest.mark.slow
def test_the_wheel_alone_makes_labels(installed: Path, tmp_path: Path) -> None:
    package = next(installed.glob("lib/python*/site-packages/hydro"))
    data = package / "_datasets" / "stonefish" / "replay90.parquet"
    done = run(installed / "bin" / "hydro", "labels", data, "-o", tmp_path / "labels.parquet", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "labels.parquet").stat().st_size > 100_000
