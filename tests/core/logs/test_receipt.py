"""Commands that a driver stamps on receipt: late by the travel time of its other messages."""

from __future__ import annotations

import pytest

from hydro.core.logs.receipt import late_commands

OUTPUTS = ["/rov/mavros/rc/out.channels[0]", "/rov/mavros/rc/out.channels[1]"]


def test_outputs_stamped_on_receipt_are_late_by_the_travel_of_the_driver_s_other_messages() -> None:
    travel = {
        "/rov/mavros/rc/out": 0.001,
        "/rov/mavros/imu/data": 0.017,
        "/rov/mavros/local_position/pose": 0.017,
        "/rov/dvl/data": 0.150,
    }
    assert late_commands(OUTPUTS, travel) == pytest.approx(0.016)


@pytest.mark.parametrize(
    "travel",
    [
        {"/rov/mavros/rc/out": 0.0},
        {"/rov/mavros/rc/out": 0.0, "/rov/dvl/data": 0.15},
        {"/rov/mavros/rc/out": 0.0, "/other/mavros/imu/data": 0.02},
    ],
)
def test_without_another_message_of_the_driver_nothing_is_known(travel: dict[str, float]) -> None:
    assert late_commands(OUTPUTS, travel) == 0.0


def test_commands_that_a_controller_publishes_are_not_late() -> None:
    """They act after they are logged, so the travel of sensor messages does not apply."""
    travel = {"/rov/thrusters": 0.0, "/rov/mavros/imu/data": 0.02}
    assert late_commands(["/rov/thrusters.data[0]"], travel) == 0.0
