"""Commands `data`: recordings of the companion distribution are found, listed and verified.

The package is made by the script that builds the wheel, from a short recording.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from hydro import cli
from hydro.io import companion, table
from hydro.io.files import bundled

ROOT = Path(__file__).resolve().parents[1]
ROWS = 300


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder on the import path with a package of one short recording."""
    sys.path.insert(0, str(ROOT / "packaging" / "data"))
    try:
        import build
    finally:
        sys.path.remove(str(ROOT / "packaging" / "data"))
    folder = tmp_path_factory.mktemp("companion")
    source, package = folder / "recordings", folder / "site" / companion.PACKAGE
    source.mkdir()
    short = table.read(bundled("stonefish") / "replay90.parquet").frame.head(ROWS)
    short.write_parquet(source / "replay90.parquet")
    for name in build.BESIDE:
        (source / name).write_text("{}")
    package.mkdir(parents=True)
    (package / "__init__.py").touch()
    build.filled(source, package, ["replay90"], "1.0.0")
    return folder / "site"


@pytest.fixture
def installed(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.syspath_prepend(str(made))
    return made / companion.PACKAGE


def test_recordings_are_listed_found_and_verified(
    installed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["data", "list"]) == 0
    assert "90 s in nine segments" in capsys.readouterr().out
    assert cli.main(["data", "path", "replay90"]) == 0
    path = Path(capsys.readouterr().out.strip())
    assert path == installed / "stonefish" / "replay90.parquet"
    assert cli.main(["data", "path"]) == 0
    assert Path(capsys.readouterr().out.strip()) == path.parent
    assert cli.main(["data", "verify"]) == 0
    assert "all as in the manifest" in capsys.readouterr().out
    assert cli.main(["data", "path", "nominal"]) == 2
    assert "replay90.parquet" in capsys.readouterr().err


def test_a_table_keeps_its_values_and_carries_the_vehicle(installed: Path) -> None:
    artefact = table.read(installed / "stonefish" / "replay90.parquet", "raw")
    original = table.read(bundled("stonefish") / "replay90.parquet").frame.head(ROWS)
    assert artefact.frame.equals(original)
    assert artefact.provenance.vehicle == (bundled("stonefish") / "vehicle.toml").read_text()


def test_the_metadata_name_every_file_and_column(installed: Path) -> None:
    metadata = json.loads((installed / "croissant.json").read_text())
    entries = {one.name: one for one in companion.manifest().files}
    assert {one["name"]: one["sha256"] for one in metadata["distribution"]} == {
        name: one.sha256 for name, one in entries.items()
    }
    (records,) = metadata["recordSet"]
    columns = [one["source"]["extract"]["column"] for one in records["field"]]
    assert columns == table.read(installed / "stonefish" / "replay90.parquet").frame.columns


@pytest.mark.parametrize("damage", ["changed", "shorter", "missing"])
def test_damage_is_told_in_one_line(damage: str, installed: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = installed / "stonefish" / "hull.obj"
    content = path.read_bytes()
    if damage == "missing":
        path.unlink()
    else:
        path.write_bytes(content[:-1] + (b"?" if damage == "changed" else b""))
    try:
        assert cli.main(["data", "verify"]) == 1
        told = capsys.readouterr().err
        assert told.count("\n") == 1
        assert "hull.obj" in told
    finally:
        path.write_bytes(content)


@pytest.mark.parametrize("command", [["list"], ["path"], ["path", "nominal"], ["verify"]])
def test_without_the_distribution_a_line_says_how_to_install_it(
    command: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(companion.util, "find_spec", lambda name: None)
    assert cli.main(["data", *command]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "pip install" in told
