"""Kernels whose arrays are not counted: none returns an array or calls what does, and no memory is lost."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Iterator

import numpy as np
import pytest
import recordings
from numba.core.dispatcher import Dispatcher

from hydro.core.compiled import copy_kernel, kernel
from hydro.core.diagnosis.baseline import stable_shots
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.effects.catalogue import own_effects
from hydro.core.identification.levenberg_marquardt import moved
from hydro.core.prediction.parameters import free
from hydro.core.simulation import simulate

SCALARS = {"np.float32", "None", "float", "int", "bool", "tuple[float, float]", "tuple[float, float, float]"}


def counted(function: Dispatcher) -> bool:
    """Whether it counts references; one whose body is written out in its caller is as its caller."""
    return function.targetoptions.get("_nrt", True) and function.targetoptions.get("inline") != "always"


def kernels() -> Iterator[Dispatcher]:
    for part in ("hydro.core", "hydro.sim", "hydro.rl"):
        package = importlib.import_module(part)
        for module in pkgutil.walk_packages(package.__path__, f"{part}."):
            for value in vars(importlib.import_module(module.name)).values():
                if isinstance(value, Dispatcher) and not value.targetoptions.get("_nrt", True):
                    yield value


def test_kernels_return_numbers_and_call_kernels_alone():
    """One that returned an array would free what is still in use; one that got any would never free it."""
    every = {each.py_func: each for each in kernels()}
    assert len(every) > 60
    for function in every:
        assert function.__annotations__.get("return", "None") in SCALARS, function
        called = [function.__globals__.get(name) for name in function.__code__.co_names]
        loose = [one for one in called if isinstance(one, Dispatcher) and counted(one)]
        assert not loose, (function, loose)


def test_a_kernel_that_makes_an_array_does_not_compile():
    @kernel
    def makes(x: np.ndarray) -> float:
        return float(np.zeros(3)[0] + x[0])

    with pytest.raises(Exception, match="array passed into the function"):
        makes(np.ones(3))


def test_a_copy_is_one():
    values, out = np.arange(5.0), np.zeros(3)
    copy_kernel(values, out)
    assert out.tolist() == [0.0, 1.0, 2.0]


def test_no_reference_is_kept_or_lost():
    """Arrays that kernels have worked on have as many references as before, whatever the route."""
    vehicle = recordings.damped()
    raw = recordings.noisy(recordings.moved(vehicle), 0)
    problem = stable_shots(vehicle, preprocess(vehicle, raw))
    unknown = free(vehicle, own_effects(vehicle))
    arrays = [problem.shots.first, problem.shots.measured, problem.shots.record.commands]
    before = [sys.getrefcount(array) for array in arrays]
    for _ in range(3):
        normal = problem.linearise(vehicle, *moved(unknown, unknown.starts[0]))
        problem.cost(vehicle, np.zeros(len(unknown.entries)), normal)
        simulate.simulate(vehicle, raw)
    assert [sys.getrefcount(array) for array in arrays] == before
