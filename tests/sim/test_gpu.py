"""Vehicles on a GPU: numba-cuda's simulator compared with `simulate`, and compilation without a GPU."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import SimpleNamespace

import pytest
from cuda_simulator import found_by

import hydro
from hydro.core.errors import UsageError
from hydro.io import vehicle as files
from hydro.io.files import bundled

HERE = Path(__file__).parent
CRAFT = bundled("vehicles") / "auv151.toml"
needs_numba_cuda = pytest.mark.skipif(
    importlib.util.find_spec("numba_cuda") is None, reason="the extra gpu is not installed"
)


@pytest.fixture
def craft():
    return files.read(CRAFT)[0]


@pytest.fixture(scope="module")
def simulated():
    return found_by(HERE / "simulated_gpu.py", CRAFT)


@pytest.fixture(scope="module")
def networked():
    return found_by(HERE / "simulated_network.py", CRAFT)


@needs_numba_cuda
def test_vehicles_of_two_kinds_fly_as_simulate_says(simulated):
    assert simulated["difference"] < 1e-12
    assert simulated["moved"] > 0.05, "each of them"
    assert simulated["kinds_apart"] > 1e-4
    assert simulated["states"] > 13, "effects with states fly along"


@needs_numba_cuda
def test_a_snapshot_brings_them_back_bit_for_bit(simulated):
    assert simulated["back"]


@needs_numba_cuda
def test_who_leaves_the_realm_of_numbers_is_told_until_reset(simulated):
    assert simulated["lost"] == [5]
    assert simulated["found_again"]


@needs_numba_cuda
def test_commands_of_another_shape_are_refused(simulated):
    assert [text.split(",")[0] for text in simulated["refused"]] == [
        "commands: expected float64 of shape (12",
        "commands: expected float64 of shape (12",
    ]
    assert len(simulated["refused"]) == 2


@needs_numba_cuda
def test_residual_networks_fly_as_in_mujoco_whatever_they_are_and_stand_beside(networked):
    """Test architectures with memory, passivity and conditioning, with effects or in a current."""
    flights = networked["flights"]
    assert len(flights) == 7
    for name, flight in flights.items():
        assert flight["apart"] < 1e-7, name
        assert name == "no water" or flight["of_the_network"] > 0.05, name


@needs_numba_cuda
def test_what_a_network_remembers_comes_back_bit_for_bit(networked):
    assert networked["back"]
    assert networked["remembers"] > 0.0


@needs_numba_cuda
def test_water_that_only_mujoco_has_and_another_control_step_are_refused(networked):
    of_the_host, step = networked["refused"]
    assert "wrenches of the host" in of_the_host
    assert "set period=0.04" in step


@needs_numba_cuda
def test_the_step_compiles_for_a_gpu_with_every_effect_there_is_and_a_network(monkeypatch):
    """Kernels compile to PTX if the compiler's wheels are installed; dispatchers hold the whole catalogue."""
    pytest.importorskip("cuda.bindings.nvvm", reason="the CUDA compiler's bindings are not installed")
    from numba import cuda, types

    from hydro.core.effects.program import DISPATCHED
    from hydro.sim.flight import Fleet, Pace
    from hydro.sim.gpu import kernels
    from hydro.sim.plant import Readings

    assert len(DISPATCHED) > 10
    monkeypatch.setattr(  # which asks the driver what it compiles for
        "numba.cuda.dispatcher.get_current_device", lambda: SimpleNamespace(compute_capability=(9, 0))
    )

    def block(kind, *dimensions):
        arrays = [types.Array(types.float64, n, "C") if isinstance(n, int) else n for n in dimensions]
        return types.NamedTuple(arrays, kind)

    arguments = (
        block(kernels.Crafts, 2, 3, types.Array(types.int32, 1, "C"), 2, 2),
        block(kernels.Control, 1, 3, 2, types.Array(types.float32, 1, "C"), 2, types.int64),
        block(Fleet, 2, 2, 3, 1),
        block(Readings, 2, 2, 2, 2, types.Array(types.boolean, 1, "C")),
        block(Pace, types.float64, types.int64, types.float64),
        block(kernels.Orders, 2),
    )
    ptx, result = cuda.compile_ptx(
        kernels.step_kernel(kernels.Sizes(4, 8, 3, work=563, scratch=218)).py_func,
        arguments,
        cc=(9, 0),
        opt=False,
    )
    text = ptx if isinstance(ptx, str) else ptx.decode()
    assert result == types.none
    assert ".target sm_90" in text
    assert ".visible .entry" in text
    assert "fma.rn.f64" in text
    assert "malloc" not in text, "no thread makes arrays"


def test_without_numba_cuda_one_line_says_what_to_install(craft, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(UsageError, match="extra `gpu`") as told:
        hydro.student(craft, device="cuda")
    assert "\n" not in str(told.value)


@needs_numba_cuda
def test_without_a_gpu_one_line_says_so(craft, monkeypatch):
    monkeypatch.setattr("numba.cuda.is_available", lambda: False)
    with pytest.raises(UsageError, match="finds no GPU") as told:
        hydro.student(craft, device="cuda")
    assert "\n" not in str(told.value)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({"device": "tpu"}, "expected cpu or cuda, got tpu"),
        ({"count": 2}, "count means nothing with device='cpu'"),
        ({"period": 0.04}, "period means nothing with device='cpu'"),
        ({"device": "cuda", "integrator": "rk4"}, "integrator means nothing with device='cuda'"),
        ({"device": "cuda", "folder": "."}, "folder means nothing with device='cuda'"),
    ],
)
def test_arguments_of_the_other_device_are_refused(craft, arguments, said):
    with pytest.raises(UsageError, match=said):
        hydro.student(craft, **arguments)


@pytest.mark.parametrize("name", ["count", "period", "timestep"])
@pytest.mark.parametrize("value", [0, -1, float("nan")])
def test_what_no_number_of_vehicles_and_no_step_can_be_is_refused(craft, monkeypatch, name, value):
    monkeypatch.setattr("hydro.sim.gpu.memory.require", lambda: None)
    with pytest.raises(UsageError, match=f"{name}: expected a positive number"):
        hydro.student(craft, device="cuda", **{name: value})
