"""Tasks on a GPU: in a GPU simulator compared with the processor's fleet, and compiled."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import pytest
from cuda_simulator import found_by

from hydro.io.files import bundled

HERE = Path(__file__).parent
CRAFT = bundled("vehicles") / "auv151.toml"
pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason="the extra gpu is not installed"
)


@pytest.fixture(scope="module")
def simulated():
    return found_by(HERE / "simulated_fleet.py", CRAFT)


def test_what_is_sensed_and_earned_is_that_of_the_processors_fleet_to_the_bit(simulated):
    found = simulated["row"]
    assert found["ended"] >= 12, "vehicles begin anew, twice each"
    assert found["seen"] == found["paid"] == 0.0
    assert found["same"], "who arrived, touched, diverged, and whose episode ended"


def test_torchrl_knows_it_and_a_demand_that_is_no_number_ends_an_episode(simulated):
    env = simulated["env"]
    assert env["lost"] == env["over"] == [False, True, False]
    assert env["anew"], "he begins anew"
    assert env["kept"], "the others go on"


def test_what_does_not_run_there_is_refused_in_one_line(simulated):
    said = simulated["refused"]
    assert [any(word in text for text in said) for word in ("history", "has a plan", "goal that moves")]
    assert len(said) == 4
    assert not any("\n" in text for text in said)


def test_the_kernels_compile_for_a_gpu_and_make_no_arrays(monkeypatch):
    """Kernels are compiled to PTX if the compiler's wheels are installed."""
    pytest.importorskip("cuda.bindings.nvvm", reason="the CUDA compiler's bindings are not installed")
    from numba import cuda, types

    from hydro.rl.environment.blocks import Episodes, Motion, Outcome, Rules, Scenes, Senses
    from hydro.rl.gpu import kernels

    monkeypatch.setattr(  # which asks the driver what it compiles for
        "numba.cuda.dispatcher.get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0))
    )

    def array(kind, dimensions):
        return types.Array(getattr(types, kind), dimensions, "C")

    def block(kind, *parts):
        return types.NamedTuple([array("float64", n) if isinstance(n, int) else n for n in parts], kind)

    mask = array("boolean", 1)
    scenes, episodes = block(Scenes, 2, 2, 2, 2, 3, 1), block(Episodes, 1, 2, 1, 2)
    motion, demands = block(Motion, 2, 2, 2, 2, mask, 2), block(kernels.Demands, 2, 2)
    senses = block(Senses, array("float32", 2), 2, types.float64, 1, types.float64, 1)
    starts = block(kernels.Starts, mask, array("int64", 1), 2)
    outcome = block(Outcome, array("float32", 1), array("boolean", 2), array("float64", 2))
    for kernel, arguments in (
        (kernels.place, (block(kernels.Pool, 2, 2, 3), starts, scenes, episodes)),
        (kernels.command, (block(kernels.Allocation, 2, 2, 1), demands)),
        (
            kernels.observe,
            (senses, motion, scenes, episodes, block(kernels.View, mask, 2, array("float32", 2))),
        ),
        (kernels.evaluate_step, (block(Rules, 1, 1, 2, 1), motion, scenes, episodes, demands, outcome)),
    ):
        ptx, result = cuda.compile_ptx(kernel.py_func, arguments, cc=(9, 0), opt=False)
        text = ptx if isinstance(ptx, str) else ptx.decode()
        assert result == types.none
        assert ".visible .entry" in text
        assert "malloc" not in text, "no thread makes arrays"
