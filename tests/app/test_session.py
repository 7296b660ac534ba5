from __future__ import annotations

import numpy as np
import pytest

from hydro.app import jobs, shown_commands
from hydro.app.opening import Craft, Opened
from hydro.app.parameters import sliders, switchable, with_value
from hydro.app.session import Session
from hydro.core import effects
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.io import vehicle as vehicles


@pytest.fixture
def session(craft: Craft, opened: Opened) -> Session:
    made = Session()
    made.open(craft, opened)
    return made


def first(session: Session, effect: str = "linear_damping") -> float:
    return float(session.present.effects(effect)[0]["diagonal"][0])


def move(session: Session, value: float, entry: int = 0) -> None:
    session.move(session.sliders("linear_damping")[entry], value)


def test_an_empty_session_says_what_to_do() -> None:
    with pytest.raises(DataError, match="open a recording"):
        _ = Session().rung


def test_opening_measures_the_file_as_given(session: Session) -> None:
    errors = session.errors()
    assert errors is not None
    assert session.rung.error == errors.all > 0.1
    assert errors.predictions == 6
    assert np.isfinite(errors.axes).all()


def test_a_slider_moves_the_vehicle_and_settling_makes_one_state(session: Session) -> None:
    given = session.errors()
    for value in (20.0, 30.0, 55.0):
        move(session, value)
    assert len(session.history) == 1
    assert session.errors().all != given.all
    session.settle("surge")
    move(session, 60.0)
    session.settle("surge")
    assert [one.label for one in session.history] == ["as given", "surge set"]
    assert first(session) == 60.0
    session.settle("surge")
    assert len(session.history) == 2, "nothing has changed"


def test_undo_and_redo_go_along_the_history_and_a_change_cuts_it(session: Session) -> None:
    for number, value in enumerate((20.0, 30.0)):
        move(session, value, number)
        session.settle(f"entry {number}")
    session.undo()
    session.undo()
    assert (first(session), session.at, session.can_undo, session.can_redo) == (15.0, 0, False, True)
    session.redo()
    assert first(session) == 20.0
    session.switch("ocean_current", True)
    assert [one.label for one in session.history] == ["as given", "entry 0 set", "ocean current on"]


def test_the_file_of_a_tuned_vehicle_keeps_comments_and_says_the_same(session: Session) -> None:
    move(session, 33.0)
    session.settle("surge")
    assert "# The vehicle as its owner knows it." in session.rung.text
    assert vehicles.parse(session.rung.text) == session.rung.vehicle


@pytest.mark.parametrize("value", [-5.0, float("nan"), float("inf")])
def test_a_value_that_breaks_a_rule_is_refused_and_the_vehicle_stays(session: Session, value: float) -> None:
    with pytest.raises(DataError):
        move(session, value)
    assert first(session) == 15.0


def test_a_switch_removes_an_effect_and_brings_its_values_back(session: Session) -> None:
    session.switch("quadratic_damping", False)
    assert not session.present.effects("quadratic_damping")
    assert "quadratic_damping" not in session.rung.text
    assert session.rung.error > session.history[0].error
    session.switch("quadratic_damping", True)
    assert first(session, "quadratic_damping") == 118.75
    assert session.rung.error == pytest.approx(session.history[0].error)


def test_every_effect_can_be_switched_on_and_has_sliders_in_range(session: Session) -> None:
    given = session.present
    names = [name for name in switchable(given) if not given.effects(name)]
    assert len(names) > 20
    for name in names:
        session.go(0)
        session.switch(name, True)
        effects.validate(session.present)
        for one in sliders(session.present, name):
            assert one.low <= one.value <= one.high, one.key
            assert one.low < one.high
            assert 0.0 < one.step < one.high - one.low
            with_value(session.present, one, one.value)
    assert session.present.effect[:3] == given.effect[:3]


def test_a_neutral_effect_changes_no_prediction(session: Session) -> None:
    session.switch("ocean_current", True)
    assert session.rung.error == pytest.approx(session.history[0].error)


def test_a_symmetric_matrix_has_each_number_once(session: Session) -> None:
    session.switch("added_mass_coupling", True)
    found = session.sliders("added_mass_coupling")
    assert len({one.key for one in found}) == len(found) > 0
    assert all(CATALOGUE[one.effect].parameter(one.parameter).unit for one in found)


def test_a_fit_changes_the_ticked_and_holds_the_others(session: Session, opened: Opened) -> None:
    session.switch("ocean_current", True)
    session.ticked = {"ocean_current.v_N", "ocean_current.v_E"}
    names, held = session.to_fit()
    assert (names, held) == (["ocean_current"], ["ocean_current.v_D"])
    found = jobs.fit(opened, session.present, names, held, lambda kind, content: None)
    session.accept_fit(found, held)
    table = session.present.effects("ocean_current")[0]
    assert table["v_N"] == pytest.approx(0.2, abs=0.1)
    assert table["v_D"] == 0.0
    assert "known" not in table
    assert session.rung.error < session.history[0].error
    assert {one.parameter for one in session.rung.estimates.entries} == {"v_N", "v_E"}
    assert vehicles.parse(session.rung.text).effects("ocean_current")[0]["v_N"] == table["v_N"]
    line = shown_commands.shell(session)
    assert "hydro fit" in line
    assert "--effect ocean_current --known ocean_current.v_D" in line


def test_nothing_ticked_is_refused(session: Session) -> None:
    session.ticked = set()
    with pytest.raises(DataError, match="tick the parameters"):
        session.to_fit()


def test_a_copy_for_another_tab_changes_nothing_here(session: Session) -> None:
    other = session.copy()
    other.switch("ocean_current", True)
    other.ticked.clear()
    assert len(session.history) == 1
    assert session.ticked


def test_the_shown_python_names_the_files(session: Session) -> None:
    move(session, 33.0)
    session.settle("surge")
    text = shown_commands.python(session)
    compile(text, "shown", "exec")
    assert "short.parquet" in text
    assert "33.0" in text
