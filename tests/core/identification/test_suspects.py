"""Suspects: every effect of the catalogue is one, and a fit begins where its columns say."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
import synthetic

from hydro.core.effects import CATALOGUE
from hydro.core.identification.suspects import is_curved, of_entries, suspects
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.parameters import free
from hydro.core.vehicle.thrusters import DEADBAND
from hydro.io import vehicle as files

SEARCHED = {name for name, effect in CATALOGUE.items() if not (effect.is_written or effect.is_random)}
"""All but those whose terms the file has to write out, and what acts by chance."""
REACH = np.array([[0.0, 0.0, 5.0, 0.0], [8.0, 3.0, 7.0, 20.0], [2.0, -4.0, 6.0, 40.0]])


def test_every_effect_is_a_suspect_once_but_for_its_shapes(datasets):
    for known in (synthetic.vehicle(), files.read(datasets / "vehicles" / "remus100.toml")[0]):
        found = suspects(known, reach=REACH, completing=True)
        straight = [one.effect for one in found if not is_curved(one.effect)]
        assert len(straight) == len(set(straight))
        assert {one.effect for one in found} == SEARCHED


def test_a_law_of_the_whole_hull_is_a_suspect_of_a_file_without_drag_alone():
    """Beside other drag it only completes a file: it would describe the hull better in any recording."""

    def tried(*effects, **options):
        known = synthetic.vehicle()
        vehicle = msgspec.structs.replace(known, effect=(*known.effect, *effects))
        return {one.effect for one in suspects(vehicle, reach=REACH, **options)}

    assert tried() == SEARCHED
    drag = {"name": "quadratic_damping", "diagonal": synthetic.QUADRATIC.tolist()}
    assert SEARCHED - tried(drag) == {"ellipsoid_drag"}
    assert tried(drag, completing=True) == SEARCHED


def test_a_changed_effect_of_the_file_keeps_its_terms_and_commands(datasets):
    """Without them a table of other values would have no terms, or a fin no commands."""
    known = files.read(datasets / "vehicles" / "remus100_fins.toml")[0]
    for name in ("formula", "control_surface:rudder"):
        (own,) = known.effects(name)
        one = of_entries(known, name)
        table = one.begin(np.zeros(len(one.steps)))
        written = CATALOGUE[name].written(own)
        assert written
        assert CATALOGUE[name].written(table) == written


def test_what_is_left_out_is_not_tried():
    found = suspects(synthetic.vehicle(), without=["tether", "added_mass"], reach=REACH)
    assert {one.effect for one in found} == SEARCHED - {"tether", "added_mass"}


def test_a_shear_counts_from_the_depth_of_the_recording_and_no_fit_moves_that():
    """Free, it would be the mean current; a depth that the file states stays."""
    known = synthetic.vehicle()
    (one,) = (one for one in suspects(known, reach=REACH) if one.effect == "current_shear")
    assert one.begin(np.array([1.0, 0.0])) == {"name": "current_shear", "g_N": 0.05, "g_E": 0.0, "z_0": 6.0}
    sheared = msgspec.structs.replace(known, effect=({"name": "current_shear", "z_0": 2.0},))
    unknown = free(sheared, ["current_shear"], reach=REACH)
    assert [entry.parameter for entry in unknown.entries] == ["g_N", "g_E"]
    assert unknown.at(np.array([0.1, 0.2])).effects("current_shear")[0]["z_0"] == 2.0


@pytest.mark.parametrize("band", [0.0, 0.1])
def test_thresholds_are_tried_at_sizes_within_what_the_file_leaves_room_for(band):
    """Wider dead bands than the file's, and narrower ones where it has any; begun no farther than no band."""
    known = synthetic.vehicle()
    thrusters = tuple(msgspec.structs.replace(one, deadband=band) for one in known.thruster)
    known = msgspec.structs.replace(known, thruster=thrusters)
    tried = [one for one in suspects(known, reach=REACH) if one.effect == "thruster_deadband"]
    widths = {candidate(one.changed[0]).thrusters[0, DEADBAND] for one in tried}
    assert max(widths) >= band + 0.2
    assert min(widths) == (0.0 if band else 0.05)
    for one in tried:
        for amount in (-3.0, 0.2, 5.0):
            begun = one.begin(np.array([amount]))["d"]
            assert -band <= begun <= 0.9
            assert begun != 0.0


@pytest.mark.parametrize("number", range(3))
def test_a_fit_begins_where_the_columns_say(number):
    """The table begun with one column's own amount is the vehicle that the column was made with."""
    known = synthetic.vehicle()
    for one in suspects(known, without=["added_mass"], reach=REACH):
        if number >= len(one.steps) or (is_curved(one.effect) and number > 0):
            continue
        amounts = np.zeros(len(one.steps))
        amounts[number] = one.steps[number]
        begun = type(known)(
            **{f: getattr(known, f) for f in known.__struct_fields__}
            | {"effect": (*known.effect, one.begin(amounts))}
        )
        made, meant = candidate(begun), candidate(one.changed[number])
        np.testing.assert_allclose(made.log, meant.log, rtol=1e-9, atol=1e-12, err_msg=one.effect)
        if one.effect != "thruster_lag":
            np.testing.assert_allclose(made.thrusters, meant.thrusters, rtol=1e-9, err_msg=one.effect)
        np.testing.assert_allclose(
            made.program.flat, meant.program.flat, rtol=1e-9, atol=1e-12, err_msg=one.effect
        )
