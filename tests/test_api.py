"""The public functions: the order of their arguments, what they write, and old names for one more version."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import polars as pl
import pytest
import synthetic

import hydro
from hydro import _moved, cli
from hydro.core.errors import DataError
from hydro.core.vehicle.description import Vehicle
from hydro.io import table

ROOT = Path(__file__).resolve().parents[1]
EXAMPLE, MAP = (str(ROOT / "datasets" / "logs" / name) for name in ("example.csv", "map.toml"))
DATA = ("raw", "commands")


def python(script: str, *options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, *options, "-c", script], capture_output=True, text=True, check=True
    )


def commands(rows: int = 40) -> pl.DataFrame:
    demand = np.sin(np.arange(rows) / 5)[:, None] * np.linspace(0.1, 0.4, 8)
    return pl.DataFrame({"session": ["a"] * rows, "t": np.arange(rows) * 0.02}).with_columns(
        pl.Series(f"cmd_{i + 1}", demand[:, i]) for i in range(8)
    )


FUNCTIONS = [name for name in hydro.__all__ if name.islower()]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_vehicle_comes_before_the_data(name: str) -> None:
    parameters = inspect.signature(getattr(hydro, name)).parameters.values()
    names = [one.name for one in parameters if one.kind is not one.KEYWORD_ONLY]
    if "vehicle" in names:
        assert names[0] == "vehicle"
        assert not names[1:] or names[1] in (*DATA, "dives", "diagnosis", "destination")


def test_the_old_order_gives_the_same_with_one_warning() -> None:
    vehicle, plan = synthetic.vehicle(), commands()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        raw = hydro.simulate(vehicle, plan)
        expected = hydro.labels(vehicle, raw)
    for call in (
        lambda: hydro.labels(raw, vehicle),
        lambda: hydro.labels(raw, vehicle=vehicle),
    ):
        with pytest.warns(DeprecationWarning, match="vehicle first") as caught:
            found = call()
        assert found.equals(expected)
        assert [Path(one.filename) for one in caught] == [Path(__file__)]
    with pytest.warns(DeprecationWarning, match=r"hydro\.simulate"):
        assert hydro.simulate(plan, vehicle).equals(raw)


def test_progress_has_words_and_a_share_that_ends_at_one(monkeypatch: pytest.MonkeyPatch) -> None:
    vehicle = synthetic.vehicle()
    raw, seen = hydro.simulate(vehicle, commands(600)), []
    hydro.compare(vehicle, raw, progress=lambda words, share: seen.append((words, share)))
    assert all(isinstance(words, str) and words for words, _ in seen)
    shares = [share for _, share in seen]
    assert shares == sorted(shares)
    assert (shares[0], shares[-1]) == (0.0, 1.0)


def test_a_fit_goes_into_a_vehicle_with_its_standard_errors(tmp_path: Path) -> None:
    true = hydro.vehicle(ROOT / "datasets" / "vehicles" / "auv151.toml")
    text = (ROOT / "datasets" / "vehicles" / "auv151.toml").read_text()
    (drag,) = true.effects("quadratic_damping")
    plan = commands(1500).with_columns(pl.col("^cmd_.*$") * 2)
    raw = hydro.simulate(true, plan)
    found = hydro.fit(true.without("quadratic_damping"), raw, ["quadratic_damping"], method="equation")
    better = hydro.add(true, found)
    (table,) = better.effects("quadratic_damping")
    assert table["diagonal"] == pytest.approx(found.values, abs=float(found.standard_errors.max()))
    assert table["diagonal"] != drag["diagonal"]
    assert table["standard_error"]["diagonal"] == pytest.approx(found.standard_errors, rel=0.01)
    path = tmp_path / "better.toml"
    hydro.write_vehicle(better, path, source=ROOT / "datasets" / "vehicles" / "auv151.toml")
    assert hydro.vehicle(path) == better
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert comments
    assert all(line in path.read_text() for line in comments)
    with pytest.raises(DataError, match="no effect tether"):
        hydro.add(true, found, ["tether"])


def test_a_log_is_imported_as_the_command_does(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "raw.parquet"
    code = cli.main(["import", EXAMPLE, "--map", MAP, "-o", str(path)])
    said = capsys.readouterr().err
    frame, report = hydro.import_log(EXAMPLE, MAP)
    assert code == 0
    assert frame.equals(table.read(path, "raw").frame)
    assert list(report.lines()) == said.splitlines()
    again, _ = hydro.import_log(EXAMPLE, report.map, rate=10.0)
    assert again["t"][1] - again["t"][0] == pytest.approx(0.1)
    with pytest.raises(DataError, match="velocity looks FLU"):
        hydro.import_log(EXAMPLE, strict=True)


def test_the_version_is_the_distributions() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "hydro", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"hydro {hydro.__version__}\n"
    with pytest.raises(AttributeError, match="no_such"):
        _ = hydro.no_such


def test_every_moved_module_is_where_the_table_says() -> None:
    assert [new for new in _moved.MODULES.values() if importlib.util.find_spec(new) is None] == []
    assert [old for old in _moved.MODULES if Path(ROOT, *old.split(".")).with_suffix(".py").exists()] == []


@pytest.mark.parametrize(
    ("line", "old", "new"),
    [
        ("import hydro.core.frames", "hydro.core.frames", "hydro.core.vehicle.frames"),
        ("from hydro.core import errors, labels", "hydro.core.labels", "hydro.core.distillation.labels"),
        ("from hydro.core.wiring import Wiring", "hydro.core.wiring", "hydro.core.audit.wiring"),
        ("from hydro.core.vehicle import Vehicle", "hydro.core.vehicle.Vehicle", "description.Vehicle"),
        ("from hydro.core.recording import recording", "hydro.core.recording.recording", "arrays.recording"),
    ],
)
def test_an_old_import_warns_once_and_gives_the_same_object(line: str, old: str, new: str) -> None:
    script = f"""
import sys, warnings
import hydro
with warnings.catch_warnings(record=True) as caught:
    warnings.simplefilter("always")
    exec(compile({line!r}, "theirs.py", "exec"))
    messages = [(str(one.message), one.filename) for one in caught if one.category is DeprecationWarning]
    assert len(messages) == 1, messages
    assert {old!r} in messages[0][0] and {new!r} in messages[0][0], messages
    assert messages[0][1] == "theirs.py", messages
moved = sys.modules.get({old!r})
if moved is not None:
    assert moved is sys.modules[moved.__name__]
    assert moved.__name__ == moved.__spec__.name
"""
    python(script)


def test_old_and_new_names_of_a_class_are_one() -> None:
    with pytest.warns(DeprecationWarning, match=r"hydro\.core\.vehicle\.Vehicle has moved"):
        from hydro.core.vehicle import Vehicle as old
    assert old is Vehicle


def test_what_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError):
        importlib.import_module("hydro.core.never")
    with pytest.raises(ImportError, match="Never"):
        from hydro.core.vehicle import Never  # noqa: F401


def test_submodules_are_not_taken_for_old_names() -> None:
    python(
        "from hydro.core.recording import segments; assert segments.__name__.endswith('.segments')", "-Werror"
    )


def test_nothing_in_hydro_uses_an_old_name() -> None:
    olds = tuple(f"{word} {old} " for old in _moved.MODULES for word in ("from", "import"))
    for path in (ROOT / "hydro").rglob("*.py"):
        lines = [line.strip() + " " for line in path.read_text().splitlines()]
        assert not [line for line in lines if line.startswith(olds)], path
