"""The cache of compiled kernels must see every source that a kernel can see."""

import subprocess
import sys
from pathlib import Path

from hydro.core import compiled

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
    assert {Path(name).name for name in layers} == {"__init__.py"}
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
