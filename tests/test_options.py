"""Numbers that count or seed something have their bounds in every command, and not in some."""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any, get_args, get_type_hints

import polars as pl
import pytest
import torch

from hydro import cli
from hydro.core import seeds
from hydro.core.errors import UsageError
from hydro.io import table
from hydro.io.files import bundled
from hydro.learn.train import train
from hydro.rl.training.config import SACConfig, TrainingConfig


def options() -> list[tuple[str, Any]]:
    """Every option that takes a whole number, by command and name, with its bounds."""
    found = []
    for group in (*cli.GROUPS, *cli.FAMILIES):
        for command in group.COMMANDS:
            for name, hint in get_type_hints(command, include_extras=True).items():
                kind, *marks = get_args(hint) or (hint,)
                if kind is int or kind == int | None:
                    bounds = next(one for one in marks if hasattr(one, "min"))
                    found.append((f"{command.__name__} {name}", bounds))
    return found


def test_every_whole_number_has_a_least_one_and_every_seed_a_greatest() -> None:
    found = options()
    assert len(found) > 15
    for name, kind in found:
        assert kind.min is not None, name
        if name.endswith(("seed", "task")):
            assert (kind.min, kind.max) == (0, seeds.LARGEST), name


@pytest.mark.parametrize("seed", ["-1", str(2**64), "9" * 30])
def test_a_seed_that_is_none(seed: str, capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    assert cli.main(["train", "none.parquet", "--seed", seed, "-o", str(tmp_path / "m.parquet")]) == 2
    assert "--seed" in capsys.readouterr().err
    with pytest.raises(UsageError, match=r"seed is .*; give one from 0"):
        seeds.check(int(seed))
    with pytest.raises(UsageError, match="seed is"):
        TrainingConfig(seed=int(seed))
    with pytest.raises(UsageError, match="seed is"):
        train(None, seed=int(seed))  # type: ignore[arg-type]  # refused before the table is looked at


def test_the_largest_seed_is_one() -> None:
    seeds.check(seeds.LARGEST)
    torch.Generator().manual_seed(seeds.LARGEST)
    assert TrainingConfig(seed=seeds.LARGEST).seed == seeds.LARGEST


@pytest.mark.parametrize("count", [0, -1])
def test_counts_below_one_are_refused_by_name(count: int) -> None:
    for name in ("batch", "horizon", "capacity", "updates"):
        with pytest.raises(UsageError, match=rf"sac\.{name} is {count}; give 1 or more"):
            SACConfig(**{name: count})
    assert "batch" not in inspect.signature(train).parameters, "rows of a batch follow from the data"


def test_a_family_of_commands_alone_shows_its_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["rl"]) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("Usage: hydro rl")
    assert printed.err.count("\n") > 10
    assert max(map(len, printed.err.splitlines())) <= 100


def test_on_a_terminal_check_says_what_is_sound(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    vehicle, recording = bundled("stonefish") / "vehicle.toml", bundled("stonefish") / "replay90.parquet"
    monkeypatch.setattr("hydro.commands.files.sys.stdout.isatty", lambda: True)
    assert cli.main(["check", str(vehicle), str(recording), str(bundled("logs") / "map.toml")]) == 0
    told = capsys.readouterr().out.splitlines()
    sound = [line.partition(": sound: ")[2].split(",")[0] for line in told if ": sound: " in line]
    assert sound == ["the vehicle stonefish-auv", "a table of kind raw", "a map of a log"]
    assert f"{recording}: thrusters 1 to 8 push as the file says" in told


@pytest.mark.parametrize("said", [{"widths": [4, 4], "training": {"stage": 1}}, {"name": 3}, {"training": 3}])
def test_a_network_is_shown_whatever_its_footer_says(
    said: dict, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    frame = pl.DataFrame(
        {"tensor": ["w"], "shape": [[1]], "data": [[0.5]]}, schema_overrides={"data": pl.List(pl.Float32)}
    )
    path = tmp_path / "policy.parquet"
    table.write(table.make("policy", frame, stage="rl train").of_network(said), path)
    monkeypatch.setattr("hydro.commands.files.sys.stdout.isatty", lambda: True)
    assert cli.main(["show", str(path)]) == 0
    assert "policy: 1 rows" in capsys.readouterr().out
