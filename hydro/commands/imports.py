"""`import`: somebody's log to a raw table, and what the log itself says of its frames and signs."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.shell import STREAM, Output, about, dataset_name, refuse_terminal, write
from hydro.core.errors import DataError

if TYPE_CHECKING:
    from hydro.core.logs.convention_check import Verdict
    from hydro.core.logs.importing import Imported
    from hydro.core.logs.logmap import LogMap
    from hydro.io.log import Log
    from hydro.io.table import Artefact


def import_(
    log: Annotated[
        str, typer.Argument(metavar="LOG", show_default=False, help="A log, CSV or Parquet; - is stdin.")
    ],
    map_: Annotated[
        Path | None,
        typer.Option(
            "--map",
            metavar="FILE",
            help="What the columns mean: units, frames, signs; by default guessed from their names.",
        ),
    ] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option("--vehicle", metavar="FILE", help="Vehicle file, to go into the table's footer."),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option(
            min=0.1,
            max=10_000.0,
            show_default=False,
            help="Rows per second; by default the median of the channels' own rates.",
        ),
    ] = None,
    strict: Annotated[
        bool, typer.Option("--strict", help="Refuse a log whose motion contradicts the map.")
    ] = False,
    write_map: Annotated[
        str | None,
        typer.Option("--write-map", metavar="FILE", help="Only write a commented map to begin with."),
    ] = None,
    output: Output = STREAM,
) -> None:
    """Turn a log of your own into a raw table: one clock, NED and FRD, SI units, commands from -1 to 1.

    Each channel is interpolated from its own samples, commands are held, and no row stands in a gap. Then the
    motion itself is asked: d(position)/dt must be the velocity turned into the world, and the attitude must
    turn at the rates. Every other plausible frame, unit and sign is tried; what the data contradict is told
    with what to write instead.
    """
    from hydro.io import log as logs

    if write_map is None:
        refuse_terminal(output)
    source = logs.read(sys.stdin.buffer if log == STREAM else log)
    if write_map is not None:
        _write_draft(source, log, write_map)
        return
    meaning = _meaning(source, map_, dataset_name(log))
    text = _vehicle_text(vehicle, len(meaning.commands.columns))
    imported = _resampled(source, meaning, rate)
    verdict = _asked(source, imported, meaning, strict)
    for line in (*_account(imported), *_judged(verdict)):
        typer.echo(line, err=True)
    write(_artefact(source, imported, meaning, text), output)


def _write_draft(source: Log, log: str, path: str) -> None:
    """Write the map that the columns' names suggest."""
    from hydro.core.logs.aliases import guess
    from hydro.io import mapdraft
    from hydro.io.files import write_bytes

    names = source.frame.columns
    text = mapdraft.draft(guess(names, source.texts()), names, log)
    if path == STREAM:
        typer.echo(text, nl=False)
    else:
        write_bytes(text.encode(), path)


def _meaning(source: Log, file: Path | None, name: str) -> LogMap:
    """The map of `--map`, or the guessed one, told; a session that nobody names is called as the file is."""
    import msgspec

    from hydro.core.logs.aliases import guess
    from hydro.io import logmap

    if file is not None:
        meaning = logmap.read(file)
    else:
        names = source.frame.columns
        with about(source.name):
            meaning = logmap.from_guess(guess(names, source.texts()), names)
        typer.echo(f"guessed from the columns' names: {'; '.join(_told(meaning))}", err=True)
    if meaning.session.column is None and meaning.session.name is None:
        session = msgspec.structs.replace(meaning.session, name=name)
        meaning = msgspec.structs.replace(meaning, session=session)
    return meaning


def _told(meaning: LogMap) -> Iterator[str]:
    """What each block of a map says, in a few words."""
    from hydro.core.logs.logmap import command, measured

    yield f"time {meaning.time.column} [{meaning.time.unit}]"
    if meaning.session.column is not None:
        yield f"session {meaning.session.column}"
    place, turned = meaning.position, meaning.attitude
    settings = {
        "position": f"{place.world}, {place.unit}",
        "attitude": f"{turned.body} in {turned.world}, {turned.layout if turned.quaternion else turned.unit}",
        "velocity": f"{meaning.velocity.frame}, {meaning.velocity.unit}",
        "rates": f"{meaning.rates.frame}, {meaning.rates.unit}",
    }
    for name, words in settings.items():
        columns = " ".join(source.column for source in measured(getattr(meaning, name)))
        yield f"{name} {columns} [{words}]"
    columns = " ".join(command(source).column for source in meaning.commands.columns)
    yield f"commands {columns} [{meaning.commands.unit}]"


def _resampled(source: Log, meaning: LogMap, rate: float | None) -> Imported:
    """The log on one clock and in the raw table's frames."""
    from hydro.core.logs.importing import raw_table
    from hydro.io.sessions import sessions

    logs = sessions(source, meaning)
    with about(source.name):
        return raw_table(logs, meaning, rate)


def _asked(source: Log, imported: Imported, meaning: LogMap, strict: bool) -> Verdict:
    """What the motion says of the map.

    Raises:
        DataError: with `strict`, it contradicts it.
    """
    from hydro.core.logs.convention_check import check

    verdict = check(imported.logs, imported.times, imported.dt, meaning)
    if strict and verdict.contradictions:
        others = len(verdict.contradictions) - 1
        more = f" (and {others} more: see without --strict)" if others else ""
        raise DataError(f"{source.name}: {verdict.contradictions[0]}{more}")
    return verdict


def _artefact(source: Log, imported: Imported, meaning: LogMap, text: str | None) -> Artefact:
    """The raw table with the log and the map in its footer."""
    import msgspec

    from hydro.io import table
    from hydro.io.provenance import Provenance

    log = table.Artefact("log", source.frame, Provenance("log", "", source.digest))
    return table.make(
        "raw",
        imported.frame,
        stage="import",
        parameters={"rate": round(1.0 / imported.dt, 9), "map": msgspec.to_builtins(meaning)},
        inputs=[log],
        vehicle_text=text,
    )


def _vehicle_text(file: Path | None, commands: int) -> str | None:
    """The text of the vehicle file, once it is known to have as many thrusters as the log has commands."""
    from hydro.io import vehicle

    if file is None:
        return None
    known, text = vehicle.read(file)
    if len(known.thruster) != commands:
        raise DataError(
            f"the map names {commands} commands, but {file} has {len(known.thruster)} thrusters: name one "
            "column per thruster in commands.columns, in the file's order"
        )
    return text


def _account(imported: Imported) -> Iterator[str]:
    """How many rows there are, and what is missing."""
    sessions, rate = len(imported.logs), 1.0 / imported.dt
    yield (
        f"{imported.frame.height:,} rows at {rate:g} Hz in {sessions} session{'s' if sessions > 1 else ''}"
    )
    if imported.gaps:
        longest = max(imported.gaps, key=lambda gap: gap.stop - gap.start)
        total = sum(gap.stop - gap.start for gap in imported.gaps)
        yield (
            f"gaps left open: {len(imported.gaps)}, {total:.3g} s in all; the longest, "
            f"{longest.stop - longest.start:.3g} s, after {longest.start:.5g} s of {longest.session}"
        )
    if imported.left_out:
        yield f"left out, for no two rows have all columns: {', '.join(imported.left_out)}"
    for name, count in imported.clipped.items():
        yield f"warning: {name} is beyond -1 to 1 in {count:,} rows and clipped: check commands.unit and pwm"


def _judged(verdict: Verdict) -> Iterator[str]:
    """What the kinematics say."""
    yield from (f"warning: {line}" for line in verdict.contradictions)
    translation, rotation = verdict.agreement
    if not verdict.contradictions and translation == translation:  # NaN where nothing was tested
        yield (
            f"pose and velocity agree: d(position)/dt to {translation:.2g} m/s, the attitude's rate to "
            f"{rotation:.2g} rad/s"
        )
    yield from (f"note: {line}" for line in verdict.notes)


import_.__name__ = "import"  # a keyword of Python's, and the name of the command

COMMANDS = {
    import_: "hydro import datasets/logs/example.csv --map datasets/logs/map.toml -o raw.parquet",
}
