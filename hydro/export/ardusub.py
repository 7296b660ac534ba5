"""Vehicle for ArduSub's SITL, through ArduPilot's documented JSON interface over UDP.

SITL sends a frame of servo outputs and waits for the answer: the state one time step later.  So SITL sets the
pace.  A frame is `uint16 magic`, `uint16 frame_rate` [Hz], `uint32 frame_count` and `uint16 pwm[16]` [us],
little-endian; another magic announces 32 outputs.  All other packets are dropped and counted.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.errors import DataError, UsageError
from hydro.core.recording.supply import effective_commands
from hydro.core.simulation.live import Live, Reading
from hydro.core.thrust_curves.table import commands_of_pulses
from hydro.core.vehicle.description import Vehicle

HOST, PORT = "127.0.0.1", 9002  # defaults of ArduPilot's JSON interface
MAGIC = {18458: 16, 29569: 32}
"""Number of servo outputs of a frame by its magic."""
HEAD = struct.Struct("<HHI")  # magic, frame rate, frame count
LONGEST_STEP = 0.05
"""Longest step of a frame [s]; at slower frame rates, simulated time falls behind."""
NO_OUTPUT = 0
"""Pulse width of a channel that is switched off; the thruster stands still."""
DATAGRAM = 2048
"""Bytes read of a packet; a valid frame has 72 at most."""
WAIT = 0.2
"""Interval of the test whether to end [s]."""
SILENCE = 1.0
"""Time without a frame from one client after which another is accepted [s].

SITL sends hundreds of frames a second, and uses another port after a restart.
"""


@dataclass(frozen=True)
class Frame:
    """Request of ArduPilot's simulation interface (SITL) for one time step.

    Attributes:
        rate: Frame rate [Hz].
        number: Number of the frame.
        pwm: Servo outputs [us].
    """

    rate: int
    number: int
    pwm: tuple[int, ...]


def frame(packet: bytes) -> Frame | None:
    """Return the request of SITL that a UDP packet contains; None if the packet is no request."""
    if len(packet) < HEAD.size:
        return None
    magic, rate, number = HEAD.unpack_from(packet)
    count = MAGIC.get(magic, 0)
    if not count or not rate or len(packet) != HEAD.size + 2 * count:
        return None
    return Frame(rate, number, struct.unpack_from(f"<{count}H", packet, HEAD.size))


def answer(reading: Reading) -> bytes:
    """Return the state of a vehicle as the JSON bytes that SITL reads: SI units, body axes FRD, world NED."""
    state = {
        "timestamp": reading.time,
        "imu": {"gyro": reading.nu[3:].tolist(), "accel_body": reading.specific_force.tolist()},
        "position": reading.eta[:3].tolist(),
        "velocity": reading.velocity.tolist(),
        "attitude": reading.eta[3:].tolist(),
        "quaternion": reading.quaternion.tolist(),
    }
    return f"\n{json.dumps(state, allow_nan=False)}\n".encode()


def channels(text: str, thrusters: int) -> tuple[int, ...]:
    """Return the servo outputs of the thrusters, in the order of the vehicle file, from a text like `1,2,-3`.

    Outputs are counted from 1; a negative number is a reversed thruster.

    Args:
        text: Comma-separated numbers.
        thrusters: Number of thrusters.

    Raises:
        UsageError: The count differs from that of the thrusters, or a number is not a valid output.
    """
    try:
        found = tuple(int(one) for one in text.split(","))
    except ValueError:
        found = ()
    most = max(MAGIC.values())
    if len(found) != thrusters or not all(1 <= abs(one) <= most for one in found):
        raise UsageError(
            f"--channels {text!r}: give {thrusters} servo outputs, 1 to {most}, with commas between, "
            "negative if a thruster is reversed"
        )
    return found


@dataclass
class Counts:
    """Counts of received packets.

    Attributes:
        frames: Frames that moved the vehicle.
        malformed: Packets that were not frames.
        repeated: Repeated frames, which were answered again.
        lost: Missing frame numbers.
        restarts: Restarts of SITL, each of which resets the vehicle.
        others: Frames of other clients, dropped while one client is served.
        unanswered: Frames whose sender could not be reached with the answer.
    """

    frames: int = 0
    malformed: int = 0
    repeated: int = 0
    lost: int = 0
    restarts: int = 0
    others: int = 0
    unanswered: int = 0

    def words(self) -> str:
        """Return one line with the numbers of frames, of dropped packets and of restarts."""
        rare = {"frames of other clients dropped": self.others, "not answered": self.unanswered}
        return ", ".join(
            [
                f"{self.frames:,} frames, {self.malformed:,} malformed packets dropped",
                f"{self.repeated:,} frames repeated, {self.lost:,} lost, {self.restarts:,} restarts",
                *(f"{count:,} {words}" for words, count in rare.items() if count),
            ]
        )


@dataclass
class Sub:
    """Simulated vehicle that SITL's servo outputs drive.

    Attributes:
        vehicle: The vehicle file.
        outputs: Servo outputs of its thrusters, as returned by `channels`.
        depth: Initial depth, at rest and level [m].
        counts: Counts of received packets.
    """

    vehicle: Vehicle
    outputs: Sequence[int]
    depth: float = 0.0
    counts: Counts = field(default_factory=Counts)
    _last: int | None = None

    def __post_init__(self) -> None:
        """Compile by a first step, so that no client waits for it, then set the initial state."""
        self._live = Live(self.vehicle)
        self._live.step(np.zeros(len(self.vehicle.thruster)), LONGEST_STEP)
        self._live.read()
        self._begin()

    def _begin(self) -> None:
        self._live.reset([0.0, 0.0, self.depth, 0.0, 0.0, 0.0])

    def receive(self, packet: bytes) -> bytes | None:
        """Move the vehicle by one frame, and return the answer to SITL; None if the packet is not a frame.

        Raises:
            DataError: The motion diverges.
        """
        request = frame(packet)
        if request is None or max(map(abs, self.outputs), default=0) > len(request.pwm):
            self.counts.malformed += 1
            return None
        if self._last is not None and request.number < self._last:
            self.counts.restarts += 1
            self._begin()
            self._last = None
        if request.number == self._last:
            self.counts.repeated += 1
        else:
            self.counts.lost += 0 if self._last is None else request.number - self._last - 1
            self.counts.frames += 1
            self._live.step(self._commands(request.pwm), min(1.0 / request.rate, LONGEST_STEP))
        self._last = request.number
        return answer(self._live.read())

    def _commands(self, pwm: Sequence[int]) -> Array:
        """Return effective commands (n,) for n thrusters, from the pulses of all servo outputs [us]."""
        pulses = np.array([pwm[abs(one) - 1] for one in self.outputs], float)
        commands: Array = np.clip(commands_of_pulses(pulses.tolist()), -1.0, 1.0) * np.sign(self.outputs)
        commands[pulses == NO_OUTPUT] = 0.0
        effective: Array = effective_commands(self.vehicle, commands[None])[0]
        return effective


def serve(
    sub: Sub,
    host: str = HOST,
    port: int = PORT,
    *,
    ready: Callable[[int], Any] = lambda port: None,
    ended: Callable[[float], bool] = lambda idle: False,
) -> None:
    """Answer SITL's frames on a UDP port until `ended` returns True.

    Args:
        sub: The vehicle.
        host: Address to listen on; by default local clients only.
        port: UDP port; 0 selects a free one.
        ready: Called with the port once the socket is bound.
        ended: Called with the time since the last frame [s], after every packet and regularly without
            packets.

    Raises:
        DataError: The address cannot be used, or the motion diverges.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as endpoint:
        try:
            endpoint.bind((host, port))
        except (OSError, OverflowError) as error:
            raise DataError(
                f"{host}:{port}: cannot listen there: {str(error).lower()}; choose --host or --port"
            ) from None
        endpoint.settimeout(WAIT)
        ready(endpoint.getsockname()[1])
        client, last = None, time.monotonic()
        while not ended(time.monotonic() - last):
            try:
                packet, sender = endpoint.recvfrom(DATAGRAM)
            except (
                TimeoutError,
                ConnectionError,
            ):  # no packet arrived, or the last client has closed its port
                continue
            if frame(packet) is not None and sender != client:
                if client is not None and time.monotonic() - last < SILENCE:
                    sub.counts.others += 1
                    continue
                client = sender
            if (state := sub.receive(packet)) is None:
                continue
            last = time.monotonic()
            try:
                endpoint.sendto(state, sender)
            except OSError:  # such as a source port of 0
                sub.counts.unanswered += 1
