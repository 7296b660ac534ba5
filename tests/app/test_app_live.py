from __future__ import annotations

import numpy as np
import pytest

from hydro.app import drawing
from hydro.app.live import MOST_POINTS, Live, decimated
from hydro.app.opening import Craft, Opened
from hydro.app.session import Session


@pytest.fixture(scope="module")
def live(opened: Opened) -> Live:
    return Live(opened)


def test_sessions_follow_each_other_on_the_axis_of_time(live: Live) -> None:
    assert (np.diff(live.clock) > 0.0).all()
    second = live.record.segments[1, 0]
    assert live.clock[second] - live.clock[second - 1] == pytest.approx(2.0)


def test_predictions_start_at_the_measured_motion_and_break_where_they_restart(
    live: Live, craft: Craft
) -> None:
    motion = live.predicted(craft.vehicle, 5.0, 0, live.record.rows)
    starts = live.windows.laid(5.0, 0, live.record.rows)[0]
    assert np.isnan(motion[starts]).all()
    assert np.isfinite(np.delete(motion, starts, axis=0)).all()
    just_after = np.abs(motion[starts + 1] - live.windows.logged[starts + 1])
    assert (just_after < 0.15).all()


def test_a_part_of_a_window_is_predicted_as_in_the_whole(live: Live, craft: Craft) -> None:
    whole = live.predicted(craft.vehicle, 5.0, 0, live.record.rows)
    part = live.predicted(craft.vehicle, 5.0, 77, 190)
    np.testing.assert_array_equal(part, whole[77:190])


def test_the_whole_run_is_one_prediction_of_each_session(live: Live, craft: Craft) -> None:
    assert len(live.windows.laid(None, 0, live.record.rows)[0]) == 2
    long, short = live.errors(craft.vehicle, None), live.errors(craft.vehicle, 1.0)
    assert long.predictions == 2
    assert long.all > short.all > 0.0


def test_horizons_longer_than_every_session_are_not_offered(live: Live, craft: Craft) -> None:
    assert live.horizons == (1.0, 5.0)
    assert np.isnan(live.errors(craft.vehicle, 20.0).all)


def test_decimation_keeps_extremes_and_gaps() -> None:
    x = np.arange(100_000.0)
    y = np.sin(x / 900.0)
    y[50_123], y[70_000] = 9.0, np.nan
    u, v = decimated(x, y, 10_000)
    assert len(u) <= MOST_POINTS
    assert (np.diff(u) > 0.0).all()
    assert v[u == 50_123] == 9.0
    assert np.isnan(v[u == 70_000])
    same = decimated(x[:50], y[:50], 60)
    assert len(same[1]) == 50


def test_a_window_has_all_curves_of_the_page(craft: Craft, opened: Opened) -> None:
    session = Session()
    session.open(craft, opened)
    sent = drawing.window(session, session.present, 0.0, 20.0, 300)
    assert len(sent["measured"]) == len(sent["predicted"]) == len(sent["band"]) == 12
    assert len(sent["commands"]) == 8
    assert max(len(one["x"]) for one in sent["measured"]) <= 300
    begun = drawing.begin(session)
    assert [one["name"] for one in begun["sessions"]] == ["run-1", "run-2"]
    assert begun["commands"] == 8
