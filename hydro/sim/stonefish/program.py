"""Process that runs Stonefish (`bridge/stonefish`): one process per vehicle, with a line protocol.

    hydro-stonefish 1 VERSION TICKS_PER_SECOND THRUSTERS       greeting
    reset x y z qw qx qy qz u v w p q r                        request: start there with rotors at rest
    hold TICKS s1 ... sn                                       request: continue with these setpoints
    row x y z qw qx qy qz u v w p q r fx fy fz T1 ... Tn       answer to either request
    error WORDS                                                instead of any answer; the program then ends

Pose and velocity of CO are those of `sim.plant.Plant`.  The row also has its specific force (FRD, mean of the
last tick) and the thrusts [N].  Numbers are text with all digits of a double.
"""

from __future__ import annotations

import contextlib
import os
import select
import shutil
import subprocess
import tempfile
import weakref
from collections.abc import Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import IO, NamedTuple

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError, UsageError, shown
from hydro.sim.stonefish.scenario import RATE, Scenario

NAME, PROTOCOL = "hydro-stonefish", 1
VARIABLE = "HYDRO_STONEFISH"
"""Environment variable with the path of the program, if it is not on the PATH."""
OLDEST = (1, 4)
"""Oldest supported version of Stonefish."""
PATIENCE = 120.0
"""Maximum time without an answer of a running program [s].

A tick takes at most a millisecond, and a start together with hundreds of others a minute.
"""
READ_SIZE = 1 << 16
"""Number of bytes per read."""
STATE, FELT = 13, 16
"""Number of values of a row up to the velocity, and up to the specific force."""


class Row(NamedTuple):
    """Answer of the Stonefish process: the state of the vehicle.

    Attributes:
        state: Pose and velocity, (13,).
        specific_force: Specific force at CO, FRD, (3,) [m/s^2].
        thrust: Thrusts of the n thrusters, (n,) [N].
    """

    state: Array
    specific_force: Array
    thrust: Array


def installed() -> str:
    """Return the path of the program `hydro-stonefish`, which runs Stonefish.

    Raises:
        UsageError: The program is not installed.
    """
    named = os.environ.get(VARIABLE)
    found = shutil.which(named or NAME)
    if found is None:
        where = f"{VARIABLE}={shown(named)} is not a program" if named else f"{NAME} is not on the PATH"
        raise UsageError(
            f"{where}: build it from bridge/stonefish of hydro's repository, with Stonefish "
            f"{'.'.join(map(str, OLDEST))} or later (docs/stonefish.md), and put it on the PATH or name "
            f"it in {VARIABLE}"
        )
    return found


class Program:
    """One vehicle in one Stonefish process, which `close` or the end of a `with` block terminates."""

    def __init__(self, scenario: Scenario, path: str | None = None) -> None:
        """Start the program; it may still be loading on return.

        Args:
            scenario: The vehicle.
            path: Path of the program; by default the `installed` one.

        Raises:
            UsageError: It is not installed, or cannot be run.
        """
        program = path or installed()
        self.version = ""
        self._thrusters = len(scenario.pushing)
        folder = tempfile.TemporaryDirectory(prefix="hydro-stonefish-")
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115  closed with the process
        try:
            self._process = subprocess.Popen(
                [program, str(scenario.write(Path(folder.name)))],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._log,
                bufsize=0,
            )
        except OSError as error:
            folder.cleanup()
            raise UsageError(f"{shown(program)}: cannot be run: {error.strerror}") from None
        assert self._process.stdout is not None
        self._said, self._unread = select.poll(), b""
        self._said.register(self._process.stdout, select.POLLIN)
        self.close: Callable[[], object] = weakref.finalize(self, _end, self._process, folder, self._log)

    def __enter__(self) -> Program:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def reset(self, state: Array) -> None:
        """Ask the process for a start at a pose (7,) and velocity (6,), joined as (13,).

        `answer` returns the result.
        """
        self._ask(f"reset {_numbers(state)}")

    def hold(self, ticks: int, setpoints: Array) -> None:
        """Ask the process for `ticks` steps with thruster setpoints (n,); `answer` returns the result."""
        self._ask(f"hold {ticks} {_numbers(setpoints)}")

    def greet(self) -> str:
        """Wait until the program has loaded; return the version of Stonefish.

        Raises:
            DataError: The program fails, or does not have the expected protocol.
        """
        self.version = self.version or self._greeting()
        return self.version

    def answer(self) -> Row:
        """Return the process's answer to the oldest request that is not answered yet.

        Raises:
            DataError: There is no answer, or an invalid one.
        """
        self.greet()
        word, *rest = self._line().split()
        try:
            values = np.array(rest, dtype=np.float64)
        except ValueError:
            values = np.zeros(0)
        if word != "row" or values.size != FELT + self._thrusters:
            raise DataError(
                f"{NAME} answered {shown(' '.join([word, *rest]))[:60]!r} in the place of a row of "
                f"{FELT + self._thrusters} numbers: build bridge/stonefish of this version of hydro"
            )
        return Row(values[:STATE], values[STATE:FELT], values[FELT:])

    def _greeting(self) -> str:
        """Return the version of Stonefish, after a check of the program's greeting."""
        words = self._line().split()
        if len(words) != 5 or words[0] != NAME:
            raise DataError(
                f"{NAME} began with {shown(' '.join(words))[:60]!r}: {VARIABLE} or the PATH names another "
                "program"
            )
        if words[1] != str(PROTOCOL):
            raise DataError(
                f"{NAME} speaks version {shown(words[1])} of its protocol, and this hydro version {PROTOCOL}"
                ": build bridge/stonefish of this version of hydro"
            )
        if _version(words[2]) < OLDEST:
            raise DataError(
                f"{NAME} was built with Stonefish {shown(words[2])}: it needs {'.'.join(map(str, OLDEST))}"
                " or later"
            )
        if words[3:] != [f"{RATE:g}", str(self._thrusters)]:
            raise DataError(
                f"{NAME} runs {shown(words[4])} thrusters at {shown(words[3])} Hz, not {self._thrusters} at "
                f"{RATE:g} Hz: build bridge/stonefish of this version of hydro"
            )
        return words[2]

    def _ask(self, line: str) -> None:
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # its answer then has the reason
            self._process.stdin.write(f"{line}\n".encode())

    def _line(self) -> str:
        """Return the next line of the program.

        Raises:
            DataError: The program has ended, reports an error, or does not answer in time and is then ended.
        """
        line = self._read()
        if line.startswith("error "):
            raise DataError(f"{NAME}: {shown(line[len('error ') :].strip())}")
        if not line.strip():
            code = self._process.wait()
            raise DataError(f"{NAME} ended without an answer (exit code {code}): {self._last_error_line()}")
        return line

    def _read(self) -> str:
        """Read to the end of a line, or of all output, without waiting for more."""
        assert self._process.stdout is not None
        while b"\n" not in self._unread:
            if not self._said.poll(1e3 * PATIENCE):
                said = self._last_error_line()
                self.close()
                raise DataError(
                    f"{NAME} gave no answer for {PATIENCE:g} s and was ended: {said}; try again with fewer "
                    "vehicles at a time, or build bridge/stonefish again"
                )
            piece = os.read(self._process.stdout.fileno(), READ_SIZE)
            if not piece:
                break
            self._unread += piece
        line, _, self._unread = self._unread.partition(b"\n")
        return line.decode(errors="replace")

    def _last_error_line(self) -> str:
        """Return the last line that the program wrote to stderr."""
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").split("\n")
        said = [line.strip() for line in lines if line.strip()]
        return shown(said[-1])[:200] if said else "it gave no reason"


def _end(process: subprocess.Popen[bytes], folder: tempfile.TemporaryDirectory[str], log: IO[bytes]) -> None:
    """End a program and remove its files."""
    for stream in (process.stdin, process.stdout):
        if stream is not None:
            with contextlib.suppress(OSError):
                stream.close()
    process.kill()
    process.wait()
    log.close()
    folder.cleanup()


def _version(text: str) -> tuple[int, ...]:
    """Return a version such as `1.2.3` as numbers; empty if the text is not a version."""
    parts = text.split(".")
    return tuple(map(int, parts)) if all(part.isdecimal() for part in parts) else ()


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
