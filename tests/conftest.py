"""Fixtures and Hypothesis profiles shared by all tests."""

from __future__ import annotations

import contextlib
import gc
import os
import sys
from pathlib import Path

import compile_once
import forked
import once
import pytest
from hypothesis import HealthCheck, settings

from benchmarks import nodes

# Where a shell says that Python leaves no compiled files, every process would compile every module anew.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# TorchRL imports Ray, which reads its environment once: before any test module is collected.
os.environ.update(nodes.AUTHENTICATION)

if "PYTEST_XDIST_WORKER" in os.environ:
    compile_once.install()
once.install()

# Modules and tests that are collected stay to the end: to look for garbage among them takes a second.
gc.disable()

settings.register_profile(
    "ci", derandomize=True, deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.register_profile("fuzz", deadline=None, max_examples=2000)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "ci"))


LONG = tuple(
    f"test_{name}" for name in ("cluster", "contributing", "demo", "kills", "readme", "tutorial", "wheel")
)
"""Files with tests of up to a minute: at the end, the others would wait for them with nothing else to do."""


def pytest_configure(config: pytest.Config) -> None:
    """Let all workers of a run fork their commands from one process."""
    if "PYTEST_XDIST_WORKER" not in os.environ and config.getoption("numprocesses", None):
        kept = contextlib.ExitStack()
        config.add_cleanup(kept.close)
        os.environ[forked.SHARED] = str(kept.enter_context(forked.offered()))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with the longest tests; the others keep their order."""
    items.sort(key=lambda item: item.path.stem not in LONG)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Let a test use recordings that others have preprocessed, unless it changes how that is done."""
    once.kept_for(item)


def pytest_collection_finish() -> None:
    """Leave what all tests and libraries hold out of every later collection of garbage: it stays anyway."""
    freeze()
    gc.enable()


def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    """Do so again after each file, as tests import large libraries when they first need them."""
    if nextitem is not None and nextitem.path != item.path:
        freeze()


def freeze() -> None:
    """Collect the garbage, and take all that is left out of later collections."""
    gc.collect()
    gc.freeze()


ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "data" / "stonefish"


@pytest.fixture(scope="session")
def stonefish() -> Path:
    """Folder of the full Stonefish recordings; tests that need it skip where it is absent."""
    from benchmarks.full_recordings import installed

    found = installed() or SHARED
    if not (found / "nominal.parquet").exists():
        pytest.skip(
            "the full Stonefish recordings are not installed (datasets/README.md), nor beside this checkout"
        )
    return found


@pytest.fixture(scope="session")
def datasets() -> Path:
    """Folder of the bundled samples."""
    return ROOT / "datasets"
