"""On an axis that a controller holds, its thrusts oppose the disturbance: accelerations say no direction."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import numpy as np
import pytest

from hydro.core.audit.thrusters import audit
from hydro.core.recording.arrays import Recording
from hydro.core.recording.feedback import feedback
from hydro.core.vehicle.description import Buoyancy, Hull, RigidBody, Thruster, Vehicle

DT, ROWS = 0.05, 6000
MASS, INERTIA, ARM, THRUST, LIFT = 50.0, 5.0, 0.4, 20.0, 0.05
NOISE = {"angle": 0.003, "rate": 0.006, "place": 0.02, "speed": 0.01}  # rad, rad/s, m and m/s


def vehicle() -> Vehicle:
    """Two vertical thrusters, fore and aft, on a hull whose centre of buoyancy is LIFT above its centre."""
    return Vehicle(
        name="pair",
        rigid_body=RigidBody(MASS, (0.0, 0.0, 0.0), tuple(map(tuple, INERTIA * np.eye(3)))),
        buoyancy=Buoyancy(MASS * 9.81, (0.0, 0.0, -LIFT)),
        hull=Hull(1.0, 0.3, 0.3),
        thruster=(
            Thruster("F", THRUST, THRUST, wrench=(0, 0, 1.0, 0, -ARM, 0)),
            Thruster("A", THRUST, THRUST, wrench=(0, 0, 1.0, 0, ARM, 0)),
        ),
    )


def wandering(rng: np.random.Generator) -> np.ndarray:
    """A signal of unit size with a time constant of 1.6 s, (ROWS,)."""
    out = np.zeros(ROWS)
    for k in range(1, ROWS):
        out[k] = 0.97 * out[k - 1] + rng.standard_normal()
    return out / out.std()


def held(seed: int, moment: float, gain: float, sign: float = 1.0) -> Recording:
    """Heave by a plan, and pitch held by a controller against a moment [N m] that the file lacks.

    `sign` is -1 where the log has the two commands the other way round.
    """
    rng = np.random.default_rng(seed)
    plan, push = 0.3 * wandering(rng), moment * wandering(rng)
    z = w = theta = q = 0.0
    eta, nu, commands = np.zeros((ROWS, 6)), np.zeros((ROWS, 6)), np.zeros((ROWS, 2))
    for k in range(ROWS):
        eta[k, [2, 4]] = np.array([z, theta]) + [NOISE["place"], NOISE["angle"]] * rng.standard_normal(2)
        nu[k, [2, 4]] = np.array([w, q]) + [NOISE["speed"], NOISE["rate"]] * rng.standard_normal(2)
        pitch = -gain * (eta[k, 4] + 0.5 * nu[k, 4])
        drive = np.clip(plan[k] + pitch * np.array([-1.0, 1.0]), -1.0, 1.0)
        commands[k] = drive[:: int(sign)]
        w += DT * (THRUST * drive.sum() - 30.0 * w) / MASS
        turn = ARM * THRUST * (drive[1] - drive[0]) + push[k]
        q += DT * (turn - 2.0 * q - MASS * 9.81 * LIFT * np.sin(theta)) / INERTIA
        z, theta = z + DT * w, theta + DT * q
    one = np.zeros(1, np.int64)
    return Recording(
        np.arange(ROWS) * DT, eta, nu, commands, np.array([[0, ROWS]]), np.zeros(1, bool), one, DT
    )


@pytest.mark.parametrize("seed", range(2))
def test_thrusts_that_a_controller_makes_do_not_scale_the_thrusters(seed):
    """Accelerations in pitch alone give 3.6 times the thrust; those in heave give that of the file."""
    found = audit(vehicle(), held(seed, moment=2.0, gain=0.3))
    assert found is not None
    assert not found.wrong
    np.testing.assert_array_equal(np.flatnonzero(found.held), [4])
    assert found.scale[0] == pytest.approx(1.0, abs=0.1)
    assert "a controller opposes the motion on pitch" in " ".join(found.lines())


@pytest.mark.parametrize("moment", [0.5, 2.0])
def test_exchanged_thrusters_are_found_under_feedback(moment):
    """By the file, the demand then follows the motion instead of opposing it, and its accelerations count."""
    record = held(0, moment, gain=0.3, sign=-1.0)
    found = audit(vehicle(), record)
    assert found is not None
    assert not found.held.any()
    assert found.wrong
    assert found.wiring.column == (1, 0)


def test_without_any_other_axis_the_audit_says_nothing_on_directions():
    record = held(0, moment=2.0, gain=0.3)
    still = replace(record, seen=np.tile(np.arange(12) % 6 != 2, (ROWS, 1)))
    found = audit(vehicle(), still)
    assert found is not None
    assert not found.wrong
    assert not found.clear.any()
    assert any("does not show the direction" in line or "act alike" in line for line in found.lines())


def test_a_demand_by_a_reversed_file_follows_the_motion():
    record = held(0, moment=2.0, gain=0.3)
    file = vehicle()
    turned = tuple(
        msgspec.structs.replace(one, wrench=tuple(-x for x in one.wrench)) for one in file.thruster
    )
    assert feedback(file, record).held[4]
    other = feedback(msgspec.structs.replace(file, thruster=turned), record)
    assert other.closed
    assert not other.held.any()
