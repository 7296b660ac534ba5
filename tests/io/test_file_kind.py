"""A file in the place of another is told by what it is, and by what belongs there."""

from __future__ import annotations

from pathlib import Path

import pytest

from hydro import cli
from hydro.core.errors import DataError
from hydro.core.recording import extent
from hydro.io import file_kind

ROOT = Path(__file__).resolve().parents[2] / "datasets"
VEHICLE, SAMPLE = ROOT / "stonefish" / "vehicle.toml", ROOT / "stonefish" / "sample.parquet"
LOG, MAP = ROOT / "logs" / "example.csv", ROOT / "logs" / "map.toml"
DIVE = ROOT / "dive"
NOT_A_VEHICLE = "a vehicle is a .toml, as `hydro vehicle new` writes it"
NOT_A_RECORDING = "a recording is a raw table (.parquet), or a log with --map"


@pytest.mark.parametrize(
    "path", [SAMPLE, LOG, *(DIVE / f"{name}" for name in ("dive.bin", "ros2.mcap", "dive.bag"))]
)
def test_what_is_a_recording(path: Path) -> None:
    assert file_kind.kind(path) == file_kind.RECORDING


@pytest.mark.parametrize("path", sorted(ROOT.rglob("*.toml")), ids=lambda path: path.name)
def test_what_is_a_vehicle_or_a_map(path: Path) -> None:
    text = path.read_text()
    vehicle, map_ = "[rigid_body]" in text, "hydro-map/" in text
    assert file_kind.kind(path) == (file_kind.VEHICLE if vehicle else file_kind.MAP if map_ else "")


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (["compare", SAMPLE, SAMPLE], f"{SAMPLE}: this is a recording, or another table; {NOT_A_VEHICLE}"),
        (["diagnose", LOG, SAMPLE], f"{LOG}: this is a recording, or another table; {NOT_A_VEHICLE}"),
        (
            ["labels", SAMPLE, "--vehicle", LOG],
            f"{LOG}: this is a recording, or another table; {NOT_A_VEHICLE}",
        ),
        (["simulate", MAP, SAMPLE], f"{MAP}: this is a map of a log; {NOT_A_VEHICLE}"),
        (["compare", VEHICLE, VEHICLE], f"{VEHICLE}: this is a vehicle file; {NOT_A_RECORDING}"),
        (["labels", VEHICLE], f"{VEHICLE}: this is a vehicle file; {NOT_A_RECORDING}"),
        (["show", VEHICLE], f"{VEHICLE}: this is a vehicle file; {NOT_A_RECORDING}"),
        (["labels", MAP], f"{MAP}: this is a map of a log; {NOT_A_RECORDING}"),
        (
            ["import", LOG, "--map", VEHICLE],
            f"{VEHICLE}: this is a vehicle file; a map is a .toml, "
            "as `hydro import LOG --write-map FILE` begins it",
        ),
    ],
)
def test_a_file_in_the_place_of_another(
    line: list[object], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = [] if line[0] == "show" else ["-o", str(tmp_path / "out")]
    assert cli.main([*map(str, line), *out]) == 1
    assert capsys.readouterr().err == f"hydro: {told}\n"


def test_too_many_rows_are_refused_with_what_they_would_take(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "raw.parquet")
    assert cli.main(["collect", "--vehicle", str(VEHICLE), "--rows", str(10**13), "-o", out]) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "10,000,000,000,000 rows would take 1,000,000 GB; a table has at most 100,000,000" in told
    assert cli.main(["import", str(LOG), "--map", str(MAP), "--rate", "10000", "-o", out]) == 1
    assert "10000 rows per second are" in capsys.readouterr().err
    extent.require_rows(extent.MOST_ROWS)
    with pytest.raises(DataError, match="rows would take"):
        extent.require_rows(extent.MOST_ROWS + 1)
    assert [extent.duration(each) for each in (5.0, 600.0, 9e4, 1e6)] == [
        "5 s",
        "10 minutes",
        "25 hours",
        "12 days",
    ]


def test_a_log_may_begin_with_a_byte_order_mark(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    marked = tmp_path / "log.csv"
    marked.write_bytes(b"\xef\xbb\xbf" + LOG.read_bytes())
    assert cli.main(["import", str(marked), "--map", str(MAP), "-o", str(tmp_path / "raw.parquet")]) == 0
