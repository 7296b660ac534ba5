"""What a file knows is not fitted, or is another estimate; what contradicts it is told."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.effects import validate
from hydro.core.effects.catalogue import held_as_known, own_effects, wholly_known
from hydro.core.errors import DataError
from hydro.core.identification.fit import fit
from hydro.core.identification.prior import combined, deviations
from hydro.core.identification.suspects import suspects
from hydro.core.prediction.parameters import free
from hydro.core.vehicle.description import Vehicle
from hydro.io import vehicle as files
from hydro.io.files import bundled

CURRENT = {"name": "ocean_current", "v_N": 0.2, "v_E": -0.1, "v_D": 0.0}


def saying(name: str, **keys) -> Vehicle:
    """The damped vehicle in a current, with more keys in the table of one effect."""
    vehicle = damped(CURRENT)
    tables = (table | keys if table["name"] == name else table for table in vehicle.effect)
    return msgspec.structs.replace(vehicle, effect=tuple(tables))


def test_known_entries_are_not_free():
    assert [e.parameter for e in free(saying("ocean_current", known=["v_D"]), ["ocean_current"]).entries] == [
        "v_N",
        "v_E",
    ]
    assert free(saying("linear_damping", known=True), ["linear_damping.matrix"]).entries == ()


def test_wholly_known_effects_are_neither_refitted_nor_suspects():
    vehicle = saying("linear_damping", known=["diagonal"])
    assert wholly_known(vehicle, "linear_damping")
    assert own_effects(vehicle) == ("quadratic_damping", "ocean_current")
    assert "linear_damping" not in {one.effect for one in suspects(vehicle, without=())}
    partly = saying("ocean_current", known=["v_D"])
    assert not wholly_known(partly, "ocean_current")
    assert "ocean_current" in own_effects(partly)


@pytest.mark.parametrize("known", ["v_N", ["v_X"], 1])
def test_a_known_that_names_no_parameters_is_refused(known):
    with pytest.raises(DataError, match=r"effect\[3\].known: must be true, or a list of parameters"):
        validate(saying("ocean_current", known=known))


def test_names_on_the_command_line_become_keys_of_tables_or_are_refused_with_the_nearest():
    text = files.read(bundled("vehicles") / "auv151.toml")[1]
    held = files.parse(files.hold_known(text, ["linear_damping", "added_mass.diagonal"]))
    assert held.effects("linear_damping")[0]["known"] is True
    assert held.effects("added_mass")[0]["known"] == ["diagonal"]
    assert files.hold_known(text, []) == text
    both = held_as_known(saying("ocean_current", known=["v_D"]), ["ocean_current.v_N", "ocean_current.v_E"])
    assert both == [{"name": "ocean_current", "known": True}]
    with pytest.raises(DataError, match=r"no effect linear_dampin; did you mean linear_damping\?"):
        files.hold_known(text, ["linear_dampin"])
    with pytest.raises(DataError, match="no effect ocean_current"):
        files.hold_known(text, ["ocean_current"])


def test_deviations_of_what_is_known_are_tiny_and_positive():
    entries = free(damped(CURRENT), ["ocean_current"]).entries
    found = deviations(saying("ocean_current", known=["v_D"]), entries)
    assert 0.0 < found[2] < 1e-5
    assert (found[:2] > 0.01).all()


def test_errors_from_the_same_recording_are_no_second_opinion():
    vehicle = saying("ocean_current", standard_error={"v_N": 0.1}, fit={"data": "sha256:a"})
    assert "standard_error" not in files.without_errors_from(vehicle, "sha256:a").effects("ocean_current")[0]
    assert files.without_errors_from(vehicle, "sha256:b") == vehicle


def test_two_estimates_of_one_number_are_weighed_by_their_variances():
    """The textbook: (x1/s1^2 + x2/s2^2) / (1/s1^2 + 1/s2^2); what correlates with it follows."""
    vehicle = saying("ocean_current", standard_error={"v_N": 0.1})
    entries = free(vehicle, ["ocean_current"]).entries
    spread = np.array([[0.04, 0.03, 0.0], [0.03, 0.09, 0.0], [0.0, 0.0, 0.01]])
    values, after, told = combined(np.array([0.5, 0.0, 0.0]), spread, vehicle, entries)
    assert values[0] == pytest.approx((0.5 / 0.04 + 0.2 / 0.01) / (1 / 0.04 + 1 / 0.01))
    assert after[0, 0] == pytest.approx(1 / (1 / 0.04 + 1 / 0.01))
    assert values[1] == pytest.approx(0.03 / 0.04 * (values[0] - 0.5))
    np.testing.assert_allclose(
        np.linalg.inv(after), np.linalg.inv(spread) + np.diag([100.0, 0, 0]), atol=1e-9
    )
    assert told == []
    (words,) = combined(np.array([2.0, 0.0, 0.0]), spread, vehicle, entries)[2]
    assert words.startswith("ocean_current.v_N: the recording says 2 ± 0.2, the file 0.2 ± 0.1")


@pytest.fixture(scope="module")
def recorded():
    return noisy(moved(damped(CURRENT), rows=1500), 1)


def test_a_fit_keeps_what_is_known_and_its_errors_are_zero(recorded):
    wrong = saying("ocean_current", v_D=0.01, known=["v_D"])
    found = fit(wrong, recorded, ["ocean_current"])
    assert found.vehicle.effects("ocean_current")[0]["v_D"] == 0.01
    (table,) = found.tables()
    assert table["standard_error"]["v_D"] == 0.0
    assert table["standard_error"]["v_N"] > 0.0
    assert table["v_D"] == 0.01


def test_a_fit_combines_with_the_errors_of_the_file_and_tells_a_contradiction(recorded):
    alone = fit(damped(CURRENT), recorded, ["ocean_current"])
    error = float(alone.standard_errors[0])
    stated = saying("ocean_current", v_N=0.2 + 20.0 * error, standard_error={"v_N": error})
    both = fit(stated, recorded, ["ocean_current"])
    assert both.values[0] == pytest.approx(0.5 * (alone.values[0] + 0.2 + 20.0 * error), abs=0.5 * error)
    assert both.standard_errors[0] == pytest.approx(error / 2**0.5, rel=0.05)
    assert any("one of them is wrong" in words for words in both.warnings)
    with pytest.raises(DataError, match="held as known"):
        fit(saying("ocean_current", known=True), recorded, ["ocean_current"])


def test_an_implausible_fit_says_so():
    """Thrusters of 1.8 times the file's thrust: other thrusters, not these."""
    strong = {"name": "thruster_gain", "g": [0.8] + [0.0] * 7}
    found = fit(damped(), noisy(moved(damped(strong), rows=1500), 2), ["thruster_gain"])
    assert found.values[0] == pytest.approx(0.8, abs=0.05)
    (words,) = (words for words in found.warnings if "implausible" in words)
    assert words.startswith("thruster_gain.g[0] = 0.8 is implausible: -1 to 0.5")
