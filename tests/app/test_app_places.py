from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator
from pathlib import Path

import pytest
from bombs import mcap

from hydro.app import opening, uploads
from hydro.app.opening import Craft
from hydro.app.places import Places, safe_name
from hydro.core.errors import DataError

BAD = [
    "../a.csv",
    "/etc/a.csv",
    "a/b.csv",
    "a\\b.csv",
    ".hidden.csv",
    "",
    "a\x00.csv",
    "a\n.csv",
    "x" * 200 + ".csv",
    "..",
]


@pytest.fixture
def places(tmp_path: Path) -> Places:
    (tmp_path / "open").mkdir()
    (tmp_path / "closed").mkdir()
    (tmp_path / "closed" / "secret.csv").write_text("t\n")
    (tmp_path / "closed" / "named.csv").write_text("t\n")
    (tmp_path / "open" / "log.csv").write_text("t\n")
    (tmp_path / "open" / "link.csv").symlink_to(tmp_path / "closed" / "secret.csv")
    (tmp_path / "uploads").mkdir()
    return Places(
        ((tmp_path / "open").resolve(),),
        ((tmp_path / "closed" / "named.csv").resolve(),),
        tmp_path / "uploads",
    )


@pytest.mark.parametrize("name", BAD)
def test_names_with_folders_are_refused(name: str, places: Places) -> None:
    with pytest.raises(DataError, match="file name"):
        safe_name(name)
    with pytest.raises(DataError):
        store(places, name, [b"t"])
    assert list(places.uploads.iterdir()) == []


def test_only_the_folders_of_the_command_line_are_read_and_written(places: Places, tmp_path: Path) -> None:
    inside = places.folders[0]
    assert places.readable(inside / "log.csv") == inside / "log.csv"
    assert places.readable(tmp_path / "closed" / "named.csv").name == "named.csv"
    assert places.writable(inside / "new.toml").parent == inside
    for path in (
        tmp_path / "closed" / "secret.csv",
        inside / "link.csv",
        inside / ".." / "closed" / "secret.csv",
    ):
        with pytest.raises(DataError, match="--folder"):
            places.readable(path)
    for path in (
        tmp_path / "closed" / "named.csv",
        inside / "link.csv",
        inside / ".." / "x.toml",
        "/etc/x.toml",
    ):
        with pytest.raises(DataError, match="--folder"):
            places.writable(path)
    assert [one.name for one in places.listed((".csv",))] == ["log.csv"]


def store(places: Places, name: str, parts: list[bytes], largest: int = 100) -> Path:
    async def chunks() -> AsyncIterator[bytes]:
        for part in parts:
            yield part

    return asyncio.run(uploads.store(places, name, chunks(), largest))


def test_an_upload_is_stored_in_the_private_folder(places: Places) -> None:
    path = store(places, "dive 1.csv", [b"t\n", b"1\n"])
    assert path.read_bytes() == b"t\n1\n"
    assert path.is_relative_to(places.uploads)
    assert store(places, "dive 1.csv", [b"other"]) != path
    places.close()
    assert not places.uploads.exists()


@pytest.mark.parametrize(
    ("name", "parts", "why"),
    [("a.csv", [b"x" * 60, b"x" * 60], "larger"), ("a.csv", [], "empty"), ("a.py", [b"x"], "not a log")],
)
def test_an_upload_that_is_too_large_empty_or_no_log_leaves_nothing(
    name: str, parts: list[bytes], why: str, places: Places
) -> None:
    with pytest.raises(DataError, match=why):
        store(places, name, parts)
    assert list(places.uploads.iterdir()) == []


def test_a_decompression_bomb_is_refused_in_one_line(places: Places, craft: Craft) -> None:
    pytest.importorskip("mcap")
    bomb = mcap(places.folders[0] / "bomb.mcap", 400_000_000)
    assert bomb.stat().st_size < 1_000_000
    with pytest.raises(DataError, match=r"GB|expand") as caught:
        opening.propose_map([str(bomb)], {}, None, lambda words, share: None)
    assert "\n" not in str(caught.value)


def test_a_bad_log_is_refused_in_one_line(places: Places) -> None:
    broken = places.folders[0] / "broken.mcap"
    broken.write_bytes(b"\x89MCAP0\r\n" + b"?" * 40)
    with pytest.raises(DataError) as caught:
        opening.propose_map([str(broken)], {}, None, lambda words, share: None)
    assert "\n" not in str(caught.value)
    assert "broken.mcap" in str(caught.value)


def test_files_whose_names_are_no_text_are_not_listed(tmp_path: Path) -> None:
    """A name in another encoding, such as Latin-1: no message to the page can contain it."""
    for name in (b"good.csv", b"gr\xfcn.csv", b"dive\xff/inside.csv"):
        path = Path(os.fsdecode(bytes(tmp_path) + b"/" + name))
        path.parent.mkdir(exist_ok=True)
        path.write_text("t")
    assert Places.of([tmp_path]).listed((".csv",)) == [tmp_path.resolve() / "good.csv"]
