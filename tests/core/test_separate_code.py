"""Callers of a separate kernel call its code: compiled, from the cache, and after it was compiled again."""

from __future__ import annotations

import warnings
from pathlib import Path
from types import ModuleType
from typing import Any

import numba
import pytest
from modules import imported

from hydro.core import kernel_cache, separate_code
from hydro.core.errors import HydroNotice
from hydro.core.kernel_cache import KernelCache

SOURCE = """
def inner(x):
    return 2.0 * x


def outer(x):
    return inner(x) + 1.0
"""


@pytest.fixture
def module(tmp_path: Path) -> ModuleType:
    (tmp_path / "nested.py").write_text(SOURCE)
    return imported(tmp_path / "nested.py")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HYDRO_CACHE_DIR", str(tmp_path / "cache"))
    kernel_cache.folder.cache_clear()
    found = kernel_cache.folder("kernels-of-a-test")
    kernel_cache.folder.cache_clear()
    assert found is not None
    return found


def in_new_process(
    module: ModuleType, place: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[float, dict[str, int], Any]:
    """Call `outer` as a process would that knows only the cache: value, loads of each kernel, dispatcher."""
    monkeypatch.setattr(separate_code, "_SYMBOLS", {})
    monkeypatch.setattr(separate_code, "_DISPATCHERS", {})
    functions = {name: getattr(module, name) for name in ("inner", "outer")}
    functions = {name: getattr(one, "py_func", one) for name, one in functions.items()}
    made = {}
    for name, function in functions.items():
        made[name] = numba.njit(function)
        made[name]._cache = KernelCache(function, place)
        setattr(module, name, made[name])
    separate_code.separate(made["inner"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", HydroNotice)
        value = made["outer"](3.0)
    return value, {name: sum(one.stats.cache_hits.values()) for name, one in made.items()}, made["outer"]


def test_a_caller_refers_to_separate_code_and_is_loaded_with_it(
    module: ModuleType, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    value, loaded, outer = in_new_process(module, place, monkeypatch)
    assert (value, loaded) == (7.0, {"inner": 0, "outer": 0})
    (result,) = outer.overloads.values()
    assert [one.kernel for one in separate_code.referred(result.library)] == ["inner"]
    value, loaded, _ = in_new_process(module, place, monkeypatch)
    assert (value, loaded) == (7.0, {"inner": 1, "outer": 1})


def test_a_caller_of_code_that_was_compiled_again_is_compiled_again(
    module: ModuleType, place: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    in_new_process(module, place, monkeypatch)
    for path in place.rglob("*inner*"):
        path.unlink()
    value, loaded, _ = in_new_process(module, place, monkeypatch)
    assert (value, loaded) == (7.0, {"inner": 0, "outer": 0})
    value, loaded, _ = in_new_process(module, place, monkeypatch)
    assert (value, loaded) == (7.0, {"inner": 1, "outer": 1})
