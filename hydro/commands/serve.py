"""Command `serve`: live simulation of a vehicle for another program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from hydro.commands.shell import about, message
from hydro.core.errors import UsageError

LOOPBACK = ("127.", "localhost")


def serve(
    vehicle: Annotated[Path, typer.Argument(metavar="VEHICLE", show_default=False, help="Vehicle file.")],
    ardusub: Annotated[
        bool,
        typer.Option("--ardusub", help="Answer ArduSub's SITL (its option --model JSON)."),
    ] = False,
    host: Annotated[
        str, typer.Option(metavar="ADDRESS", help="Address to listen on; default: this machine only.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="UDP port; 0 is any free one.")] = 9002,
    channels: Annotated[
        str | None,
        typer.Option(
            metavar="N,N,...",
            show_default=False,
            help="Servo output of each thruster, below 0 where it is reversed; default: 1,2,3,...",
        ),
    ] = None,
    depth: Annotated[float, typer.Option(metavar="M", help="Depth of the start [m].")] = 0.0,
    idle: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="S",
            show_default=False,
            help="End after this time without a frame.",
        ),
    ] = None,
) -> None:
    """Simulate a vehicle live for another program, such as ArduSub.

    With --ardusub it speaks the JSON interface of ArduPilot's SITL over UDP: each frame of servo outputs
    moves the vehicle by 1/frame_rate, 0.05 s at most, and is answered with timestamp, imu, position, velocity
    and attitude. SITL waits for the answers and so sets the pace. 1100, 1500 and 1900 us are the commands -1,
    0 and 1. Frames with a smaller number restart the vehicle, and repeated ones are answered again.
    Packets that are no frames are dropped, and so are frames of a second client while the first one sends.
    Ctrl-C ends and says how many there were.
    """
    from hydro.export import ardusub as sitl
    from hydro.io import vehicle as vehicles

    if not ardusub:
        raise UsageError("say what to serve: --ardusub")
    known, _ = vehicles.read(vehicle)
    count = len(known.thruster)
    outputs = sitl.channels(channels or ",".join(str(i + 1) for i in range(count)), count)
    with about(str(vehicle)):
        sub = sitl.Sub(known, outputs, depth)

    def ready(taken: int) -> None:
        message(f"hydro: {known.name} listens on {host}, UDP port {taken}; Ctrl-C ends")
        if not host.startswith(LOOPBACK):
            message(
                f"hydro: {host} is not a loopback address: others can reach this port and move the vehicle"
            )

    try:
        sitl.serve(sub, host, port, ready=ready, ended=lambda since: idle is not None and since >= idle)
    finally:
        message(f"hydro: {sub.counts.words()}")


COMMANDS = {
    serve: "hydro serve datasets/stonefish/vehicle.toml --ardusub --port 0 --idle 1",
}
