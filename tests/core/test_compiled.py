"""The cache of compiled kernels must see every source that a kernel can see."""

import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from hydro.core import compiled
from hydro.core.kernel_cache import KernelCache

LOADED = """
import pathlib, sys
import hydro.core.distillation.labels, hydro.core.prediction.multiple_shooting
import hydro.sim.bridge.callbacks, hydro.sim.teacher_plant
import hydro.rl.environment.action, hydro.rl.environment.step
for name, module in sorted(sys.modules.items()):
    if name.startswith("hydro.") and getattr(module, "__file__", None):
        print(module.__file__)
"""


def test_the_digest_covers_all_that_kernel_modules_load():
    """An import that the scan of the sources missed would leave stale machine code behind."""
    ran = subprocess.run([sys.executable, "-c", LOADED], capture_output=True, text=True, check=True)
    prepared = set(ran.stdout.split())
    seen = {str(path) for path in compiled.kernel_sources()}
    layers = {name for name in prepared - seen if any(f"/{part}/" in name for part in compiled.PARTS)}
    # `extras` only checks whether packages are installed, when a package is imported.
    assert {Path(name).name for name in layers} == {"__init__.py", "extras.py"}
    assert len(prepared) > 30


def test_what_no_kernel_sees_does_not_compile_everything_again():
    names = {path.name for path in compiled.kernel_sources()}
    assert "multiple_shooting.py" in names
    assert not names & {"search.py", "diagnose.py", "cli.py"}


def test_a_layer_sees_only_what_it_imports():
    layers = {
        part: {path.relative_to(compiled._PACKAGE).parts[0] for path in compiled.kernel_sources((part,))}
        for part in compiled.PARTS
    }
    assert layers["core"] == {"core"}
    assert layers["sim"] == {"core", "sim"}
    assert "rl" in layers["rl"]


def _doubled(x: float) -> float:
    return 2.0 * x


def test_kernels_are_cached_where_there_is_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compiled, "_cache_folder", lambda part: tmp_path)
    assert isinstance(compiled._cache(_doubled), KernelCache)
    monkeypatch.setattr(compiled, "_cache_folder", lambda part: None)
    assert compiled._cache(_doubled) is None


def test_a_function_that_stands_in_no_file_is_not_cached(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    typed: dict[str, Any] = {"__name__": "typed"}
    exec("def doubled(x):\n    return 2.0 * x\n", typed)
    monkeypatch.setattr(compiled, "_cache_folder", lambda part: tmp_path)
    assert compiled._cache(typed["doubled"]) is None
