"""Replacement for hydro-stonefish without Stonefish: a vehicle that keeps its initial velocity.

    drifter.py WHAT SCENARIO

WHAT is `drifts`, or how it fails: `dies` and `hangs` after ten answers, `silent` from the beginning,
`another` speaks another version of the protocol.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

ANSWERS = 10
"""Before it fails."""
FELT = (0.0, 0.0, -9.81)


def main(what: str, scenario: str) -> None:
    thrusters = Path(scenario).read_text().count("<actuator")
    if what == "silent":
        time.sleep(600.0)
    say("hydro-stonefish", 2 if what == "another" else 1, "1.6.0", 500, thrusters)
    state, thrust = [0.0] * 13, [0.0] * thrusters
    for number, line in enumerate(sys.stdin):
        if what == "dies" and number == ANSWERS:
            sys.exit("a thruster came off")
        if what == "hangs" and number == ANSWERS:
            time.sleep(600.0)
        word, *rest = line.split()
        values = [float(one) for one in rest]
        if word == "reset":
            state, thrust = values, [0.0] * thrusters
        else:
            ticks, *thrust = values
            state = drifted(state, ticks / 500.0)
        say("row", *state, *FELT, *thrust)


def drifted(state: list[float], seconds: float) -> list[float]:
    """Return the state of a level vehicle after some time at constant velocity."""
    w, _, _, z = state[3:7]
    cosine, sine = w * w - z * z, 2.0 * w * z
    u, v, down = state[7:10]
    rates = (cosine * u - sine * v, sine * u + cosine * v, down)
    return [place + seconds * rate for place, rate in zip(state[:3], rates, strict=True)] + state[3:]


def say(*words: object) -> None:
    print(*words, flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
