"""Small files that expand to much: refused in one line, before they take the memory."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import bombs
import logs
import message_logs as written
import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from hydro import cli
from hydro.core.errors import DataError
from hydro.io import log, schema, table
from hydro.io.readers import parquet_pages
from hydro.io.readers.expansion import LEAST, RATIO, Expansion, allowed, limit

SIZE = 150_000_000
"""Bytes that the bombs expand to, a little more than the limit of a small file."""


@pytest.mark.parametrize("name", bombs.BOMBS)
def test_a_bomb_is_refused_in_one_line(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = bombs.BOMBS[name](tmp_path / name, SIZE)
    assert cli.main(["import", str(path), "--topics"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    (line,) = said.err.splitlines()
    if name == "lying-lz4.mcap":
        assert "a chunk that has not the 1,000 bytes which its header states" in line
    else:
        assert line.startswith(f"hydro: {path}: ")
        assert " bytes would take " in line
        assert line.endswith("if you trust this file, raise it with --max-expanded GB")


@pytest.mark.parametrize("name", written.WRITERS)
def test_an_honest_log_expands_far_less_than_the_limit(name: str, tmp_path: Path):
    write, _ = written.WRITERS[name]
    path = write(logs.raw(5.0), tmp_path / name)
    with allowed(path.stat().st_size * RATIO / 4.0 / 1e9):
        assert log.read(path).frame.height


def test_an_honest_table_expands_far_less_than_the_limit(tmp_path: Path):
    raw = logs.raw(60.0)
    still = raw.with_columns(pl.lit(0.0).alias(name) for name in logs.NAMES)
    for frame in (raw, still):
        path = tmp_path / "raw.parquet"
        table.write(table.make("raw", frame, stage="import"), path)
        with allowed(path.stat().st_size * RATIO / 1.5 / 1e9):
            assert table.read(path).frame.height == raw.height


def test_the_option_replaces_the_limit(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    path = bombs.npz(tmp_path / "a.npz", SIZE)
    assert cli.main(["import", str(path), "--topics", "--max-expanded", "0.16"]) == 0
    assert "18,750,000 rows" in capsys.readouterr().out
    assert cli.main(["import", str(path), "--topics", "--max-expanded", "0.14"]) == 1
    assert "bytes would take 0.15 GB or more" in capsys.readouterr().err
    assert limit(1) == LEAST  # the option ends with its command


@pytest.mark.parametrize("name", ["numbers.parquet", "text.parquet"])
def test_a_table_of_hydro_itself_is_held_to_the_limit(name: str, tmp_path: Path):
    content = io.BytesIO(bombs.BOMBS[name](tmp_path / name, SIZE).read_bytes())
    file, whole = pq.ParquetFile(content), memoryview(content.getvalue())
    with pytest.raises(DataError, match="--max-expanded"):
        parquet_pages.count(file, whole, Expansion("raw.parquet", len(whole)))


def test_a_recording_that_expands_too_much_is_refused_by_other_commands_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = tmp_path / "session=dive" / "part.parquet"
    path.parent.mkdir()
    table.write(table.make("raw", logs.raw(60.0), stage="import"), path)
    for source in (path, tmp_path):
        assert cli.main(["check", str(source), "--max-expanded", "0.0001"]) == 1
        assert " bytes would take 0.0003" in capsys.readouterr().err
        assert cli.main(["check", str(source)]) == 0


READERS = (
    "show {raw}",
    "report {comparison} -o page.html",
    "split {labels} -o split.parquet",
    "features {labels} -o features.parquet",
    "add vehicle.toml {diagnosis} -o vehicle-1.toml",
    "diff vehicle.toml vehicle.toml --on {raw}",
    "export {model} --to onnx -o network.onnx",
    "partition {raw} -o dives",
    "train {split} -o model.parquet",
    "evaluate {model} --labels {split} -o metrics.parquet",
    "rl train vehicle.toml --condition R_MLP --model {model} -o learnt",
    "rl eval . -o flown.parquet",
    "rl watch . -o flight.png",
    "rl curves . -o curves.png",
    "rl study vehicle.toml --model {model} -o study",
)
"""Command lines that read tables, by the kinds of these."""


def flat(kind: str, path: Path, rows: int) -> Path:
    """Write a table of a kind whose rows are all alike, of 8 bytes or more each in memory."""
    fields = schema.load(kind).columns(()).items()
    alike = {pl.String: "", pl.Boolean: False}
    values = {
        name: pl.Series([[] if field.type == "array" else alike.get(field.widest, 0)], dtype=field.widest)
        for name, field in fields
    }
    pl.DataFrame({name: value.new_from_index(0, rows) for name, value in values.items()}).write_parquet(path)
    return path


@pytest.mark.parametrize("line", READERS, ids=lambda line: line.partition(" {")[0].partition(" .")[0])
def test_a_table_that_expands_too_much_is_refused_by_every_reader(
    line: str, tmp_path: Path, datasets: Path, capsys: pytest.CaptureFixture[str], monkeypatch
):
    monkeypatch.chdir(tmp_path)
    shutil.copy(datasets / "vehicles" / "auv151.toml", "vehicle.toml")
    kinds = ("raw", "comparison", "diagnosis", "labels", "split", "model", "run", "policy", "evaluations")
    bombs = {kind: flat(kind, tmp_path / f"{kind}.parquet", 20_000) for kind in kinds}
    assert cli.main([*line.format(**bombs).split(), "--max-expanded", "0.0001"]) == 1
    (told,) = capsys.readouterr().err.splitlines()
    assert "once they are decompressed, and the limit is 0.0001 GB" in told


@pytest.mark.parametrize("version", ["1.0", "2.0"])
@pytest.mark.parametrize("dictionary", [True, False])
def test_columns_are_counted_as_they_are_in_memory(version: str, dictionary: bool):
    rng = np.random.default_rng(0)
    texts = [f"session {each}" for each in rng.integers(0, 50, 20_000)]
    frame = pa.table(
        {
            "t": rng.standard_normal(20_000),
            "flag": rng.integers(0, 2, 20_000) > 0,
            "session": texts,
            "pair": pa.array([[1.0, 2.0], None] * 10_000),
        }
    )
    sink = io.BytesIO()
    how = {"row_group_size": 7000, "data_page_size": 4096, "data_page_version": version}
    pq.write_table(frame, sink, use_dictionary=dictionary, **how)
    counted = Expansion("a.parquet", sink.tell())
    added: list[float] = []
    counted.add = added.append  # type: ignore[method-assign]
    parquet_pages.count(pq.ParquetFile(sink), memoryview(sink.getvalue()), counted)
    numbers = 8 * (20_000 + 20_000 + 30_000 + 20_000)
    assert numbers <= sum(added)
    assert added[0] <= 1.2 * (numbers + sum(map(len, texts)))


def test_json_that_takes_more_than_its_text_is_not_decoded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    path = bombs.json_lists(tmp_path / "lists.mcap", 300_000_000)
    assert cli.main(["import", str(path), "--topics"]) == 0
    assert "bytes of JSON are more than a measurement has" in capsys.readouterr().out


@pytest.mark.skipif(sys.platform != "linux", reason="reads the peak of memory from /proc")
def test_a_bomb_takes_no_memory(tmp_path: Path):
    path = bombs.mcap(tmp_path / "zeros.mcap", 1_000_000_000)
    peaks = {}
    for code, arguments in ((0, ["import", "--help"]), (1, ["import", str(path), "--topics"])):
        script = (
            f"from hydro.cli import main; code = main({arguments}); "
            "peak = next(each for each in open('/proc/self/status') if 'VmHWM' in each); "
            "print(peak.split()[1]); exit(code)"
        )
        done = subprocess.run(
            [sys.executable, "-c", script], capture_output=True, text=True, env={**os.environ}, check=False
        )
        assert done.returncode == code, done.stderr
        peaks[code] = int(done.stdout.splitlines()[-1]) / 1e3
    assert peaks[1] < peaks[0] + 300.0  # MB; a tenth of them is zeros, the rest are libraries
