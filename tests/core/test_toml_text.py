"""TOML is taken apart in one place, and nothing in it is a bug of ours."""

from __future__ import annotations

import ast
import contextlib
import time
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from hydro import cli
from hydro.core import toml_text
from hydro.core.errors import DataError
from hydro.io import toml, vehicle

ROOT = Path(__file__).resolve().parents[2]
VEHICLE = ROOT / "datasets" / "stonefish" / "vehicle.toml"
MAP = ROOT / "datasets" / "logs" / "map.toml"
DIGITS = "1" + "0" * 5000


@given(st.text() | st.integers().map(str) | st.lists(st.integers()).map(str))
@example(DIGITS)
@example("[" * 5000)
@example("{a = [1, 9223372036854775808]}")
def test_a_value_is_read_or_refused(text: str) -> None:
    with contextlib.suppress(DataError):
        toml_text.value(text)


def test_integers_of_64_bits_are_all_there_are() -> None:
    assert toml_text.value(str(2**63 - 1)) == 2**63 - 1
    assert toml_text.value(str(-(2**63))) == -(2**63)
    with pytest.raises(DataError, match=r"value\[1\]\.mass: an integer of more than 64 bits"):
        toml_text.value(f"[1, {{mass = {2**63}}}]")


@pytest.mark.parametrize("mass", [DIGITS, str(10**400), str(2**63)])
def test_long_integers_are_told_in_one_short_line(
    mass: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "vehicle.toml"
    path.write_text(VEHICLE.read_text().replace("mass = 151.0", f"mass = {mass}"))
    assert cli.main(["check", str(path)]) == 1
    told = capsys.readouterr().err
    assert told.startswith(f"hydro: {path}: ")
    assert told.count("\n") == 1
    assert len(told) < 200 + len(str(path))
    collect = ["collect", "--vehicle", str(VEHICLE), "--rows", "9", "-o", str(tmp_path / "x.parquet")]
    for option in (["--noise", f"{{velocity={mass}}}"], ["--hide", f"payload={{mass={mass}}}"]):
        assert cli.main([*collect, *option]) in (0, 2)  # a float takes what an integer does not
        assert len(capsys.readouterr().err) < 400


@pytest.mark.parametrize(
    "deep",
    [
        ".".join(["a"] * 20_000) + " = 1",
        ".".join(['"a b"'] * 20_000) + " = 1",
        "[" + ".".join(["a"] * 20_000) + "]",
        "[[" + " . ".join(["a"] * 20_000) + "]]",
        "a = {" + ".".join(["a"] * 20_000) + " = 1}",
        "a = {b = 1, " + ".".join(["a"] * 20_000) + " = 1}",
        ".".join(["a"] * 40) + " = {" + ".".join(["a"] * 40) + " = 1}",
        "a = " + "[" * 200 + "]" * 200,
        "a = " + "[" * 20_000 + "]" * 20_000,
        "a = " + "{a = " * 200 + "1" + "}" * 200,
    ],
)
def test_what_is_nested_too_deeply_is_refused_at_once_and_in_one_line(
    deep: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "file.toml"
    for kind in (VEHICLE, MAP):
        path.write_text(f"{deep}\n{kind.read_text()}")
        began = time.process_time()
        assert cli.main(["check", str(path)]) == 1
        assert time.process_time() - began < 2.0
        told = capsys.readouterr().err
        assert told == f"hydro: {path}: nested more than 64 tables or lists deep: write a flatter file\n"
    with pytest.raises(DataError, match="nested more than 64"):
        toml_text.content(deep)


def test_what_only_looks_nested_is_read() -> None:
    assert toml_text.content(f"x = [{', '.join(['0.5'] * 200)}]")["x"] == [0.5] * 200
    words = ".".join(["a"] * 200)
    assert toml_text.content(f'x = "{words}" # {words} = 1') == {"x": words}
    assert toml_text.content(".".join(["a"] * 60) + " = 1")


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_a_byte_order_mark_is_no_part_of_a_file(mark: str, tmp_path: Path) -> None:
    text = VEHICLE.read_text()
    path = tmp_path / "vehicle.toml"
    path.write_text(mark + text)
    assert vehicle.read(path)[1] == text
    assert toml.read(path) == text
    path.write_text(text, encoding="utf-16")
    with pytest.raises(DataError, match="save the file as UTF-8"):
        vehicle.read(path)


def test_nothing_else_takes_toml_apart() -> None:
    found = []
    for path in (ROOT / "hydro").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import) and any(each.name == "tomllib" for each in node.names):
                found.append(path.name)
    assert found == ["toml_text.py"]
