"""ArduSub interface, tested by a client of ArduPilot's documented protocol."""

from __future__ import annotations

import json
import socket
import struct
import subprocess
import sys
import threading

import msgspec
import numpy as np
import polars as pl
import pytest
from export.flown import vehicle

from hydro.cli import main
from hydro.core.columns import command_columns
from hydro.core.errors import DataError, UsageError
from hydro.core.simulation.simulate import simulate
from hydro.export import ardusub
from hydro.export.ardusub import Sub, channels, serve

RATE = 50
"""Frames per second of simulated time; the client does not wait for the clock."""


def packet(number, pwm, rate=RATE, magic=18458):
    """Return a frame in the documented format."""
    return struct.pack("<HHI", magic, rate, number) + struct.pack(f"<{len(pwm)}H", *pwm)


def pulses(commands):
    """Return sixteen pulse widths, the first ones from commands."""
    return [round(1500 + 400 * one) for one in commands] + [1500] * (16 - len(commands))


class Client:
    """SITL's side of the protocol."""

    def __init__(self, port):
        self.endpoint = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.endpoint.settimeout(5.0)
        self.server = ("127.0.0.1", port)

    def send(self, data):
        self.endpoint.sendto(data, self.server)

    def ask(self, data):
        self.send(data)
        text = self.endpoint.recv(4096).decode()
        assert text[0] == text[-1] == "\n"
        return json.loads(text)


@pytest.fixture
def served(datasets):
    """Return a client of a running server, and its vehicle."""
    craft, ready, over = vehicle(datasets, "bluerov2_heavy"), threading.Event(), threading.Event()
    sub, place = Sub(craft, channels("1,2,3,4,5,6,7,8", 8), depth=10.0), []

    def begin(port):
        place.append(port)
        ready.set()

    options = {"ready": begin, "ended": lambda idle: over.is_set()}
    thread = threading.Thread(target=serve, args=(sub, "127.0.0.1", 0), kwargs=options)
    thread.start()
    assert ready.wait(10.0)
    client = Client(place[0])
    yield client, sub
    over.set()
    thread.join()
    client.endpoint.close()


def test_a_minute_of_frames_is_a_minute_of_simulate(served):
    client, sub = served
    rows, rng = 60 * RATE, np.random.default_rng(2)
    t = np.arange(rows) / RATE
    commands = 0.5 * np.sin(2 * np.pi * rng.uniform(0.03, 0.3, 8) * t[:, None] + rng.uniform(0, 6, 8))
    told = np.round(400 * commands) / 400
    said = []
    for number, row in enumerate(told):
        if number % 500 == 250:
            client.send(b"\x00" * number)  # nobody answers
        said.append(client.ask(packet(number, pulses(row))))
    table = pl.DataFrame({"session": ["s"] * (rows + 1), "t": np.arange(rows + 1) / RATE})
    told = np.vstack([told, told[-1:]])
    raw = simulate(
        sub.vehicle,
        table.with_columns(pl.Series(n, c) for n, c in zip(command_columns(8), told.T, strict=True)),
    )[1:]
    attitude = np.unwrap([one["attitude"] for one in said], axis=0)
    np.testing.assert_allclose([one["timestamp"] for one in said], raw["t"], atol=1e-9)
    np.testing.assert_allclose(
        np.array([one["position"] for one in said]) - [0, 0, 10],
        raw.select("x", "y", "z").to_numpy(),
        atol=1e-9,
    )
    np.testing.assert_allclose(
        attitude, np.unwrap(raw.select("phi", "theta", "psi").to_numpy(), axis=0), atol=1e-9
    )
    gyro = [one["imu"]["gyro"] for one in said]
    np.testing.assert_allclose(gyro, raw.select("p", "q", "r").to_numpy(), atol=1e-9)
    rate = np.gradient([one["position"] for one in said], 1 / RATE, axis=0)[1:-1]
    np.testing.assert_allclose([one["velocity"] for one in said][1:-1], rate, atol=0.02)
    assert sub.counts.frames == rows
    assert sub.counts.malformed == 6


def test_at_rest_it_feels_gravity_and_switched_off_channels_do_nothing(served):
    client, sub = served
    said = client.ask(packet(0, [0] * 16))
    assert said["timestamp"] == pytest.approx(1 / RATE)
    net = (sub.vehicle.buoyancy.force - 13.5 * 9.82) / (13.5 + 18.68)
    np.testing.assert_allclose(said["imu"]["accel_body"], [0.0, 0.0, -9.82 - net], atol=2e-3)
    assert said["quaternion"][0] == pytest.approx(1.0)


def test_what_is_no_frame_is_dropped_and_counted(served):
    client, sub = served
    good = packet(0, [1500] * 16)
    for bad in (b"", b"x", good[:-1], good + b"x", b"\x00" * 40, packet(0, [1500] * 16, rate=0), b"y" * 2000):
        client.send(bad)
    client.send(packet(0, [1500] * 15))
    assert client.ask(good)["timestamp"] > 0.0
    assert sub.counts.malformed == 8
    assert sub.counts.frames == 1


def test_frames_that_come_again_are_answered_and_smaller_numbers_begin_anew(served):
    client, sub = served
    ahead = pulses([0.0] * 4 + [-0.5] * 4)
    first = client.ask(packet(7, ahead))
    assert client.ask(packet(7, ahead)) == first
    for number in (8, 11):
        last = client.ask(packet(number, ahead))
    assert last["timestamp"] == pytest.approx(3 / RATE)
    assert last["position"][2] > 10.0, "a command below 0 of T5 to T8 drives down"
    assert client.ask(packet(0, ahead)) == first
    counts = sub.counts
    assert (counts.frames, counts.repeated, counts.lost, counts.restarts) == (4, 1, 2, 1)
    assert "4 frames, 0 malformed packets dropped, 1 frames repeated, 2 lost, 1 restarts" in counts.words()


def test_a_second_client_neither_moves_nor_restarts_the_vehicle(served):
    client, sub = served
    other = Client(client.server[1])
    client.ask(packet(5, [1500] * 16))
    other.send(packet(0, [1600] * 16))
    assert client.ask(packet(6, [1500] * 16))["timestamp"] == pytest.approx(2 / RATE)
    assert (sub.counts.others, sub.counts.restarts) == (1, 0)
    assert "1 frames of other clients dropped" in sub.counts.words()
    other.endpoint.close()


def test_a_sender_that_cannot_be_answered_ends_nothing_and_junk_does_not_keep_it_awake(datasets, monkeypatch):
    """A source port of 0 is legal in UDP, but no packet can be sent to it."""
    sub = Sub(vehicle(datasets, "bluerov2_heavy"), channels("1,2,3,4,5,6,7,8", 8))

    class Endpoint:
        def __init__(self, *_):
            self.packets = [packet(0, [1500] * 16)]

        def __enter__(self):
            return self

        def __exit__(self, *_): ...
        def bind(self, _): ...
        def settimeout(self, _): ...
        def getsockname(self):
            return ("127.0.0.1", 1)

        def recvfrom(self, _):
            return (self.packets.pop() if self.packets else b"junk"), ("127.0.0.1", 0)

        def sendto(self, *_):
            raise OSError(22, "Invalid argument")

    monkeypatch.setattr(ardusub.socket, "socket", Endpoint)
    ardusub.serve(sub, ended=lambda idle: idle >= 0.2)
    assert (sub.counts.frames, sub.counts.unanswered) == (1, 1)
    assert sub.counts.malformed > 0


def test_thirty_two_outputs_and_reversed_ones(datasets):
    craft = vehicle(datasets, "bluerov2_heavy")
    wide = Sub(craft, channels("25,26,27,28,29,30,31,32", 8))
    turned = Sub(craft, channels("-1,-2,-3,-4,-5,-6,-7,-8", 8))
    one = json.loads(wide.receive(packet(0, [1500] * 24 + [1700] * 8, magic=29569)))
    other = json.loads(turned.receive(packet(0, [1300] * 8 + [1500] * 8)))
    assert one == other
    assert wide.receive(packet(1, [1700] * 16)) is None
    assert wide.counts.malformed == 1


def test_a_slow_rate_is_not_followed(datasets):
    sub = Sub(vehicle(datasets, "bluerov2_heavy"), channels("1,2,3,4,5,6,7,8", 8))
    assert json.loads(sub.receive(packet(0, [1500] * 16, rate=1)))["timestamp"] == ardusub.LONGEST_STEP


def test_a_motion_without_bounds_ends_it_in_one_line(datasets):
    wild = {"name": "linear_damping", "diagonal": [-1e6] * 6}
    craft = msgspec.structs.replace(vehicle(datasets, "bluerov2_heavy"), effect=(wild,))
    sub = Sub(craft, channels("1,2,3,4,5,6,7,8", 8))
    with pytest.raises(DataError, match="diverges"):
        [sub.receive(packet(number, [1600] * 16)) for number in range(1000)]


@pytest.mark.parametrize("text", ["1,2", "1,2,3,4,5,6,7,0", "1,2,3,4,5,6,7,33", "1,2,3,4,5,6,7,x", ""])
def test_channels_that_are_none_are_refused(text):
    with pytest.raises(UsageError, match="give 8 servo outputs, 1 to 32"):
        channels(text, 8)


def test_the_command_listens_on_loopback_alone_and_says_what_came(datasets):
    file = datasets / "vehicles" / "bluerov2_heavy.toml"
    line = [sys.executable, "-m", "hydro", "serve", str(file), "--ardusub", "--port", "0", "--idle", "1"]
    with subprocess.Popen(line, stderr=subprocess.PIPE, text=True) as process:
        said = process.stderr.readline()
        assert "bluerov2-heavy listens on 127.0.0.1, UDP port " in said
        client = Client(int(said.split("UDP port ")[1].split(";")[0]))
        client.send(b"nonsense")
        assert client.ask(packet(0, [1500] * 16))["position"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)
        assert "1 frames, 1 malformed packets dropped" in process.stderr.read()
        assert process.wait(20) == 0
        client.endpoint.close()


def test_wrong_use_is_said_in_one_line(datasets, capfd):
    file = str(datasets / "vehicles" / "bluerov2_heavy.toml")
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    taken.bind(("127.0.0.1", 0))
    port = str(taken.getsockname()[1])
    for line, code, words in (
        (["serve", file], 2, "--ardusub"),
        (["serve", file, "--ardusub", "--channels", "1"], 2, "give 8 servo outputs"),
        (["serve", file, "--ardusub", "--port", port], 1, "cannot listen there"),
        (["serve", file, "--ardusub", "--host", "no such place"], 1, "cannot listen there"),
    ):
        assert main(line) == code
        assert words in capfd.readouterr().err
    taken.close()
