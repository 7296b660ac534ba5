"""Command `import`: convert a log to a raw table, and check its frames and signs by kinematics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.places import FILE, Output
from hydro.commands.recordings import Definitions, MaxExpanded, opened, reading
from hydro.commands.shell import STREAM, message, refuse_terminal, write
from hydro.core.errors import DataError

Preset = Literal["mavros", "ardusub", "blueos", "stonefish", "px4", "qgroundcontrol"]


def import_(
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            show_default=False,
            help="Log, or the files of one dive; - is stdin.",
        ),
    ],
    map_: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="Map of the columns; default: guessed from their names.",
        ),
    ] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option("--vehicle", metavar="FILE", help="Vehicle file for the table's footer."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=10_000.0,
            show_default=False,
            help="Rows per second; default: from the channels, at most 50.",
            rich_help_panel=ADVANCED,
        ),
    ] = None,
    fill: Annotated[
        bool,
        typer.Option("--fill", help="Interpolate slow sensors to every row.", rich_help_panel=ADVANCED),
    ] = False,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict", help="Refuse a log whose motion contradicts the map.", rich_help_panel=ADVANCED
        ),
    ] = False,
    write_map: Annotated[
        str | None,
        typer.Option("--write-map", metavar="FILE", help="Only draft a map, with comments."),
        FILE,
    ] = None,
    topics: Annotated[
        bool,
        typer.Option("--topics", help="Only list topics, fields, rates and times of a log."),
    ] = False,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    preset: Annotated[
        Preset | None,
        typer.Option(show_default=False, help="Whose names the columns have.", rich_help_panel=ADVANCED),
    ] = None,
    force: Annotated[
        bool,
        typer.Option("--force", help="Overwrite an existing map with --write-map.", rich_help_panel=ADVANCED),
    ] = False,
    output: Output = STREAM,
) -> None:
    """Convert a log to a raw table: one clock, NED and FRD, SI units.

    Reads ROS 1 and 2 bags, MCAP, DataFlash .bin, PX4 .ulg, MAVLink .tlog, CSV, Parquet, .npz and .mat. A map
    says what the columns mean. Frames, units, signs and delays of the map are checked by kinematics.

        hydro import dive.mcap --topics
        hydro import dive.bag --write-map map.toml
        hydro import dive.bag --map map.toml -o raw.parquet
        hydro import nav.bag commands.csv --map map.toml -o raw.parquet

    Details:

    Commands are scaled to -1 to 1. Each channel is interpolated from its own samples, commands are held, and
    no row is made within a gap. A sensor slower than the rows has a value only in the rows nearest to its
    samples: fits count each sample once. replay needs values in every row: add --fill. The rate of the rows
    is the median of the rates of the channels, or the fastest of them if it is much faster.

    The check by kinematics: d(position)/dt must equal the velocity rotated into the world frame, and the
    attitude must change at the measured rates. Every other plausible frame, unit and sign is tried. If the
    data contradict the map, a warning says what to write instead. Late stamps of a sensor or of the commands
    are found as well. With --vehicle the thrusters are audited, as by hydro check VEHICLE LOG.

    The format is recognised by the first bytes. Columns of a log of messages are called topic.field, such as
    /dvl/data.velocity.x or XKF1[0].PN, and time [s]. Several files are merged by time; files that do not
    overlap become sessions with the names of the files.
    """
    from hydro.io import log_files, log_topics, recordings

    if write_map is None and not topics:
        refuse_terminal(output)
    with opened(logs, msg) as files:
        if topics:
            for file in files:
                with reading(file) as update:
                    print(*log_topics.lines(file, update), sep="\n")
            return
        if write_map is not None:
            names, blocks = log_files.drafted(files, reading, preset)
            _write_draft(names, blocks, logs[0], write_map, force=force)
            return
        made = recordings.imported(
            files,
            map_,
            message,
            vehicle_file=vehicle,
            preset=preset,
            rate=rate,
            strict=strict,
            fill=fill,
            progress=reading,
        )
    write(made, output)


def _write_draft(
    names: Sequence[str], blocks: Mapping[str, Any], log: str, path: str, *, force: bool
) -> None:
    """Write a draft of the map that the log suggests.

    Without `force`, an existing map is not overwritten, because it may have been edited.
    """
    from hydro.io import mapdraft
    from hydro.io.files import write_bytes

    text = mapdraft.draft(blocks, names, log)
    if path == STREAM:
        typer.echo(text, nl=False)
    else:
        there = Path(path)
        if there.is_file() and not force and there.read_bytes() != text.encode():
            raise DataError(
                f"{path} is there already and is not this draft: give --force to replace it, or another name"
            )
        write_bytes(text.encode(), path)


import_.__name__ = "import"  # a keyword of Python's, and the name of the command

COMMANDS = {
    import_: "hydro import datasets/logs/example.csv --map datasets/logs/map.toml -o raw.parquet",
}
