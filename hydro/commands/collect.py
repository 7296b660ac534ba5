"""Command `collect`: recordings from a reference simulator, with noise and with hidden effects."""

from __future__ import annotations

import dataclasses
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.places import FILE, Output
from hydro.commands.shell import STREAM, about, noise_for, progress, refuse_terminal, seed_option, write
from hydro.core.effects import examples
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from hydro.core.vehicle.description import Vehicle
    from hydro.io.table import Artefact
    from hydro.sim.stonefish.recorder import StonefishTeacher
    from hydro.sim.teacher import Teacher

    AnyTeacher = Teacher | StonefishTeacher

ROWS = 857_542
"""Default number of rows: that of the paper (IV-A)."""


MANY = 2 * ROWS
"""Minimum number of rows for which the duration is estimated."""
SHARE = 0.01
"""Share of the rows after which the duration is estimated."""

TeacherKind = Annotated[
    Literal["panel", "stonefish"],
    typer.Option(help="Source of the hydrodynamic forces."),
]
Rows = Annotated[
    int | None,
    typer.Option(min=1, show_default=False, help=f"Rows at 50 Hz; default: {ROWS:,}, or one replay."),
]
Excitation = Annotated[
    Literal["hybrid", "sweeps", "coupled", "walks", "replay90"],
    typer.Option(help="Mixture, one part of it, or a 90 s replay."),
]
Noise = Annotated[
    str,
    typer.Option(
        metavar="SPEC",
        help="none, ordinary, dvl, or 1-sigma values: '{velocity=0.02, rate=0.003}'.",
    ),
]
Truth = Annotated[str | None, typer.Option(metavar="FILE", help="TOML file for the hidden effects."), FILE]
Depth = Annotated[float, typer.Option(min=0.0, help="Depth of the start and of the hold [m].")]
Threads = Annotated[
    int | None, typer.Option(min=1, show_default=False, help="Sessions at a time; default: one per core.")
]


def collect(
    vehicle: Annotated[Path, typer.Option("--vehicle", metavar="FILE", help="Vehicle file.")],
    teacher: TeacherKind = "panel",
    rows: Rows = None,
    excitation: Excitation = "hybrid",
    seed: Annotated[int, seed_option("Seed of sessions, demands, headings and noise.")] = 0,
    noise: Noise = "none",
    hide: Annotated[
        list[str] | None,
        typer.Option(
            metavar="EFFECT",
            help=f"Effect that is not in the file, such as '{examples.TO_HIDE}'.",
        ),
    ] = None,
    truth: Truth = None,
    depth: Depth = 50.0,
    threads: Threads = None,
    output: Output = STREAM,
) -> None:
    """Record training data of a vehicle in a reference simulator.

    Mass, buoyancy, thrusters and environment are those of the vehicle file. Hydrodynamic forces are computed
    from panels on the hull, or by Stonefish; added mass and damping of the file are ignored. Effects of
    --hide are written to the file of --truth alone, never into the recording.

        hydro collect --vehicle vehicle.toml --rows 9000 -o raw.parquet

    Details:

    With panels, the added mass is that of the hull's ellipsoid. Stonefish 1.4 or later gets hull, mass,
    buoyancy, thrusters and a uniform current of the vehicle file. It runs in the program hydro-stonefish,
    which is built from bridge/stonefish, and is searched on the PATH or at the environment variable
    HYDRO_STONEFISH (docs/stonefish.md).
    """
    refuse_terminal(output)
    given = _Given(vehicle, teacher, rows, excitation, seed, noise, depth, threads)
    hidden = _hidden(hide or [])
    subject, artefact = _recorded(given, hidden)
    if truth is not None:
        _write_truth(truth, subject, hidden, artefact.provenance.content)
    write(artefact, output)


@dataclasses.dataclass(frozen=True)
class _Given:
    """Arguments of `collect`, except hidden effects and outputs."""

    vehicle: Path
    teacher: Literal["panel", "stonefish"]
    rows: int | None
    excitation: Literal["hybrid", "sweeps", "coupled", "walks", "replay90"]
    seed: int
    noise: str
    depth: float
    threads: int | None


def _recorded(given: _Given, hidden: list[dict[str, Any]]) -> tuple[AnyTeacher, Artefact]:
    """Return the reference simulator with hidden effects, and its recording."""
    from hydro.core.simulation.excitation import LOG_RATE, REPLAY, REPLAY_SECONDS
    from hydro.io import table
    from hydro.sim import teacher as sim

    sigma = noise_for(given.noise)
    subject, text = _teacher(given, hidden)
    of_stonefish = _stonefish(subject)
    count = given.rows or (round(REPLAY_SECONDS * LOG_RATE) if given.excitation == REPLAY else ROWS)
    tell = _foretelling(count)
    with progress("collect") as update, about(str(given.vehicle)):

        def report(done: int) -> None:
            update(done, count, f"{done:,} of {count:,} rows")
            tell(done)

        frame = sim.collect(
            subject,
            count,
            given.seed,
            programme=sim.Programme(given.excitation, given.depth),
            noise=sigma,
            threads=given.threads,
            report=report,
        )
    parameters = {
        "teacher": given.teacher,
        **of_stonefish,
        "rows": count,
        "excitation": given.excitation,
        "noise": dataclasses.asdict(sigma),
        "depth": given.depth,
        "ignored": list(subject.ignored),
    }
    made = table.make(
        "raw", frame, stage="collect", parameters=parameters, seed=given.seed, vehicle_text=text
    )
    return subject, made


def _teacher(given: _Given, hidden: list[dict[str, Any]]) -> tuple[AnyTeacher, str]:
    """Return the reference simulator of a vehicle file and the text of the file; print replaced effects."""
    from hydro.io import mesh
    from hydro.io import vehicle as vehicles

    file, build = given.vehicle, _builder(given.teacher)
    known, text = vehicles.read(file)
    surface = mesh.read_obj(file.parent / known.hull.mesh) if known.hull.mesh is not None else None
    with about(str(file)):
        subject = build(known, mesh=surface)
    if hidden:
        subject = _with_hidden(build, known, surface, hidden)
    if subject.ignored and sys.stderr.isatty():
        replaced = ", ".join(subject.ignored)
        typer.echo(f"the {given.teacher} simulator replaces the vehicle file's {replaced}", err=True)
    return subject, text


def _builder(teacher: Literal["panel", "stonefish"]) -> Callable[..., AnyTeacher]:
    """Return the function that builds the reference simulator of a vehicle."""
    if teacher == "stonefish":
        from hydro.sim.stonefish.recorder import stonefish_teacher

        return stonefish_teacher
    from hydro.sim.teacher import teacher as embedded

    return embedded


def _stonefish(subject: AnyTeacher) -> dict[str, str]:
    """Return the version of Stonefish, for the footer; empty for another simulator.

    The call fails before any recording if Stonefish is missing.
    """
    from hydro.sim.stonefish.recorder import StonefishTeacher

    return {"stonefish": subject.version()} if isinstance(subject, StonefishTeacher) else {}


def _foretelling(rows: int, clock: Callable[[], float] = time.monotonic) -> Callable[[int], None]:
    """Return a function that, given the number of finished rows, prints the remaining time once.

    The first session is not used for the estimate, because kernels may be compiled in it.

    Args:
        rows: Number of all rows.
        clock: Function that returns the time [s].
    """
    from hydro.core.recording import extent

    first: list[tuple[int, float]] = []
    told: list[int] = []

    def tell(done: int) -> None:
        if rows < MANY or told:
            return
        now = clock()
        first[:] = first or [(done, now)]
        before, begun = first[0]
        if done - before >= SHARE * rows:
            told.append(done)
            left = extent.duration((now - begun) * (rows - done) / (done - before))
            size = rows * extent.BYTES_PER_ROW / 1e9
            typer.echo(f"hydro: {rows:,} rows (about {size:.1f} GB): about {left} left", err=True)

    return tell


def _hidden(texts: Sequence[str]) -> list[dict[str, Any]]:
    """Return effect tables from texts `NAME={...}` with inline TOML.

    Raises:
        UsageError: A text has another form, or names an unknown effect.
    """
    import difflib

    from hydro.core import toml_text
    from hydro.core.effects import CATALOGUE

    tables: list[dict[str, Any]] = []
    for text in texts:
        try:
            given = toml_text.content(text)
        except DataError:
            given = {}
        if not given or not all(isinstance(values, dict) for values in given.values()):
            raise UsageError(
                f"--hide {text!r:.80}: not an effect with its parameters; write it like '{examples.TO_HIDE}'"
            )
        for name, values in given.items():
            if name not in CATALOGUE:
                near = difflib.get_close_matches(name, CATALOGUE, n=1)
                hint = f"did you mean {near[0]}?" if near else f"there are {', '.join(CATALOGUE)}"
                raise UsageError(f"--hide {name}: no effect of the catalogue; {hint}")
            tables.append({**values, "name": name})
    return tables


def _with_hidden(
    build: Callable[..., AnyTeacher], known: Vehicle, surface: Any, hidden: list[dict[str, Any]]
) -> AnyTeacher:
    """Return the reference simulator with hidden effects; errors in these effects name `--hide`.

    Args:
        build: Function that builds the simulator.
        known: Vehicle of the file.
        surface: Vertices and faces of the hull; None without a mesh.
        hidden: Tables of the hidden effects.
    """
    from hydro.core.effects import CATALOGUE

    try:
        for table in hidden:
            effect = CATALOGUE[table["name"]]
            effect.pack(table, thrusters=len(known.thruster), where=f"--hide {effect.name}")
        return build(known, mesh=surface, hidden=hidden)
    except DataError as error:
        raise UsageError(str(error) if "--hide" in str(error) else f"--hide: {error}") from error


def _write_truth(path: str, subject: AnyTeacher, hidden: list[dict[str, Any]], content: str) -> None:
    """Write the hidden effects and the simulator's own forces, which the recording's footer does not have.

    Args:
        path: File to write.
        subject: The reference simulator.
        hidden: Tables of the hidden effects.
        content: Hash of the recording.
    """
    import tomlkit

    from hydro.io.files import write_bytes
    from hydro.sim.teacher import Teacher

    document = tomlkit.document()
    document.add(tomlkit.comment("Hidden truth of a recording of `hydro collect`."))
    document.add("format", tomlkit.item("hydro-truth/1"))
    document.add("raw", tomlkit.item(content))
    if isinstance(subject, Teacher):
        document.add("panel", tomlkit.item(_panel(subject)))
    else:
        document.add("stonefish", tomlkit.item({"scenario": subject.scenario.text}))
    effects = tomlkit.aot()
    for table in hidden:
        effects.append(tomlkit.item({"name": table["name"]} | table))
    if hidden:
        document.add("effect", effects)
    write_bytes(tomlkit.dumps(document).encode(), path)


def _panel(subject: Teacher) -> dict[str, Any]:
    """Return coefficients, size and added mass of the embedded reference simulator."""
    from hydro.core.effects.inertia import ADDED_MASS
    from hydro.core.vehicle.panels import FORM_DRAG, SKIN_FRICTION

    return {
        "form_drag": FORM_DRAG,
        "skin_friction": SKIN_FRICTION,
        "facets": subject.facets.shape[1],
        "volume": subject.hull.volume,
        ADDED_MASS.name: subject.added_mass.tolist(),
    }


COMMANDS = {
    collect: "hydro collect --vehicle datasets/stonefish/vehicle.toml --rows 6000 --seed 1 -o raw.parquet",
}
