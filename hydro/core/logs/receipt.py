"""Delay of thruster commands that a driver stamps when it receives them, unlike its sensor messages.

A driver such as MAVROS reports both sensors and outputs of an autopilot.  It stamps a message with the
autopilot's time if it knows that time, and otherwise with the time of receipt.  All messages travel over the
same link.  So outputs that are stamped on receipt are late by the travel time of the sensor messages.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

DRIVERS = ("mavros",)
"""Drivers that report the outputs of an autopilot, by their component of a topic's name."""


def late_commands(columns: list[str], travel: Mapping[str, float]) -> float:
    """Return how much later commands are stamped than sensor messages of the same driver [s].

    Args:
        columns: Columns of the commands, `TOPIC.FIELD`.
        travel: Mean time from the stamp of a message to its receipt [s], by topic.

    Returns:
        The delay; 0 if the commands are not of a known driver, or if the log has no other message of the
        driver.
    """
    own = [topic for topic in travel if any(name.startswith(f"{topic}.") for name in columns)]
    drivers = {_driver(topic) for topic in own}
    if len(drivers) != 1 or not (driver := drivers.pop()):
        return 0.0
    others = [seconds for topic, seconds in travel.items() if topic not in own and _driver(topic) == driver]
    return float(np.median(others) - np.median([travel[topic] for topic in own])) if others else 0.0


def _driver(topic: str) -> str:
    """Return the namespace of the driver of a topic, or an empty text."""
    parts = topic.split("/")
    place = next((place for place, part in enumerate(parts) if part in DRIVERS), None)
    return "" if place is None else "/".join(parts[: place + 1])
