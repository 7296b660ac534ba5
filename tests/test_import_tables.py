"""`hydro import` of several files with clocks of their own, of late stamps, and drafts of maps."""

from __future__ import annotations

import re
from pathlib import Path

import logs
import numpy as np
import polars as pl
import pytest

from hydro import cli
from hydro.io import table

SHARED = Path(__file__).resolve().parents[2] / "shared" / "data" / "real" / "tauv" / "segments"
MAP = """
[[table]]
files = "state_{session}.csv"
time = "header.stamp"
unit = "ns"
[[table]]
files = "drive_{session}.csv"
time = "%time"
unit = "ns"
[position]
columns = ["x", "y", "z"]
[attitude]
columns = ["phi", "theta", "psi"]
[velocity]
columns = ["u", "v", "w"]
[rates]
from = "attitude"
[commands]
columns = ["force.x", "force.y"]
[mixer]
demands = ["surge", "sway"]
"""
LATE = 0.3


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str]:
    """Exit code and what went to stderr."""
    code = cli.main(["import", *map(str, arguments)])
    return code, capsys.readouterr().err


@pytest.fixture
def recording(tmp_path: Path) -> list[Path]:
    """Two sessions of a state at uneven steps, whose velocity is late, and of commands received in bursts."""
    rng = np.random.default_rng(0)
    files = []
    for name in ("0", "1"):
        start = 1_669_909_203_000_000_000 + int(name) * 10**12
        t = np.cumsum(rng.uniform(0.04, 0.08, 900))
        values = logs.motion(t) + 1e-3 * rng.standard_normal((900, 12))
        values[:, 6:9] = logs.motion(t - LATE)[:, 6:9]
        sent = np.arange(0.0, t[-1], 0.02)
        wakes = np.sort(rng.uniform(0.0, t[-1] + 0.2, 600))
        received = wakes[np.minimum(np.searchsorted(wakes, sent), 599)] + 1e-5 * np.arange(len(sent))
        received = np.maximum.accumulate(np.maximum(received, sent))
        stamp, arrived = (start + np.round(1e9 * each).astype(np.int64) for each in (t, received))
        files += [tmp_path / f"state_{name}.csv", tmp_path / f"drive_{name}.csv"]
        motion = dict(zip(logs.NAMES[:9], values[:, :9].T, strict=True))
        pl.DataFrame({"%time": stamp + 10**8, "header.stamp": stamp, **motion}).write_csv(files[-2])
        drive = {"force.x": np.round(np.sin(sent), 3), "force.y": np.round(np.cos(0.7 * sent), 3)}
        pl.DataFrame({"%time": arrived, **drive}).write_csv(files[-1])
    (tmp_path / "map.toml").write_text(MAP)
    return files


def test_several_tables_are_one_recording(
    recording: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*recording, "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet"]
    code, error = run(capsys, *arguments)
    assert code == 0, error
    assert "in 2 sessions" in error
    assert re.search("commands: received in bursts; put on an even clock of (49.9|50)", error)
    assert "rates: derived from the attitude's samples" in error
    assert "warning: velocity is stamped 0.3" in error or "warning: velocity is stamped 0.29" in error
    assert "write lag = 0." in error
    artefact = table.read(tmp_path / "raw.parquet", "raw")
    assert artefact.frame["session"].unique().sort().to_list() == ["0", "1"]
    assert len(artefact.provenance.inputs) == 4
    rows = artefact.frame.drop_nulls()
    apart = rows.select(logs.NAMES[:6]).to_numpy() - logs.motion(rows["t"].to_numpy() + 0.06)[:, :6]
    assert np.abs(apart).max() < 0.15


def test_a_late_sensor_is_refused_under_strict_and_put_right_by_its_line(
    recording: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [*recording, "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet", "--strict"]
    code, error = run(capsys, *arguments)
    assert code == 1
    assert "velocity is stamped" in error.splitlines()[-1]
    assert not (tmp_path / "raw.parquet").exists()
    text = MAP.replace('["u", "v", "w"]', f'["u", "v", "w"]\nlag = {LATE}')
    (tmp_path / "map.toml").write_text(text)
    code, error = run(capsys, *arguments)
    assert code == 0, error
    assert "velocity is stamped" not in error


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        ("drive_{session}", "wrench_{session}", "drive_0.csv: fits none of the map's tables"),
        ("drive_{session}", "*_{session}", "state_0.csv: fits several of the map's tables"),
        ('"force.y"]', '"force.q"]', "no file has the column force.q of the map"),
        (
            'columns = ["x", "y", "z"]',
            'columns = ["%time", "y", "z"]',
            "column %time is in state_{session}.csv",
        ),
        ('["surge", "sway"]', '["surge"]', "mixer.demands: name one axis for each of the 2 columns"),
        ('from = "attitude"', 'from = "attitude"\ncolumns = ["u", "v", "w"]', "rates: give either columns"),
        ("[mixer]", "[use]\nfrom = 5\nto = 2\n[mixer]", "use: to (2 s) must come after from (5 s)"),
    ],
)
def test_tables_that_do_not_fit_are_one_line(
    recording: list[Path], old: str, new: str, line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert old in MAP
    (tmp_path / "map.toml").write_text(MAP.replace(old, new))
    code, error = run(capsys, *recording, "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet")
    assert (code, len(error.splitlines())) == (1, 1)
    assert line in error


def test_several_logs_with_clocks_of_their_own_need_tables(
    recording: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = MAP[MAP.index("[position]") :]
    (tmp_path / "map.toml").write_text('[time]\ncolumn = "header.stamp"\n' + text)
    code, error = run(capsys, *recording, "--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet")
    assert (code, len(error.splitlines())) == (1, 1)
    assert "no column is called header.stamp" in error
    assert "give each a [[table]]" in error


def test_a_map_that_was_edited_is_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    logs.raw(1.0).write_csv(tmp_path / "log.csv")
    draft = tmp_path / "map.toml"
    for _ in range(2):
        assert run(capsys, tmp_path / "log.csv", "--write-map", draft)[0] == 0
    written = draft.read_text()
    draft.write_text(written + "# mine\n")
    code, error = run(capsys, tmp_path / "log.csv", "--write-map", draft)
    assert (code, len(error.splitlines())) == (1, 1)
    assert "give --force" in error
    assert draft.read_text().endswith("# mine\n")
    assert run(capsys, tmp_path / "log.csv", "--write-map", draft, "--force")[0] == 0
    assert draft.read_text() == written


REAL = """
[[table]]
files = "navigation_state_{session}.csv"
time = "field.header.stamp"
unit = "ns"
[[table]]
files = "wrench_{session}.csv"
time = "%time"
unit = "ns"
[position]
columns = ["field.position.x", "field.position.y", "field.position.z"]
[attitude]
columns = ["field.orientation.x", "field.orientation.y", "field.orientation.z"]
[velocity]
columns = ["field.velocity.x", "field.velocity.y", "field.velocity.z"]
[rates]
from = "attitude"
[commands]
columns = [
  {column = "field.force.x", scale = 0.01}, {column = "field.force.y", scale = 0.01},
  {column = "field.force.z", scale = 0.01}, {column = "field.torque.x", scale = 0.01},
  {column = "field.torque.y", scale = 0.01}, {column = "field.torque.z", scale = 0.01},
]
[mixer]
demands = ["surge", "sway", "heave", "roll", "pitch", "yaw"]
"""


def test_a_real_vehicles_segments_are_imported_by_one_map(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if not SHARED.is_dir():
        pytest.skip("the real recordings are not beside this checkout (../shared/data/real)")
    (tmp_path / "map.toml").write_text(REAL)
    arguments = ["--map", tmp_path / "map.toml", "-o", tmp_path / "raw.parquet"]
    code, error = run(capsys, *sorted(SHARED.glob("*.csv")), *arguments)
    assert code == 0, error
    assert "in 4 sessions" in error
    assert "readings only repeat the last one" in error
    assert "even clock of 50.0" in error
    assert "velocity is stamped 0.2" in error
    frame = table.read(tmp_path / "raw.parquet", "raw").frame
    assert {f"cmd_{i}" for i in range(1, 7)} <= set(frame.columns)
