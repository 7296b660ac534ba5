"""Replacement for hydro-stonefish that replays the recorded answers of the real program byte for byte.

    exchange.py EXCHANGE SCENARIO          replays; other requests than the recorded ones are an error
    exchange.py EXCHANGE SCENARIO PROGRAM  records an exchange with the real program

A line of an exchange begins with `>` (request) or `<` (answer).  Requests are equal if their words are equal
and their numbers agree to 1e-9, since the last bit of a sine depends on the machine.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from math import isclose
from pathlib import Path


def same(asked: str, wanted: str) -> bool:
    """Return whether a request equals the recorded one."""
    (word, *numbers), (known, *others) = asked.split(), wanted.split()
    return word == known and len(numbers) == len(others) and all(map(_close, numbers, others))


def play(exchange: Path) -> Iterator[str]:
    """Replay the recorded answers line by line."""
    for line in exchange.read_text().splitlines():
        if line.startswith("<"):
            yield line[2:]
            continue
        asked = sys.stdin.readline()
        if not asked:
            return
        if not same(asked, line[2:]):
            yield f"error asked {asked.strip()[:80]} where it was {line[2:82]}"
            return


def record(exchange: Path, scenario: str, program: str) -> Iterator[str]:
    """Relay the real program's answers and record every line."""
    with (
        exchange.open("w") as kept,
        subprocess.Popen(
            [program, scenario], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as real,
    ):
        assert real.stdin is not None
        assert real.stdout is not None
        for asked in _greeting_then(sys.stdin):
            if asked:
                kept.write(f"> {asked}")
                real.stdin.write(asked)
                real.stdin.flush()
            said = real.stdout.readline()
            kept.write(f"< {said}")
            kept.flush()
            yield said.rstrip("\n")


def _greeting_then(lines: Iterator[str]) -> Iterator[str]:
    yield ""
    yield from lines


def _close(a: str, b: str) -> bool:
    return isclose(float(a), float(b), rel_tol=1e-9, abs_tol=1e-9)


if __name__ == "__main__":
    file, *rest = sys.argv[1:]
    for said in record(Path(file), *rest) if len(rest) == 2 else play(Path(file)):
        print(said, flush=True)
