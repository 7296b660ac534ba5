"""`hydro track`: a change between dives is found, dated and told once; a killed run continues."""

from __future__ import annotations

import json
import pickle
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import polars as pl
import pytest
from recordings import HULL, WEAK, damped, moved, noisy

import hydro
from hydro import cli
from hydro.commands import track as command
from hydro.study.engine import Here
from hydro.study.steps import apart
from hydro.study.track import place

ROWS = 1500
NAMES = [f"dive{number}" for number in range(1, 6)]


def dive(seed: int, *effects: dict[str, Any]) -> pl.DataFrame:
    return noisy(moved(damped(HULL, *effects), seed=seed, rows=ROWS), seed)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three dives of a vehicle, and two after thruster 2 lost 30 % of its thrust."""
    folder = tmp_path_factory.mktemp("track")
    hydro.write_vehicle(damped(), folder / "vehicle.toml")
    for number, name in enumerate(NAMES):
        effects = (WEAK,) if number >= 3 else ()
        hydro.write(dive(300 + 10 * number, *effects), folder / f"{name}.parquet", "raw")
    return folder


def line(work: Path, count: int, history: str) -> list[str]:
    dives = [str(work / f"{name}.parquet") for name in NAMES[:count]]
    return ["track", str(work / "vehicle.toml"), *dives, "--baseline", "3", "-o", str(work / history)]


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*.parquet"))}


class Abroad(Here):
    """Engine that sends every task as bytes, as a cluster does, and runs them in reverse order."""

    def each(self, task: Callable[..., Any], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Any]:
        found = {}
        for number, one in reversed(list(enumerate(arguments))):
            there, given = pickle.loads(pickle.dumps((task, one)))
            found[number] = pickle.loads(pickle.dumps(there(*given)))
        return (found[number] for number in range(len(arguments)))


@pytest.fixture(scope="module")
def history(work: Path) -> Path:
    """Folder of the first run, which also meets a dive that is too short."""
    short = hydro.read(work / "dive4.parquet").head(20)
    hydro.write(short, work / "short.parquet", "raw")
    words = line(work, 5, "history")
    assert cli.main([*words[:5], str(work / "short.parquet"), *words[5:]]) == command.NEW == 3
    return work / "history"


def test_a_weak_thruster_is_found_and_dated(history: Path) -> None:
    (change,) = json.loads((history / "changes.json").read_bytes())["changes"]
    assert change["parameter"] == "thrust_2"
    assert (change["first_dive"], change["found_in"]) == ("dive4", "dive5")
    assert change["after"] == pytest.approx(0.7, abs=0.04)
    assert change["sentence"].startswith("Thruster 2 fell from 100 % to ")
    assert change["sentence"].endswith("between dive 3 and 4 (dive3 and dive4).")
    whole = hydro.read(history / "history.parquet")
    rows = whole.filter(parameter="thrust_2")
    assert rows["flag"].to_list() == ["baseline"] * 3 + ["changed", "found"]
    assert rows["value"].head(3).mean() == pytest.approx(1.0, abs=0.01)
    assert whole["dive"].unique(maintain_order=True).to_list() == NAMES, "one dive is too short"
    page = (history / "report.html").read_text()
    assert change["sentence"] in page
    assert 'data-chart="thrust_2"' in page
    assert "short: " in page


def test_a_killed_run_continues_and_another_engine_writes_the_same_bytes(
    work: Path, history: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    before = content(history)
    place(history, "dive4").unlink()
    (history / "history.parquet").unlink()
    kept = place(history, "dive2").stat().st_mtime_ns
    monkeypatch.setattr(command, "engine_for", lambda *given: nullcontext(Abroad(apart)))
    assert cli.main([*line(work, 5, "history"), "--json"]) == 0, "the change is not new any more"
    said = json.loads(capsys.readouterr().out)
    assert said["new"] == []
    assert len(said["changes"]) == 1
    assert content(history) == before
    assert place(history, "dive2").stat().st_mtime_ns == kept, "a finished dive is not repeated"


def test_a_new_change_is_told(work: Path, history: Path, capsys) -> None:
    (history / "changes.json").unlink()
    assert cli.main([*line(work, 5, "history"), "--text"]) == 3
    said = capsys.readouterr()
    assert said.out.startswith("Thruster 2 fell")
    assert "hydro: new: Thruster 2 fell" in said.err


def test_refusals_say_what_to_do(work: Path, capsys) -> None:
    assert cli.main([*line(work, 2, "refused")]) == 2
    assert "2 dives are fewer than the baseline of 3: lower --baseline" in capsys.readouterr().err
    assert cli.main([*line(work, 5, "refused"), "--baseline-dive", "other"]) == 2
    assert "--baseline-dive other: no such dive" in capsys.readouterr().err
    twice = line(work, 1, "refused")
    assert cli.main([*twice[:3], twice[2], *twice[3:]]) == 1
    assert "is given twice" in capsys.readouterr().err


def test_python_gives_a_history(work: Path) -> None:
    vehicle = hydro.vehicle(work / "vehicle.toml")
    dives = {name: hydro.read(work / f"{name}.parquet") for name in NAMES[:2]}
    found = hydro.track(vehicle, dives, baseline=2)
    assert found.table["flag"].unique().to_list() == ["baseline"]
    assert found.headline.endswith("no later dive to compare with it yet.")
    assert found.summary().is_empty()
    assert len(found.plot()) == found.table["parameter"].n_unique()
    assert json.loads(found.to_json())["headline"] == found.headline
    with pytest.raises(hydro.UsageError, match="1 dives with a baseline of 3"):
        hydro.track(vehicle, {"a": dives["dive1"]}, baseline=3)
