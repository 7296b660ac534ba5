"""Command lines and Python code that do the same as the history of a session."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path

from hydro.app.opening import Further, Opened, is_table
from hydro.app.session import Rung, Session
from hydro.core.diagnosis.findings import inline
from hydro.core.explanation.explain import BEST, over
from hydro.core.vehicle.description import Vehicle

RAW, HELD_OUT, BEFORE = "raw.parquet", "holdout.parquet", "before.parquet"
"""Names of imported recordings."""


def shell(session: Session) -> str:
    """Return command lines that lead to the present state of a session, as one text with a line per step."""
    return "\n".join(_lines(session))


def python(session: Session) -> str:
    """Return Python code that leads to the present state of a session, as one text."""
    return "\n".join(_statements(session))


def _further(opened: Opened) -> list[tuple[str, Further, str]]:
    """Return option, recording, and name of the imported table of each further recording."""
    given = (("--holdout", opened.holdout, HELD_OUT), ("--before", opened.before, BEFORE))
    return [(option, one, name) for option, one, name in given if one is not None]


def _runs(session: Session) -> Iterator[tuple[str, list[Rung]]]:
    """Yield the states up to the present one as pairs of kind and states; one study's states are together."""
    shown = session.history[1 : session.at + 1]
    for key, run in groupby(
        shown, key=lambda one: (one.kind, one.base.text if one.kind == "added" else one.label)
    ):
        yield key[0], list(run)


def _lines(session: Session) -> Iterator[str]:
    opened, base = session.opened, session.rung.base
    if opened is None:
        return
    recording, file = _recording(session), session.history[0].base.path or base.path
    if opened.map:
        yield _line("import", *opened.paths, "--map", opened.map, "--vehicle", file, "-o", RAW)
    beside = list[str]()
    for option, one, name in _further(opened):
        if is_table([one.path]):
            beside += [option, one.path]
        else:
            beside += [option, name]
            yield _line("import", one.path, "--map", opened.map, "--vehicle", file, "-o", name)
    yield _line("compare", file, recording)
    for number, (kind, run) in enumerate(_runs(session), 1):
        last = run[-1]
        if kind == "added":
            folder = f"study-{number}"
            options = [] if _by_itself(last) else _added(last.wanted)
            yield _line("explain", file, recording, *beside, *options, "-o", folder)
            file = f"{folder}/vehicle-{last.steps[-1].number}.toml"
            yield _line("report", folder, "-o", "report.html")
        elif kind == "fitted":
            names, held = last.fitted
            fitted = [word for one in names for word in ("--effect", one)]
            fitted += [word for one in held for word in ("--known", one)]
            new = f"vehicle-{number}.toml"
            yield _line("fit", file, recording, *fitted, "-o", new)
            file = new
        else:
            new = f"vehicle-{number}.toml"
            yield f"cp {shlex.quote(file)} {new}  # then edit {new}: {last.label}"
            yield from _edits(_before(session, run[0]), last.vehicle)
            file = new
    if session.at:
        yield _line("compare", file, recording)


def _statements(session: Session) -> Iterator[str]:
    opened = session.opened
    if opened is None:
        return
    yield "import hydro"
    yield ""
    yield f"vehicle = hydro.vehicle({session.history[0].base.path!r})"
    if opened.map:
        logs = opened.paths[0] if len(opened.paths) == 1 else list(opened.paths)
        yield f"raw, _ = hydro.import_log({logs!r}, {opened.map!r})"
    else:
        yield f"raw = hydro.read({opened.paths[0]!r})"
    beside = ""
    for option, one, _ in _further(opened):
        name = option.removeprefix("--")
        beside += f", {name}={name}"
        if is_table([one.path]):
            yield f"{name} = hydro.read({one.path!r})"
        else:
            yield f"{name}, _ = hydro.import_log({one.path!r}, {opened.map!r})"
    for kind, run in _runs(session):
        last = run[-1]
        if kind == "added":
            wanted = "" if _by_itself(last) else f", add={list(last.wanted)!r}"
            yield f"study = hydro.explain(vehicle, raw{beside}{wanted})"
            yield "vehicle = study[-1].vehicle" if wanted else "vehicle = study.vehicle"
        elif kind == "fitted":
            names, held = last.fitted
            remark = f"  # {', '.join(held)} held: set known in their tables first" if held else ""
            yield f"vehicle = hydro.fit(vehicle, raw, {list(names)!r}).vehicle{remark}"
        else:
            tables = [dict(one) for one in last.vehicle.effect]
            yield "import msgspec"
            yield f"vehicle = msgspec.structs.replace(vehicle, effect=tuple({tables!r}))"
    yield "print(hydro.compare(vehicle, raw))"
    yield "hydro.write_vehicle(vehicle, 'vehicle-new.toml')"


def _before(session: Session, rung: Rung) -> Vehicle:
    """Return the vehicle of the state before a given state."""
    return session.history[max(session.history.index(rung) - 1, 0)].vehicle


def _edits(before: Vehicle, after: Vehicle) -> Iterator[str]:
    """Yield comment lines with the tables of effects that differ between two vehicles."""
    earlier = {table["name"]: table for table in before.effect}
    for table in after.effect:
        if earlier.get(table["name"]) != table:
            values = {key: value for key, value in table.items() if key != "name" and _is_value(value)}
            yield f"#   {table['name']} = {inline(values)}"
    gone = [name for name in earlier if not after.effects(str(name))]
    yield from (f"#   remove {name}" for name in gone)


def _is_value(value: object) -> bool:
    """Return whether a value of a table is a number, a text or a list, and not a note of a fit."""
    return isinstance(value, int | float | str | list | tuple)


def _added(wanted: Sequence[str]) -> list[str]:
    """Return the command-line options that add the given findings."""
    return [word for one in wanted for word in ("--add", one)]


def _by_itself(rung: Rung) -> bool:
    """Return whether `hydro explain` without further options gives the same steps as the app.

    That is so if the user chose no finding, and the study ended by itself.
    """
    return all(one == BEST for one in rung.wanted) and bool(over(rung.steps))


def _recording(session: Session) -> str:
    opened = session.opened
    return RAW if opened is not None and opened.map else opened.paths[0] if opened is not None else ""


def _line(*words: str) -> str:
    """Return a command line of the given words, with paths below the working folder made relative."""
    here = f"{Path.cwd()}/"
    return shlex.join(["hydro", *(word.removeprefix(here) for word in words)])
