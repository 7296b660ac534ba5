"""Recipes of trainings, and the settings of a residual network's wrench."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from hydro.commands.rl_recipes import current_recipe
from hydro.core.errors import UsageError
from hydro.core.residual.network import Network
from hydro.io import vehicle as vehicles
from hydro.rl.environment import conditions
from hydro.rl.environment.conditions import Condition, zero_model
from hydro.rl.environment.wrench import WrenchSettings
from hydro.rl.training.config import PAPER, RECIPES, UNPUBLISHED, Curriculum
from hydro.rl.training.curriculum import CurriculumProgress
from hydro.rl.training.runs import changed, config_of, run_artefact
from hydro.rl.world.config import Settings
from hydro.sim.bridge.water import residual
from hydro.sim.residual.conditioning import preset
from hydro.sim.residual.control import Control


@pytest.fixture(scope="module")
def auv151(datasets):
    return vehicles.read(datasets / "vehicles" / "auv151.toml")


def test_every_recipe_states_its_name_and_runs_keep_it(auv151):
    for name, config in RECIPES.items():
        run = run_artefact(config, auv151[1])
        assert config.recipe == name == run.provenance.parameters["recipe"]
        assert config_of(run) == config


def test_the_recipe_of_the_paper_has_the_published_settings_and_marks_the_others(auv151):
    paper = RECIPES[PAPER]
    assert (paper.vehicles, paper.sac.batch, paper.sac.capacity, paper.sac.rate) == (8, 512, 1_000_000, 3e-4)
    known = set(run_artefact(paper, auv151[1]).frame["name"])
    assert set(UNPUBLISHED) < known
    assert not {"vehicles", "sac.batch", "sac.capacity", "sac.rate"} & set(UNPUBLISHED)


def test_the_old_name_of_imitation_is_taken_with_a_warning(capsys):
    assert current_recipe("demos") == "imitation"
    assert "--recipe demos is called imitation now" in capsys.readouterr().err
    assert current_recipe("sac") == "sac"
    assert not capsys.readouterr().err


def test_imitation_alone_makes_no_sac_update():
    config = RECIPES["imitation"]
    assert config.clone > 0
    assert config.corrections > 0
    assert config.sac.random == 0


def test_stage_two_may_be_a_row_of_pillars():
    row = Curriculum(last=3, row=(2, 8), pillars=12)
    assert row.levels == (("point_to_point", 0), ("pillar_row", 2), ("pillar_row", 8), ("forest", 12))
    assert row.stages == ("point_to_point", "pillar_row", "forest")
    assert Curriculum().stages[1] == "slalom"
    with pytest.raises(UsageError, match="level 9 of pillar_row"):
        Curriculum(last=2, row=(9,))


def test_an_examination_does_not_change_the_success_rate_of_the_curves():
    progress = CurriculumProgress(Curriculum(last=2, baffles=(0,), window=4, ready=0.5))
    for success in (True, True, True, False):
        progress.note(success)
    assert progress.ready
    assert not progress.examined(0.5)
    assert progress.share == 0.75
    assert not progress.ready
    again = CurriculumProgress(progress.config)
    again.restore(progress.state())
    assert again.share == 0.75
    assert progress.examined(1.0)
    assert progress.share == 0.0


def test_the_zero_model_has_no_wrench():
    states = np.random.default_rng(0).normal(size=(5, 12))
    np.testing.assert_array_equal(Network.of(zero_model()).wrench(states), np.zeros((5, 6)))


def test_without_a_network_only_the_wrench_of_the_network_is_missing(auv151):
    """R_0+M_A has the mass matrix, the cancelled C_RB and the conditioning of a condition with a network."""
    vehicle, settings = auv151[0], Settings()
    zero = conditions.water(Condition(conditions.ZERO), vehicle)
    control = Control(
        Network.of(zero_model()), settings.period, conditioning=preset("paper", vehicle), lead=0.5
    )
    like = residual(vehicle, control)
    for name in ("inertia", "coriolis", "cancelled"):
        one, other = getattr(zero, name), getattr(like, name)
        assert (one is None) == (other is None), name
        assert one is None or (one == other).all(), name
    np.testing.assert_array_equal(zero.control.encode(), like.control.encode())


def speeds(vehicle, condition):
    """Surge velocity after one second at full thrust ahead, in kernels."""
    plant = conditions.plant(condition, vehicle, Settings(), 1)
    pose = np.zeros((1, 7))
    pose[:, 2:4] = 5.0, 1.0
    plant.reset(np.ones(1, np.bool_), pose, np.zeros((1, 6)))
    ahead = np.sign([one.direction[0] for one in vehicle.thruster])[None]
    for _ in range(25):
        plant.step(ahead.astype(float))
    return plant.velocity[0, 0]


def test_added_mass_is_the_difference_between_both_conditions_without_water(auv151):
    """At rest in pitch and yaw, F = (m + X) du/dt along one axis."""
    vehicle = auv151[0]
    dry, added = (speeds(vehicle, Condition(name)) for name in (conditions.NO_WATER, conditions.ZERO))
    assert dry / added == pytest.approx((151.0 + 35.0) / 151.0, rel=0.02)


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        ({"lead": 0.0}, {"lead": 0.0}),
        ({"ratio": 1.0}, {"ratio": 1.0}),
        ({"beta": 0.7}, {"keep": 0.7}),
        ({"beta": 0.0}, {"keep": 0.0}),
        ({"clip": 0.0}, {"clip": np.inf}),
        ({"clip": 4.0}, {"clip": 2.0}),
        ({"deadband": 0.1}, {"deadband": 0.1}),
    ],
)
def test_settings_of_the_wrench_reach_the_control(auv151, settings, expected):
    vehicle = auv151[0]
    usual = conditions.water(Condition(conditions.ZERO), vehicle).control
    made = conditions.water(Condition(conditions.ZERO, wrench=WrenchSettings(**settings)), vehicle).control
    found = {
        "lead": made.lead,
        "ratio": made.design.ratio[0],
        "keep": made.conditioning.keep,
        "clip": made.conditioning.limits[0] / usual.conditioning.limits[0],
        "deadband": made.conditioning.linear_deadband,
    }
    assert {name: pytest.approx(found[name]) for name in expected} == expected


@pytest.mark.parametrize("wrong", [{"lead": 2.0}, {"ratio": 0.0}, {"beta": 1.0}, {"clip": -1.0}])
def test_settings_of_the_wrench_out_of_range_are_refused(wrong):
    with pytest.raises(UsageError, match=f"wrench.{next(iter(wrong))} is"):
        WrenchSettings(**wrong)


def test_settings_of_the_wrench_are_set_by_name():
    config = changed(RECIPES["sac"], {"wrench.lead": "0", "wrench.beta": "0.9"})
    assert config.wrench == replace(WrenchSettings(), lead=0.0, beta=0.9)
