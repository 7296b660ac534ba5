"""Several files as one log: its digest and notes, and how often each file is read."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import msgspec
import polars as pl
import pytest

from hydro.core.logs.logmap import LogMap
from hydro.io import log_files, logmap
from hydro.io.joining import joined
from hydro.io.log import Log, LogFile, opened, together
from hydro.io.readers import registry

EXAMPLE = Path(__file__).resolve().parents[2] / "datasets" / "logs" / "example.csv"
MAP = EXAMPLE.with_name("map.toml")


def log(name: str, **columns: list[float]) -> Log:
    return Log(name, pl.DataFrame(columns), f"sha256:{name}", notes=(f"{name} is short",))


def test_the_digest_of_several_logs_does_not_depend_on_their_order() -> None:
    a, b = log("a", x=[1.0]), log("b", y=[2.0])
    one, other = together([a, b], pl.DataFrame()), together([b, a], pl.DataFrame())
    assert one.digest == other.digest != a.digest
    assert (one.name, other.name) == ("a and 1 more", "b and 1 more")
    assert one.files == ("sha256:a", "sha256:b")
    assert one.notes == ("a: a is short", "b: b is short")


def test_one_log_keeps_its_name_digest_and_notes() -> None:
    frame = pl.DataFrame({"z": [3.0]})
    assert together([log("a", x=[1.0])], frame) == Log("a", frame, "sha256:a", notes=("a is short",))


def test_the_notes_of_readers_survive_joining() -> None:
    text = MAP.read_text() + '\n[[table]]\nfiles = "pose.csv"\ntime = "time_ms"\nunit = "ms"\n'
    meaning = msgspec.structs.replace(logmap.read(MAP), table=_tables(text))
    frame = pl.read_csv(EXAMPLE, infer_schema=False).head(50)
    found, _ = joined([Log("pose.csv", frame, "sha256:1", notes=("cut short",))], meaning)
    assert found.notes == ("cut short",)
    assert found.digest == "sha256:1"


def _tables(text: str) -> Any:
    """The `[[table]]`s of a map's text."""
    import tomllib

    from hydro.core.logs.logmap import Table

    return [msgspec.convert(each, Table) for each in tomllib.loads(text)["table"]]


@pytest.mark.parametrize("meaning", [None, MAP])
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_a_table_is_read_once(
    suffix: str, meaning: Path | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = pl.read_csv(EXAMPLE, infer_schema=False)
    paths = [tmp_path / f"{name}.{suffix}" for name in "ab"]
    for path, rows in zip(paths, (frame.head(200), frame.slice(200, 200)), strict=True):
        rows.write_csv(path) if suffix == "csv" else rows.write_parquet(path)
    reads: list[str] = []
    genuine = registry.read

    def counted(path: Path, *rest: Any) -> pl.DataFrame:
        reads.append(path.name)
        return genuine(path, *rest)

    monkeypatch.setattr(registry, "read", counted)
    found, _ = _gathered(paths, meaning)
    assert reads == [path.name for path in paths]
    assert found.frame.height == 400


def _gathered(paths: Sequence[Path], meaning: Path | None) -> tuple[Log, LogMap]:
    with ExitStack() as stack:
        files: list[LogFile] = [stack.enter_context(opened(path)) for path in paths]
        return log_files.gather(files, meaning)


def test_a_drafted_map_looks_at_the_numbers_of_whichever_file_has_them(tmp_path: Path) -> None:
    """Angles beyond a whole turn are degrees, though the first file has no angles at all."""
    angles = {"roll": [0.0, 3.0, -9.0], "pitch": [1.0, 12.0, -4.0], "yaw": [100.0, 110.0, 120.0]}
    for name, columns in (("a", {"depth": [1.0, 2.0, 3.0]}), ("b", angles)):
        pl.DataFrame({"t": [0.0, 0.1, 0.2]} | columns).write_csv(tmp_path / f"{name}.csv")
    with ExitStack() as stack:
        files: list[LogFile] = [stack.enter_context(opened(tmp_path / f"{name}.csv")) for name in "ab"]
        _, blocks = log_files.drafted(files)
    assert blocks["attitude"] == {"columns": ["roll", "pitch", "yaw"], "unit": "deg"}
