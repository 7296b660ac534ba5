"""Water forces in each training condition."""

import msgspec
import numpy as np
import pytest
from fleets import QUIET, vehicle
from sim.trained import trained

from hydro.core.effects import inertia_matrix, layout
from hydro.core.effects.program import constants_of
from hydro.core.errors import DataError, UsageError
from hydro.core.vehicle.rigid_body import mass_matrix
from hydro.rl.environment import conditions
from hydro.rl.environment.conditions import Condition
from hydro.sim.residual.conditioning import OFF, preset


def test_no_hydrodynamics_keep_the_rigid_body_alone():
    felt = conditions.water(Condition("R_0"), vehicle())
    assert felt.inertia is None
    assert felt.cancelled is None
    assert felt.control is None
    assert not felt.program.effects


@pytest.mark.parametrize("condition", ["R_effects", "R_identified"])
def test_effects_are_those_of_the_file(condition):
    felt = conditions.water(Condition(condition), vehicle())
    np.testing.assert_array_equal(felt.inertia, inertia_matrix(vehicle()))
    assert set(felt.program.effects) >= {"linear_damping", "quadratic_damping"}


@pytest.mark.parametrize(("condition", "kind"), conditions.MODELS.items())
def test_models_fly_with_the_same_conditioning(condition, kind):
    known = Condition(condition, trained(kind)[1])
    felt = conditions.water(known, vehicle())
    assert felt.control.conditioning == preset("paper", vehicle()) != OFF
    assert felt.control.period == QUIET.period
    np.testing.assert_array_equal(felt.cancelled, mass_matrix(vehicle()))
    flown = conditions.plant(known, vehicle(), QUIET, 2)
    flown.reset(np.ones(2, dtype=bool), np.tile([0, 0, 4.0, 1, 0, 0, 0], (2, 1)), np.zeros((2, 6)))
    flown.step(np.zeros((2, 8)))
    assert np.isfinite(flown.velocity).all()


def test_what_was_hung_on_the_vehicle_since_acts_beside_a_model_or_is_refused():
    """The rules are those of `replay` with the same file."""
    _, model = trained("physfeat")
    model.labelled = vehicle()
    payload = {"name": "payload", "w": 12.0, "x": 0.3, "y": 0.0, "z": 0.0, "mass": 5.0}
    current = {"name": "ocean_current", "v_N": 0.3}
    loaded = msgspec.structs.replace(vehicle(), effect=(*vehicle().effect, payload, current))
    felt = conditions.water(Condition("R_PhysFeat", model), loaded)
    assert felt.program.effects == ("payload",)
    assert constants_of(felt.program.flat)[layout.CURRENT] == 0.3
    assert felt.drifting
    assert not conditions.water(Condition("R_PhysFeat", model), vehicle()).program.effects
    lift = {"name": "body_lift", "fin_Y": -20.0}
    fouled = msgspec.structs.replace(vehicle(), effect=(*vehicle().effect, lift))
    with pytest.raises(DataError, match=r"body_lift .* cannot be added to it"):
        conditions.water(Condition("R_PhysFeat", model), fouled)
    model.subtract = "effects"
    with pytest.raises(DataError, match="effects of another vehicle file"):
        conditions.water(Condition("R_PhysFeat", model), loaded)


@pytest.mark.parametrize(
    ("condition", "kind", "word"),
    [
        ("R_PhysFeat", "mlp", "kind physfeat, but mlp is given"),
        ("R_PhysFeat", None, "none is given"),
        ("R_0", "mlp", "has no residual model"),
        ("R_water", None, r"R_0, R_0\+M_A, R_MLP"),
    ],
)
def test_a_model_of_another_kind_is_refused(condition, kind, word):
    with pytest.raises(UsageError, match=word):
        Condition(condition, None if kind is None else trained(kind)[1])
