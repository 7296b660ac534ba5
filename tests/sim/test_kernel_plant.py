"""Vehicles in the project's own kernels: the same motion as in MuJoCo, up to the errors of integration."""

import msgspec
import numpy as np
import pytest
from effects import EFFECTS, with_effect
from sim.simulated_network import COUNT, PERIOD, STEPS, craft, flown, waters

from hydro.core.errors import DataError, UsageError
from hydro.io.files import bundled
from hydro.sim.bridge.water import dry, residual, wet
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.plant import StudentPlant
from hydro.sim.student import Physics

KNOWN = craft(bundled("vehicles") / "auv151.toml")
COMMANDS = np.random.default_rng(6).uniform(-0.6, 0.6, (STEPS, COUNT, len(KNOWN.thruster)))
WATERS = waters(KNOWN) | {"effects": wet}


def kernels(water=wet, timestep=0.01, vehicle=KNOWN, **more):
    return KernelPlant(vehicle, water, count=COUNT, period=PERIOD, timestep=timestep, **more)


@pytest.mark.parametrize("name", WATERS)
def test_half_the_step_brings_both_engines_together(name):
    """The difference is the error of integration: of order 4 in kernels, of order 1 in MuJoCo at 500 Hz."""
    ends = {step: flown(kernels(WATERS[name], step), COMMANDS) for step in (0.02, 0.01, 0.005)}
    fine = flown(kernels(WATERS[name], 0.00125), COMMANDS)
    error = {step: np.abs(end - fine).max() for step, end in ends.items()}
    assert error[0.01] < 0.15 * error[0.02]
    assert error[0.005] < 0.15 * error[0.01]
    apart = [
        np.abs(flown(student(WATERS[name], Physics(step)), COMMANDS) - fine).max() for step in (0.002, 0.001)
    ]
    assert error[0.01] < 0.05 * apart[0]
    assert apart[1] == pytest.approx(0.5 * apart[0], rel=0.1)


def student(water, physics):
    return StudentPlant(KNOWN, water, count=COUNT, physics=physics, period=PERIOD)


def test_every_effect_acts_as_in_mujoco():
    known = KNOWN
    for name in EFFECTS:
        known = with_effect(known, name)
    here = StudentPlant(known, count=COUNT, physics=Physics(0.001, "rk4"), period=PERIOD)
    np.testing.assert_allclose(
        flown(kernels(vehicle=known, timestep=0.002), COMMANDS), flown(here, COMMANDS), atol=1e-5
    )


def test_a_network_holds_its_wrench_over_several_control_steps_of_the_vehicle():
    water, held = WATERS["physfeat, conditioned"], np.repeat(COMMANDS, 2, axis=0)
    twice = KernelPlant(KNOWN, water, count=COUNT, period=PERIOD / 2, timestep=0.01)
    np.testing.assert_allclose(flown(twice, held), flown(kernels(water), COMMANDS), atol=1e-12)


def test_threads_do_not_change_a_bit():
    ends = [flown(kernels(WATERS["physfeat, conditioned"], threads=n), COMMANDS) for n in (1, 2)]
    np.testing.assert_array_equal(*ends)


def test_a_changed_vehicle_flies_as_if_it_had_been_given_first():
    water = WATERS["mlp beside effects"]
    heavier = msgspec.structs.replace(
        KNOWN, rigid_body=msgspec.structs.replace(KNOWN.rigid_body, mass=1.1 * KNOWN.rigid_body.mass)
    )
    mixed, alone = kernels(water), kernels(water, vehicle=heavier)
    mixed.change({1: heavier})
    first, second = flown(mixed, COMMANDS), flown(alone, COMMANDS)
    np.testing.assert_array_equal(first[1], second[1])
    assert not np.allclose(first[0], second[0])
    mixed.change({1: KNOWN})
    np.testing.assert_array_equal(flown(mixed, COMMANDS), flown(kernels(water), COMMANDS))


def test_a_network_and_its_memory_are_restored():
    plant = kernels(WATERS["temporal"])
    flown(plant, COMMANDS[:3])
    kept = plant.snapshot()
    plant.step(COMMANDS[4])
    ahead = plant.snapshot()
    plant.restore(kept)
    plant.step(COMMANDS[4])
    again = plant.snapshot()
    assert all(np.array_equal(ahead[name], again[name]) for name in ahead)
    assert np.abs(ahead["control"]).max() > 0.0


@pytest.mark.parametrize(
    ("arguments", "error", "said"),
    [
        ({"water": residual}, UsageError, "act only in MuJoCo: use its engine"),
        ({"water": lambda one: dry(one, ellipsoid=True)}, UsageError, "MuJoCo's own fluid forces"),
        ({"water": WATERS["physfeat"], "period": 0.03}, UsageError, "set period=0.04, or a whole fraction"),
        ({"water": WATERS["physfeat"], "period": 0.08}, UsageError, "set period=0.04"),
        ({"timestep": 0.0}, UsageError, "timestep: expected a positive number"),
        ({"vehicle": msgspec.structs.replace(KNOWN, thruster=())}, DataError, "has no thrusters"),
    ],
)
def test_what_cannot_be_simulated_is_refused_in_one_line(arguments, error, said):
    with pytest.raises(error, match=said) as told:
        KernelPlant(**({"vehicle": KNOWN} | arguments))
    assert "\n" not in str(told.value)


def test_a_vehicle_with_other_thrusters_is_refused():
    with pytest.raises(DataError, match="other thrusters"):
        kernels().change({0: msgspec.structs.replace(KNOWN, thruster=KNOWN.thruster[:4])})
