"""What `make install` compiles: the kernels of the commands that a new user runs first."""

from __future__ import annotations

import warnings
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from hydro.core import compiled, kernel_cache
from hydro.core.errors import HydroNotice
from hydro.study import kernels

MAKEFILE = Path(__file__).resolve().parents[1] / "Makefile"


@pytest.mark.slow
def test_the_kernels_are_compiled_and_kept(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process, which has the libraries already; `make install` starts two."""
    monkeypatch.setattr(kernels, "ProcessPoolExecutor", lambda *_, **__: ThreadPoolExecutor(1))
    kernels.main(seconds=10.0)
    assert "compiled in" in capsys.readouterr().out
    kernel_cache._announce_compilation.cache_clear()
    with warnings.catch_warnings():
        warnings.simplefilter("error", HydroNotice)
        for layer in ("core", "sim"):
            kernel_cache._announce_compilation(str(compiled._cache_folder(layer)))


def test_the_installation_compiles_them() -> None:
    recipe = MAKEFILE.read_text().partition("$(STAMP): pyproject.toml")[2].partition("@touch $@")[0]
    assert "-m hydro.study.kernels" in recipe
    assert "-m benchmarks.kernels" in recipe
