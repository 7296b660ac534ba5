"""The rate of the rows: that of the sensors, but at most that of the reference data unless one is given."""

from __future__ import annotations

import logs
import numpy as np
import pytest

from hydro.core.columns import command_column
from hydro.core.logs.conventions import SessionLog
from hydro.core.logs.importing import FASTEST_ROWS, Imported, raw_table


def imported(hz: float, rate: float | None = None) -> Imported:
    """Return a log of ten seconds with a square command of 2.5 Hz in the first of its command columns."""
    t = np.arange(round(10.0 * hz)) / hz
    columns = dict(zip(logs.NAMES, logs.motion(t).T, strict=True)) | {
        "cmd_1": np.where((t * 5.0) % 2.0 < 1.0, 1.0, -1.0)
    }
    return raw_table([SessionLog("dive", t, columns)], logs.PLAIN, rate)


@pytest.mark.parametrize(("hz", "rows"), [(20.0, 20.0), (50.0, 50.0), (250.0, 50.0), (269.0, 50.0)])
def test_rows_are_as_fast_as_the_sensors_up_to_the_rate_of_the_reference_data(hz: float, rows: float) -> None:
    found = imported(hz)
    assert pytest.approx(rows) == 1.0 / found.dt
    assert any("resampled" in note for note in found.notes) == (hz > FASTEST_ROWS)


def test_a_given_rate_keeps_every_sample() -> None:
    found = imported(250.0, rate=250.0)
    assert pytest.approx(250.0) == 1.0 / found.dt
    assert not found.notes


def test_fewer_rows_keep_the_motion_and_the_impulse_of_the_commands() -> None:
    every, fewer = imported(250.0, rate=250.0), imported(250.0)
    joined = fewer.frame.join(every.frame, on=["session", "t"], suffix="_every", how="inner")
    assert len(joined) == len(fewer.frame)
    np.testing.assert_allclose(joined["u"], joined["u_every"], atol=1e-9)
    column = command_column(0)
    impulse = [float(one.frame[column].sum()) * one.dt for one in (every, fewer)]
    assert impulse[0] == pytest.approx(impulse[1], abs=0.02)
