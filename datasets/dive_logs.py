"""The dive as a vehicle's computers log it: MAVROS, the autopilot, its telemetry, BlueOS, a notebook.

Each has the frames, units and clocks of its kind.  ROS turns to ENU and FLU; its stamps are the autopilot's
times, receipt is late and jitters, and the driver of the Doppler log stamps what it receives, twice each.
The autopilot counts from its start, a telemetry link delivers in bursts.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from dive import DVL_LATE, Dive
from log_writers import SECOND, Message
from scipy.spatial.transform import Rotation

BEGUN = 1_781_172_000
"""When the dive began [s since 1970]."""
BOOTED = 73.0
"""How long the autopilot had been on by then [s]."""
RECEIPT, JITTER = 0.012, 0.004
"""Shortest way of a message to the logger, and mean of what comes on top of it [s]."""
BURST = 0.2
"""Between two packets of the telemetry link [s]."""
SPEED_OF_EKF = (0.02, 2.0)
"""Error of the filter's velocity: deviation [m/s], and how long it lasts [s]."""
RCOUT = "mavros_msgs/msg/RCOut"
DVL = "waterlinked_a50_ros_driver/msg/DVL"
BEAM = "waterlinked_a50_ros_driver/msg/DVLBeam"
DEFINITIONS = {
    RCOUT: "std_msgs/Header header\nuint16[] channels\n",
    BEAM: "int64 id\nfloat64 velocity\nfloat64 distance\nfloat64 rssi\nfloat64 nsd\nbool valid\n",
    DVL: (
        "std_msgs/Header header\nfloat64 time\ngeometry_msgs/Vector3 velocity\nfloat64 fom\n"
        "float64 altitude\nwaterlinked_a50_ros_driver/DVLBeam[] beams\nbool velocity_valid\nint64 status\n"
        "string form\n"
    ),
}
"""Message types that no ROS distribution has."""
DATAFLASH = {
    "MSG": ("QZ", "TimeUS,Message"),
    "PARM": ("QNf", "TimeUS,Name,Value"),
    "ATT": ("QccccCCCCB", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF"),
    "XKF1": (
        "QBccCfffffffccce",
        "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH",
    ),
    "IMU": ("QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "RCOU": ("QHHHHHHHHHHHHHH", "TimeUS," + ",".join(f"C{i + 1}" for i in range(14))),
    "VISO": ("Qffffffff", "TimeUS,dt,AngDX,AngDY,AngDZ,PosDX,PosDY,PosDZ,conf"),
}
"""Messages of ArduSub's log, in their formats."""
PING = 0.2
"""Seconds between two pings."""
LIGHTS = [1100, 1500, 1500, 1100, 0, 0]
"""Outputs 9 to 14: lights, and camera mount."""


class Clock:
    """Times of receipt."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)

    def received(self, t: float) -> int:
        """When the logger has a message that was sent at a time of the dive [ns since 1970]."""
        return epoch(t + RECEIPT + self._rng.exponential(JITTER))


def epoch(t: float) -> int:
    """A time of the dive [ns since 1970]."""
    return BEGUN * SECOND + round(t * 1e9)


def boot(t: float, per_second: float) -> int:
    """The same on the autopilot's clock, in whole parts of a second."""
    return round((t + BOOTED) * per_second)


def in_order(*streams: Iterable[Message]) -> Iterator[Message]:
    """Messages in order of receipt, within each stream as they were sent."""
    return heapq.merge(*(sorted(each, key=_received) for each in streams), key=_received)


def _received(message: Message) -> int:
    return message.received


def _named(names: str, values: Any) -> dict[str, float]:
    """A vector's parts by name, as a link of single precision delivers them."""
    return {name: float(np.float32(value)) for name, value in zip(names, values, strict=True)}


def _quaternion(angles: np.ndarray) -> dict[str, float]:
    """Roll, pitch and yaw of NED and FRD as the quaternion of ENU and FLU."""
    swap = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    turn = swap @ Rotation.from_euler("ZYX", angles[::-1]).as_matrix() @ np.diag([1.0, -1.0, -1.0])
    return _named("xyzw", Rotation.from_matrix(turn).as_quat())


def mavros(dive: Dive) -> Iterator[Message]:
    """What a recording of MAVROS and of the Doppler log's driver has."""
    clock = Clock(1)
    pose, imu, out, pings = [], [], [], []
    for t, (x, y, z, *angles), _ in dive.pose:
        place = {"position": _named("xyz", (y, x, -z)), "orientation": _quaternion(np.array(angles))}
        content = {"header": {"stamp": epoch(t), "frame_id": "map"}, "pose": place}
        pose.append(
            Message(
                "/mavros/local_position/pose", "geometry_msgs/msg/PoseStamped", clock.received(t), content
            )
        )
    for t, values, _ in dive.imu:
        p, q, r = values[3:]
        content = {
            "header": {"stamp": epoch(t), "frame_id": "base_link"},
            "orientation": _quaternion(values[:3]),
            "angular_velocity": _named("xyz", (p, -q, -r)),
        }
        imu.append(Message("/mavros/imu/data", "sensor_msgs/msg/Imu", clock.received(t), content))
    for t, pulses, _ in dive.pulses:
        received = clock.received(t)
        content = {"header": {"stamp": received}, "channels": [*pulses.astype(int).tolist(), *LIGHTS]}
        out.append(Message("/mavros/rc/out", RCOUT, received, content))
    for t, velocity, valid in dive.dvl:
        for again in (0.0, 0.5 * PING):  # the driver tells each ping twice
            stamp = epoch(t + DVL_LATE + again)
            content = {
                "header": {"stamp": stamp, "frame_id": "dvl_link"},
                **{"time": 1e3 * PING, "velocity": _named("xyz", velocity), "velocity_valid": valid},
                **{"fom": 0.004 if valid else 0.0, "altitude": 6.0 if valid else -1.0, "form": "json_v1"},
            }
            pings.append(Message("/dvl/data", DVL, clock.received(t + DVL_LATE + again), content))
    return in_order(pose, imu, out, pings)


def autopilot(dive: Dive) -> Iterator[Message]:
    """What ArduSub's own log has: two cores of its filter, and displacements of the Doppler log."""
    rng = np.random.default_rng(2)
    first = dive.pose.t[0]
    head = [Message("MSG", "", epoch(first), (boot(first, 1e6), b"ArduSub V4.1.2"))]
    head += [Message("PARM", "", epoch(first), (boot(first, 1e6), b"FRAME_CONFIG", 2.0))]
    attitude, cores, imu, out, pings = [], [], [], [], []
    errors = _drifting(len(dive.pose.t), rng)
    for k, (t, (x, y, z, *angles), _) in enumerate(dive.pose):
        us, north = boot(t, 1e6), _world_velocity(dive, t) + errors[k]
        phi, theta, psi = _degrees(angles)
        for core, aside in ((0, 0.0), (1, 0.4)):
            values = (us, core, phi, theta, psi, *north, north[2], x + aside, y, z, 0.0, 0.0, 0.0, 0.0)
            cores.append(Message("XKF1", "", epoch(t), values))
    for k, (t, values, _) in enumerate(dive.imu):
        us = boot(t, 1e6)
        if k % 2 == 0:
            phi, theta, psi = _degrees(values[:3])
            attitude.append(Message("ATT", "", epoch(t), (us, 0.0, phi, 0.0, theta, psi, psi, 0.0, 0.0, 3)))
        accelerations = (0.0, 0.0, -9.82)
        imu.append(
            Message("IMU", "", epoch(t), (us, 0, *values[3:], *accelerations, 0, 0, 31.5, 1, 1, 1000, 1000))
        )
    for t, pulses, _ in dive.pulses:
        values = (boot(t, 1e6), *pulses.astype(int).tolist(), *LIGHTS)
        out.append(Message("RCOU", "", epoch(t), values))
    for t, velocity, valid in dive.dvl:
        moved = velocity * PING
        values = (boot(t + DVL_LATE, 1e6), PING, 0.0, 0.0, 0.0, *moved, 100.0 if valid else 0.0)
        pings.append(Message("VISO", "", epoch(t + DVL_LATE), values))
    return in_order(head, attitude, cores, imu, out, pings)


def _degrees(angles: Iterable[float]) -> tuple[float, float, float]:
    """Roll and pitch, and a heading from 0 to 360, which hundredths may not reach."""
    phi, theta, psi = np.degrees(list(angles))
    return phi, theta, round(float(psi) % 360.0, 2) % 360.0


def _drifting(count: int, rng: np.random.Generator) -> np.ndarray:
    """Error of the filter's velocity, which lasts from one sample to the next, (count, 3) [m/s]."""
    deviation, seconds = SPEED_OF_EKF
    kept = np.exp(-0.1 / seconds)
    fresh = deviation * rng.standard_normal((count, 3))
    for k in range(1, count):
        fresh[k] = kept * fresh[k - 1] + np.sqrt(1.0 - kept**2) * fresh[k]
    return fresh


def _world_velocity(dive: Dive, t: float) -> np.ndarray:
    """Velocity over ground as it was, along north, east and down."""
    row = dive.truth.row(int(np.searchsorted(dive.truth["t"].to_numpy(), t - 1e-9)), named=True)
    turn = Rotation.from_euler("ZYX", [row["psi"], row["theta"], row["phi"]])
    return turn.apply([row["u"], row["v"], row["w"]])


def telemetry(dive: Dive) -> Iterator[Message]:
    """What a ground station keeps: packets of the link every fifth of a second."""
    messages = []
    for name, t, content in _mavlink(dive):
        burst = np.ceil((t + RECEIPT) / BURST) * BURST
        messages.append(Message(name, "", epoch(burst), content))
    last = dive.pose.t[-1]
    beat = {"autopilot": 3, "base_mode": 81, "custom_mode": 0, "system_status": 4, "mavlink_version": 3}
    for t in np.arange(0.0, last, 1.0):
        messages.append(Message("HEARTBEAT", "", epoch(t), {"type": 12, **beat}))
        ground = {"type": 6, **beat, "autopilot": 8}
        messages.append(Message("HEARTBEAT@255.190", "", epoch(t), ground))
    return in_order(messages)


def blueos(dive: Dive) -> Iterator[Message]:
    """What BlueOS records of the same messages: JSON, with the sender in its header."""
    clock = Clock(3)
    messages = [
        Message(
            f"mavlink/1/1/{name}",
            "mavlink",
            clock.received(t),
            {
                "header": {"system_id": 1, "component_id": 1, "sequence": number % 256},
                "message": {"type": name, **content},
            },
        )
        for number, (name, t, content) in enumerate(_mavlink(dive))
    ]
    return in_order(messages)


def _mavlink(dive: Dive) -> Iterator[tuple[str, float, dict[str, Any]]]:
    """Name, time of sending and fields of the autopilot's messages."""
    for (t, pose, _), spin in zip(dive.pose, _rates_at(dive), strict=True):
        ms, north = boot(t, 1e3), _world_velocity(dive, t)
        speed = _named(("vx", "vy", "vz"), north)  # type: ignore[arg-type]
        yield "LOCAL_POSITION_NED", t, {"time_boot_ms": ms, **_named("xyz", pose[:3]), **speed}
        yield "ATTITUDE", t, {"time_boot_ms": ms, **spin}
        yield (
            "GLOBAL_POSITION_INT",
            t,
            {
                "time_boot_ms": ms,
                **{"lat": 0, "lon": 0, "alt": round(-1e3 * pose[2]), "relative_alt": round(-1e3 * pose[2])},
                **{name: round(100.0 * value) for name, value in zip(("vx", "vy", "vz"), north, strict=True)},
                "hdg": round(100.0 * np.degrees(pose[5])) % 36000,
            },
        )
    for t, pulses, _ in dive.pulses:
        outputs = [*pulses.astype(int).tolist(), *LIGHTS, 0, 0]
        servos = {f"servo{i + 1}_raw": value for i, value in enumerate(outputs)}
        yield "SERVO_OUTPUT_RAW", t, {"time_usec": boot(t, 1e6), "port": 0, **servos}
    for t, velocity, valid in dive.dvl:
        late = t + DVL_LATE
        moved = [float(np.float32(each)) for each in velocity * PING]
        content = {"time_usec": boot(late, 1e6), "time_delta_usec": round(PING * 1e6)}
        content |= {"angle_delta": [0.0, 0.0, 0.0], "position_delta": moved}
        yield "VISION_POSITION_DELTA", late, {**content, "confidence": 100.0 if valid else 0.0}


def _rates_at(dive: Dive) -> Iterator[dict[str, float]]:
    """Attitude and rates at the times of the pose."""
    at = {round(t, 6): values for t, values, _ in dive.imu}
    names = ("roll", "pitch", "yaw", "rollspeed", "pitchspeed", "yawspeed")
    for t in dive.pose.t:
        values = at[round(float(t), 6)].copy()
        values[:3] = np.angle(np.exp(1j * values[:3]))
        yield _named(names, values)  # type: ignore[arg-type]


def arrays(dive: Dive) -> dict[str, np.ndarray]:
    """What a notebook would save: arrays on the clock of the commands, NaN where a sensor has nothing new."""
    t = dive.pulses.t
    columns = {name: np.full((len(t), 3), np.nan, np.float32) for name in ("position", "euler_deg", "gyro")}
    columns["velocity"] = columns["gyro"].copy()
    rows = np.searchsorted(t, dive.pose.t - 1e-9)
    spins = np.array([list(each.values()) for each in _rates_at(dive)])
    columns["position"][rows] = dive.pose.values[:, :3]
    columns["euler_deg"][rows] = np.degrees(spins[:, :3])
    columns["gyro"][rows] = spins[:, 3:]
    columns["velocity"][np.searchsorted(t, dive.dvl.t - 1e-9)] = np.where(
        dive.dvl.valid[:, None], dive.dvl.values, np.nan
    )
    return {"t": t, **columns, "pwm": dive.pulses.values.astype(np.uint16)}


def write_npz(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A numpy archive."""
    np.savez_compressed(path, **columns)
    return path


def write_mat(path: Path, columns: dict[str, np.ndarray]) -> Path:
    """A MATLAB file of version 5, without the day on which it was made."""
    from scipy.io import savemat

    savemat(path, columns, do_compression=True)
    with path.open("r+b") as file:
        file.write(b"MATLAB 5.0 MAT-file".ljust(116))
    return path
