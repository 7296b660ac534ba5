"""Tests of a changed tree in a forked process, in which the large libraries are loaded already."""

from __future__ import annotations

import contextlib
import gc
import importlib
import importlib.metadata
import json
import os
import resource
import select
import signal
import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

LIBRARIES = (
    *(
        "numba",
        "numpy",
        "polars",
        "pyarrow.parquet",
        "msgspec",
        "tomlkit",
        "filelock",
        "pytest",
        "hypothesis",
    ),
    *("hypothesis.strategies", "hypothesis.extra.numpy", "scipy.optimize", "scipy.special", "scipy.signal"),
    *("scipy.interpolate", "scipy.spatial.transform", "scipy.integrate", "scipy.stats", "scipy.linalg"),
    *("torch", "mujoco", "gymnasium", "tensordict", "torchrl", "typer", "rich", "filterpy.kalman"),
)
"""Imported before the first fork if a tree needs them: five seconds less for each mutant.  None starts a
thread."""
PER_TEST = 20.0
"""Processor time of one test, compilation aside, after which it hangs [s]; tests marked slow are left out."""
LONG = 0.1
"""Share of a mutant's time from which a test waits until all shorter ones of the near files have run."""
SHORT = 0.25
"""Share of a mutant's time that its last test is allowed at least."""
COMPILING = 240.0
"""Processor time allowed for compilation in one process [s]: all kernels take about a hundred."""
PATIENCE = 12.0
"""Wall time per second of processor time, on a machine that others use too."""
TOO_LONG = (signal.SIGXCPU, signal.SIGKILL)
"""Signals that end a process which has used up its processor or wall time."""
FIRST_BATCH = 2
"""Files collected at once at the start; each following batch is twice as large."""


@dataclass
class Outcome:
    """Result of the tests.

    Attributes:
        status: `passed`, `failed`, `hung` or `crashed`.
        by: The test that failed, hung, or ran last.
        allowed: Processor time that the last test was allowed [s].
        passed: Tests that passed, and the processor time of each [s].
        seconds: Processor time, including that of child processes [s].
    """

    status: str
    by: str = ""
    allowed: float = PER_TEST
    passed: dict[str, float] = field(default_factory=dict)
    seconds: float = 0.0


@dataclass(frozen=True)
class Plan:
    """Plan of a test run.

    Attributes:
        tree: The tree that is tested.
        plan: File that describes the change to `locator`.
        affected: Compiled functions, `module:name`, that the change reaches.
        interpreted: Whether these functions run as Python.
        seconds: Processor time after which no further test begins [s].
        per_test: Processor time after which a test counts as hung [s].
        took: Known processor times of tests [s]; those that take LONG come last.
    """

    tree: Path
    plan: Path
    affected: frozenset[str]
    interpreted: bool
    seconds: float
    per_test: float = PER_TEST
    took: Mapping[str, float] = field(default_factory=dict)

    @property
    def most(self) -> float:
        """Greatest processor time of the whole process [s]."""
        return self.seconds + 2.0 * self.per_test + COMPILING


def preload(needed: Iterable[str]) -> None:
    """Import pytest with its plugins, and those heavy libraries whose first name is needed."""
    first = {"pytest", "hypothesis", *needed}  # the latter by its plugin
    for name in LIBRARIES:
        if name.partition(".")[0] in first:
            with contextlib.suppress(ImportError):
                importlib.import_module(name)
    for plugin in importlib.metadata.entry_points(group="pytest11"):
        with contextlib.suppress(ImportError):
            plugin.load()
    gc.collect()
    gc.freeze()


def run(plan: Plan, files: Sequence[str], skipped: Sequence[str] = ()) -> Outcome:
    """Run files of tests, or single tests, in order until one fails or the time is up."""
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        os.close(reading)
        _child(plan, files, skipped, writing)
    os.close(writing)
    outcome = Outcome("crashed")
    for said in _lines(reading, time.monotonic() + PATIENCE * plan.most):
        what, test = said["what"], said["test"]
        outcome.by = test or outcome.by
        outcome.allowed = said["allowed"]
        if what == "passed":
            outcome.passed[test] = said["took"]
        elif what == "done":
            outcome.status, outcome.by = "passed", ""
        elif what != "began":
            outcome.status = what
    with contextlib.suppress(ProcessLookupError):
        os.killpg(child, signal.SIGKILL)
    _, ended, used = os.wait4(child, 0)
    if outcome.status == "crashed" and os.WIFSIGNALED(ended) and os.WTERMSIG(ended) in TOO_LONG:
        outcome.status = "hung"
    outcome.seconds = used.ru_utime + used.ru_stime
    return outcome


def _lines(reading: int, until: float) -> Iterator[dict[str, Any]]:
    """Yield the messages of the child process until it ends or the time is up."""
    with os.fdopen(reading, "rb") as pipe:
        rest = b""
        while (left := until - time.monotonic()) > 0.0:
            if not select.select([pipe], [], [], left)[0]:
                return
            part = os.read(pipe.fileno(), 1 << 16)
            if not part:
                return
            *whole, rest = (rest + part).split(b"\n")
            yield from map(json.loads, whole)


def _child(plan: Plan, files: Sequence[str], skipped: Sequence[str], writing: int) -> NoReturn:
    """Set up the process for the tree and run its tests."""
    code = 1
    try:
        os.setpgid(0, 0)
        quiet = os.open(os.devnull, os.O_RDWR)
        for stream in (0, 1, 2):
            os.dup2(quiet, stream)
        limit = int(plan.most)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
        _move_to(plan)
        watch = _Watch(plan, writing)
        _tests(watch, files, skipped)
        code = 0
    finally:
        os._exit(code)


def _move_to(plan: Plan) -> None:
    """Make this process and its child processes import from the tree."""
    here = {name.partition(".")[0] for name in _packages(plan.tree)}
    for name in [name for name in sys.modules if name.partition(".")[0] in here]:
        del sys.modules[name]
    checkout = str(Path(__file__).resolve().parents[2])
    sys.path[:] = [
        str(plan.tree),
        *(path for path in sys.path if Path(path or ".").resolve() != Path(checkout)),
    ]
    importlib.invalidate_caches()
    os.chdir(plan.tree)
    locator = "benchmarks.mutants.locator.Locator"
    os.environ |= {
        "PYTHONPATH": str(plan.tree),
        "HYDRO_MUTANT": str(plan.plan),
        **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1"),
    }
    if (plan.tree / "benchmarks" / "mutants" / "locator.py").exists():
        import numba

        os.environ["NUMBA_CACHE_LOCATOR_CLASSES"] = locator
        numba.config.CACHE_LOCATOR_CLASSES = locator
        if plan.interpreted:
            _interpret(plan.affected)


def _packages(tree: Path) -> Iterator[str]:
    """Yield the importable names at the top of a tree."""
    for path in tree.iterdir():
        if path.is_dir() and path.name.isidentifier():
            yield path.name


def _interpret(affected: frozenset[str]) -> None:
    """Make Numba leave the affected functions as Python functions."""
    import numba
    import numpy as np

    np.seterr(all="ignore")  # as in compiled code
    compiling = numba.njit

    def njit(*arguments: Any, **options: Any) -> Any:
        function = arguments[0] if arguments else None
        if callable(function) and f"{function.__module__}:{function.__name__}" in affected:
            plain: Any = function
            plain.enable_caching, plain.py_func = (lambda: None), function
            return plain
        return compiling(*arguments, **options)

    numba.njit = njit


def _tests(watch: _Watch, files: Sequence[str], skipped: Sequence[str]) -> None:
    """Run batches of test files until a test does not pass."""
    import pytest

    options = ["-q", "-x", "-p", "no:cacheprovider", "-p", "no:xdist", "-m", "not slow"]
    options += ["-W", "ignore::RuntimeWarning"] if watch.lenient else []
    options += [f"--deselect={test}" for test in skipped]
    kept = [file for file in files if file not in skipped]
    long = {test for test, took in watch.took.items() if took > LONG * watch.seconds}
    for watch.long in (False, True):
        if watch.long:
            kept = [file for file in kept if any(test.startswith(file) for test in long)]
        begin, size = 0, FIRST_BATCH
        while begin < len(kept) and not watch.stopped:
            pytest.main([*options, *kept[begin : begin + size]], plugins=[watch])
            begin, size = begin + size, 2 * size
    if not watch.failed:
        watch.say("done", "")


class _Watch:
    """Plug-in of pytest that reports each test, and ends the run where one fails, hangs or takes too long."""

    def __init__(self, plan: Plan, writing: int) -> None:
        self.seconds, self.per_test, self.lenient = plan.seconds, plan.per_test, plan.interpreted
        self.writing, self.took = writing, plan.took
        self.failed = self.stopped = self.long = False
        self.test, self.began, self.allowed, self.compiling = "", 0.0, self.per_test, _Clock()
        signal.signal(signal.SIGPROF, self._alarm)

    def say(self, what: str, test: str) -> None:
        took = self._used() - self.began
        told = {"what": what, "test": test, "allowed": self.allowed, "took": round(took, 2)}
        os.write(self.writing, json.dumps(told).encode() + b"\n")

    def _used(self) -> float:
        """Return the processor time without compilation [s]."""
        own, children = (resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
        whole = own.ru_utime + own.ru_stime + children.ru_utime + children.ru_stime
        return whole - self.compiling.seconds()

    def _alarm(self, number: int, frame: object) -> None:
        left = self.began + self.allowed - self._used()
        if left <= 0.0:
            self.say("hung", self.test)
            os._exit(3)
        signal.setitimer(signal.ITIMER_PROF, left + 0.1)

    def pytest_collection_modifyitems(self, config: Any, items: list[Any]) -> None:
        """Keep the tests of this round, the quicker ones of each file first."""
        limit = LONG * self.seconds
        files = list(dict.fromkeys(item.nodeid.partition("::")[0] for item in items))
        order = {file: place for place, file in enumerate(files)}

        def key(item: Any) -> tuple[int, float]:
            return order[item.nodeid.partition("::")[0]], self.took.get(item.nodeid, 0.0)

        kept = [item for item in items if (self.took.get(item.nodeid, 0.0) > limit) == self.long]
        config.hook.pytest_deselected(items=[item for item in items if item not in kept])
        items[:] = sorted(kept, key=key)

    def pytest_runtest_logstart(self, nodeid: str, location: object) -> None:
        self.test, self.began = nodeid, self._used()
        self.allowed = min(self.per_test, max(self.seconds - self.began, SHORT * self.seconds))
        self.say("began", nodeid)
        signal.setitimer(signal.ITIMER_PROF, self.allowed)

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self.failed = self.stopped = True
            self.say("failed", report.nodeid)
        elif report.when == "call" and report.passed:
            self.say("passed", report.nodeid)

    def pytest_runtest_logfinish(self, nodeid: str, location: object) -> None:
        signal.setitimer(signal.ITIMER_PROF, 0.0)

    def pytest_collectreport(self, report: Any) -> None:
        if report.failed:
            self.failed = self.stopped = True
            self.say("failed", report.nodeid)

    def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> None:
        if self._used() > self.seconds:
            self.stopped = True
            item.session.shouldstop = "time is up"


class _Clock:
    """Processor time that Numba has spent on compilation so far."""

    def __init__(self) -> None:
        clock = self
        self.depth, self.began, self.done = 0, 0.0, 0.0
        if "numba" not in sys.modules:
            return
        from numba.core import event

        class Listener(event.Listener):  # type: ignore[misc]
            def on_start(self, event: object) -> None:
                if not clock.depth:
                    clock.began = time.process_time()
                clock.depth += 1

            def on_end(self, event: object) -> None:
                clock.depth -= 1
                if not clock.depth:
                    clock.done += time.process_time() - clock.began

        event.register("numba:compile", Listener())

    def seconds(self) -> float:
        """Return the compilation time until now [s], including a compilation in progress."""
        return self.done + (time.process_time() - self.began if self.depth else 0.0)
