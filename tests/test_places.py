"""Where a command is to write is looked at before it reads; a refused command leaves nothing behind."""

from __future__ import annotations

import inspect
import os
from pathlib import Path
from typing import Any, get_args, get_type_hints

import pytest
from tables import raw

import hydro
from hydro import cli
from hydro.commands.places import FILE, Writes, refuse
from hydro.core.errors import DataError

COMMANDS = [command for group in (*cli.GROUPS, *cli.FAMILIES) for command in group.COMMANDS]
MARKED = [
    (command, name, mark)
    for command in COMMANDS
    for name, hint in get_type_hints(command, include_extras=True).items()
    for mark in get_args(hint)
    if isinstance(mark, Writes)
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a recording and its vehicle file."""
    monkeypatch.chdir(tmp_path)
    hydro.write(raw(), "raw.parquet", "raw")
    return tmp_path


def refused(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """The one line that a command is refused with."""
    before = sorted(Path().rglob("*"))
    code = cli.main(list(arguments))
    printed = capsys.readouterr()
    assert code in (1, 2)
    assert printed.out == ""
    assert printed.err.count("\n") == 1
    assert sorted(Path().rglob("*")) == before, "nothing is left behind"
    return printed.err


def test_every_output_is_marked() -> None:
    for command in COMMANDS:
        for name, hint in get_type_hints(command, include_extras=True).items():
            declared = [text for one in get_args(hint) for text in getattr(one, "param_decls", None) or ()]
            if "--output" in declared:
                assert (command, name) in [(one, its) for one, its, _ in MARKED], f"{command.__name__} {name}"
    assert len(MARKED) > 30


@pytest.mark.parametrize(
    ("command", "name", "mark"), MARKED, ids=lambda one: getattr(one, "__name__", str(one))
)
def test_a_place_that_cannot_be_written_to_is_refused(
    command: Any, name: str, mark: Writes, folder: Path
) -> None:
    given = dict.fromkeys(inspect.signature(command).parameters)
    wrong = (
        {"raw.parquet": "not a folder: name a folder"}
        if mark.folder
        else {".": "folder", "none/x": "no such"}
    )
    for place, reason in {**wrong, "raw.parquet/x": "file, not a folder"}.items():
        with pytest.raises(DataError, match=reason):
            refuse(command, given | {name: place})
    refuse(command, given | {name: "new/study" if mark.folder else "new.parquet"})
    assert sorted(folder.iterdir()) == [folder / "raw.parquet"]


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_the_right_to_write(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder.chmod(0o555)
    assert "permission denied" in refused(capsys, "labels", "raw.parquet", "-o", "labels.parquet")


def test_the_place_is_looked_at_before_the_data(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = refused(capsys, "labels", "missing.parquet", "-o", "none/labels.parquet")
    assert told == "hydro: none/labels.parquet: no such file or folder: check the path\n"
    Path("there").mkdir()
    assert "there: this is a folder" in refused(capsys, "compare", "vehicle.toml", "missing", "-o", "there")
    assert "not a folder: name a folder" in refused(
        capsys, "explain", "vehicle.toml", "missing", "-o", "raw.parquet"
    )
    assert "not a folder: name a folder" in refused(capsys, "demo", "raw.parquet")


def test_an_empty_name_is_told_before_the_work(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As an unset variable of a shell leaves it."""
    told = "hydro: the output has no name: name a file or folder\n"
    assert refused(capsys, "labels", "missing.parquet", "-o", "") == told
    assert refused(capsys, "labels", "", "-o", "l.parquet").startswith("hydro: '': no such file")


def test_an_input_is_not_written_over(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("link.parquet").symlink_to("raw.parquet")
    for place in ("raw.parquet", "./raw.parquet", "link.parquet"):
        assert "this is an input" in refused(capsys, "labels", "raw.parquet", "-o", place)
    told = refused(capsys, "split", "raw.parquet", "--blocks", "new.parquet", "-o", "new.parquet")
    assert "two results" in told
    assert "two results" in refused(
        capsys, "split", "missing", "--blocks", "link.parquet", "-o", "raw.parquet"
    )


def test_devices_take_everything(folder: Path) -> None:
    given = dict.fromkeys(("raw", "blocks", "output"), "/dev/null")
    command = next(one for one in COMMANDS if one.__name__ == "split")
    assert FILE in get_args(get_type_hints(command, include_extras=True)["output"])
    refuse(command, given)


def test_a_folder_with_other_results_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    results = folder / "results"
    results.mkdir()
    (results / "run.parquet").touch()
    message = refused(capsys, "explain", "vehicle.toml", "raw.parquet", "-o", str(results))
    assert message == f"hydro: {results}: holds a training (run.parquet): name another folder\n"
    (results / "run.parquet").rename(results / "ladder.parquet")
    message = refused(capsys, "partition", "raw.parquet", "-o", str(results))
    assert message == f"hydro: {results}: holds a study (ladder.parquet): name another folder\n"
