"""Command `start`: guided import, audit, explanation and report of a log, for new users."""

from __future__ import annotations

import contextlib
import textwrap
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.asking import Asker, asks
from hydro.commands.places import FOLDER
from hydro.commands.recordings import Definitions, MaxExpanded, dataset, opened, reading
from hydro.commands.shell import STREAM, message
from hydro.core.errors import DataError, UsageError, in_shell, listed

if TYPE_CHECKING:
    from hydro.core.guessing.vehicle_choice import Choice, Preset
    from hydro.io.log import LogFile
    from hydro.io.map_proposal import Proposal
    from hydro.study.guided import Places
    from hydro.study.steps import Runner, Step

Line = str | None
COLUMNS = "COLUMNS"


def _line(of: str) -> Any:
    """Return the option for one line of the map, with the help text `of`."""
    return typer.Option(metavar=COLUMNS, show_default=False, help=f"{of}.")


def start(
    context: typer.Context,
    logs: Annotated[
        list[str],
        typer.Argument(
            metavar="LOG...",
            show_default=False,
            help="A log of any format that hydro import reads, the files of one dive, or a raw table.",
        ),
    ],
    folder: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="DIR",
            show_default=False,
            help="Folder for all results; default: LOG-start, from the name of the log.",
        ),
        FOLDER,
    ] = None,
    map_: Annotated[
        Path | None,
        typer.Option(
            "--map", metavar="FILE", show_default=False, help="Map of the log; skips its questions."
        ),
    ] = None,
    time: Annotated[Line, _line("Clock: column and unit")] = None,
    position: Annotated[Line, _line("Position or depth: columns, axes and unit")] = None,
    attitude: Annotated[Line, _line("Attitude: columns, axes and unit; or none")] = None,
    velocity: Annotated[Line, _line("Velocity over ground: columns, axes, unit")] = None,
    rates: Annotated[Line, _line("Angular velocity: columns, axes and unit")] = None,
    commands: Annotated[Line, _line("Thruster commands: columns and unit")] = None,
    vehicle: Annotated[
        Path | None,
        typer.Option(metavar="FILE", show_default=False, help="Vehicle file; skips its questions."),
    ] = None,
    preset: Annotated[
        str | None,
        typer.Option(metavar="NAME", show_default=False, help="Known vehicle, such as bluerov2_heavy."),
    ] = None,
    layout: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            show_default=False,
            help="Layout of the thrusters, see hydro vehicle new; default: by their number.",
        ),
    ] = None,
    mass: Annotated[
        float | None, typer.Option(metavar="KG", show_default=False, help="Dry mass [kg].")
    ] = None,
    box: Annotated[
        tuple[float, float, float] | None,
        typer.Option(metavar="L W H", show_default=False, help="Length, width and height of the hull [m]."),
    ] = None,
    thrust: Annotated[
        float | None,
        typer.Option(
            metavar="N", show_default=False, help="Greatest thrust of each thruster [N]; default: a T200's."
        ),
    ] = None,
    correct_thrusters: Annotated[
        bool,
        typer.Option(
            "--correct-thrusters/--keep-thrusters",
            help="If the audit contradicts the vehicle file: continue with the audit's result, or stop.",
        ),
    ] = True,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
) -> None:
    """Turn a log into a report with a few questions.

    At most eight questions ask for the columns of each sensor, their axes and units, and the vehicle. Column
    names, values and the motion in the log suggest the answers: press Enter to accept one. The command then
    imports and draws the log, audits the thrusters, searches for missing effects and writes a report. It
    prints every command that it runs and saves all of them in DIR/commands.sh. Without a terminal it uses the
    suggested answers. Every answer has an option. To correct an answer, edit DIR/map.toml or DIR/vehicle.toml
    and run the same command again: it skips the steps whose inputs have not changed.

    Details:

    One text names the columns of a sensor, its axes and its unit; braces list or count columns:

        hydro start dive.bag -o study

        hydro start dive.csv --velocity 'dvl_{x,y,z} FLU' --commands 'motor{1..6} pwm' --preset bluerov2

        hydro start dive.csv --position 'depth=press_m' --mass 30 --box 1.2 0.5 0.4 --layout vectored8
    """
    lines = {
        name: text
        for name, text in zip(
            ("time", "position", "attitude", "velocity", "rates", "commands"),
            (time, position, attitude, velocity, rates, commands),
            strict=True,
        )
        if text is not None
    }
    hull = {"mass": mass, "thrust": thrust} | dict(
        zip(("length", "width", "height"), box or (None,) * 3, strict=True)
    )
    given = Given(
        logs,
        map_,
        lines,
        vehicle,
        preset,
        layout,
        {key: value for key, value in hull.items() if value is not None},
    )
    given.check()
    with contextlib.ExitStack() as held:
        if folder is None:
            folder = Path(f"{Path(logs[0]).stem}-start")
            held.enter_context(_held(folder))
        if msg is not None:
            given.reading += ["--msg", str(msg)]
        if max_expanded is not None:
            given.reading += ["--max-expanded", f"{max_expanded:g}"]
        files = held.enter_context(opened(logs, msg)) if dataset(logs) is None else []
        _Guide(context.find_root().command, folder, given, files, corrects=correct_thrusters).run()


@dataclass
class Given:
    """Options of the command line of `hydro start`.

    Attributes:
        logs: Paths of the logs.
        map: A map file, the meaning of the logs' columns; None without one.
        lines: Texts of blocks of the map, by the name of the block, such as `velocity`.
        vehicle: A vehicle file; None without one.
        preset: Name of a known vehicle.
        layout: Name of a layout of thrusters.
        hull: `mass`, `length`, `width`, `height`, `thrust` as far as given.
        reading: Further options of `hydro import`.
    """

    logs: list[str]
    map: Path | None
    lines: dict[str, str]
    vehicle: Path | None
    preset: str | None
    layout: str | None
    hull: dict[str, float]
    reading: list[str] = field(default_factory=list)

    @property
    def makes_vehicle(self) -> bool:
        """Whether options define a new vehicle file."""
        return self.preset is not None or self.layout is not None or bool(self.hull)

    def check(self) -> None:
        """Raise an error if two options set the same thing.

        Raises:
            UsageError: Two options set the same thing.
        """
        if STREAM in self.logs:
            raise UsageError("hydro start reads the log several times: give a file, not -")
        if self.map is not None and self.lines:
            raise UsageError(
                f"--map defines these columns: leave {listed([f'--{name}' for name in self.lines])} out"
            )
        if self.vehicle is not None and self.makes_vehicle:
            raise UsageError("--vehicle is complete: leave the options that make a vehicle out")
        if self.preset is not None and self.layout is not None:
            raise UsageError("--preset and --layout: give one of them")


@contextlib.contextmanager
def _held(folder: Path) -> Generator[None]:
    """Lock the default folder."""
    from hydro.io.files import check_folder
    from hydro.io.lock import alone

    check_folder(folder)
    with alone(folder):
        yield


class _Guide:
    """One run of `hydro start`."""

    def __init__(
        self, root: Any, folder: Path, given: Given, files: Sequence[LogFile], *, corrects: bool
    ) -> None:
        self._root, self._folder, self._given, self._files = root, folder, given, files
        self._corrects = corrects
        self._asker = Asker(given.logs[0])
        self._code = 0

    def run(self) -> None:
        """Ask the user the questions, run the commands of the study, and list the written files."""
        from hydro.study import guided
        from hydro.study.steps import Runner

        runner = Runner(self._folder, self._execute, message)
        table = self._is_table()
        file = None if table else self._map()
        made = self._vehicle(runner, self._thrusters(file))
        vehicle = self._given.vehicle or self._folder / "vehicle.toml"
        recording = Path(self._given.logs[0]) if table else self._folder / "raw.parquet"
        places = guided.Places(self._folder, file, vehicle, recording)
        parts = [part for one in self._files for part in one.parts]
        first = [] if table else [guided.imported(places, self._given.logs, parts, self._given.reading)]
        anew = runner.run([*made, *first])
        if anew or table or not places.picture.exists():
            self._draw(places)
        message(
            f"hydro: {places.picture}: picture of the recording. If it does not show the dive, stop with "
            f"Ctrl-C, edit {places.map or places.vehicle} and run the same command again"
        )
        check = guided.audited(places)
        message(f"hydro {check.name}")
        self._execute(check)
        rest = [
            guided.explained(places, corrected=bool(self._code) and self._corrects),
            guided.reported(places),
        ]
        self._write_script(places, [*made, *first, check, *rest])
        if self._code and self._corrects:
            message(
                "hydro: the audit contradicts the vehicle file: explain continues with the audit's result "
                "(--keep-thrusters stops instead)"
            )
        try:
            runner.run(rest)
        finally:
            self._tell(places)

    def _is_table(self) -> bool:
        """Return whether the recording is a raw table, which needs no import.

        Raises:
            UsageError: A raw table is combined with other logs or with a map.
        """
        from hydro.io import recordings

        tables = [one for one in self._files if recordings.is_artefact(one)]
        if self._files and not tables:
            return False
        if len(self._given.logs) > 1:
            raise UsageError(f"{self._given.logs[0]}: give one raw table, or logs without raw tables")
        if self._given.map is not None or self._given.lines:
            raise UsageError(
                f"{self._given.logs[0]}: a raw table needs no map: leave --map and its lines out"
            )
        return True

    def _map(self) -> Path:
        """Return the path of the logs' map: the given one, an existing one in the folder, or a new one."""
        if self._given.map is not None:
            return self._given.map
        path = self._folder / "map.toml"
        if path.exists() and not self._given.lines:
            message(f"hydro: {path}: using the existing file; delete it to be asked again")
            return path
        from hydro.io import mapdraft
        from hydro.io.files import write_bytes
        from hydro.io.map_proposal import corrected, proposed

        known = self._given.vehicle
        proposal = proposed(self._files, self._given.lines, reading, _count(known) if known else None)
        blocks = self._answered(proposal)
        if blocks != proposal.blocks:
            changed = {name for name in blocks if blocks[name] != proposal.blocks.get(name)}
            blocks, notes = corrected(self._files, proposal.columns, blocks, changed, reading)
            for note in notes:
                message(f"hydro: {note}")
        blocks.setdefault("session", {"name": self._files[0].stem})
        text = mapdraft.draft(blocks, proposal.columns, self._given.logs[0], blanks=False)
        _keep(path, text)
        write_bytes(text.encode(), path)
        message(f"hydro: {path}: map written; to correct it, edit it and run the same command again")
        return path

    def _answered(self, proposal: Proposal) -> dict[str, Any]:
        """Show the proposed map, ask for corrections and return the blocks.

        Raises:
            UsageError: The map lacks a required line and there is no terminal.
        """
        from hydro.core.guessing import interview
        from hydro.core.guessing.map_lines import KINDS, text_of
        from hydro.io import log_topics

        message(f"\n{' '.join(self._given.logs)}: {len(proposal.columns)} columns. Proposed map:")
        for name in KINDS:
            message(f"  {name:<9} {text_of(name, proposal.blocks.get(name))}")
        for note in proposal.notes:
            message(f"  note: {note}")
        missing = interview.lacking(proposal.blocks)
        if not asks():
            if missing:
                raise UsageError(_wanting(self._given.logs[0], missing))
            return dict(proposal.blocks)
        message("\nPress Enter to accept the answer in brackets; type ? to list the columns.")
        hint = textwrap.fill(" ".join(log_topics.ranges(proposal.columns)), 100, break_long_words=False)
        blocks = self._asker.talk(interview.about_map(proposal.columns, proposal.blocks), hint)
        if missing := interview.lacking(blocks):
            raise DataError(f"{self._given.logs[0]}: the map has no {listed(missing)}: name its columns")
        return blocks

    def _thrusters(self, map_: Path | None) -> int:
        """Return the number of command columns of the recording."""
        from hydro.core.columns import COMMAND
        from hydro.core.logs.mixer import thrusters
        from hydro.io import logmap

        if map_ is None:
            return sum(name.startswith(COMMAND) for name in self._table().frame.columns)
        meaning = logmap.read(map_)
        return thrusters(meaning.mixer, len(meaning.commands.columns))

    def _table(self) -> Any:
        """Return the raw table that was given."""
        from hydro.io import table

        return table.read(self._given.logs[0], ("raw",))

    def _vehicle(self, runner: Runner, thrusters: int) -> list[Step]:
        """Provide the vehicle file; return the command that makes it, if a command does."""
        from hydro.core.guessing import interview
        from hydro.core.guessing.vehicle_choice import command_line
        from hydro.io import vehicle as vehicles
        from hydro.study.steps import Step

        if self._given.vehicle is not None:
            vehicles.read(self._given.vehicle)
            return []
        path = self._folder / "vehicle.toml"
        if path.exists() and not self._given.makes_vehicle:
            message(f"hydro: {path}: using the existing file; delete it to be asked again")
            return []
        fleet = _fleet()
        footer = "" if self._files and not self._is_table() else (self._table().provenance.vehicle or "")
        if self._given.makes_vehicle:
            given = self._given
            choice = interview.by_options(fleet, thrusters, given.preset, given.layout, given.hull)
        else:
            talk = interview.about_vehicle(fleet, thrusters, _FOOTER if footer else "")
            choice = self._asker.talk(talk, _described(fleet))
        if choice.layout is not None and choice.hull is not None:
            step = Step(command_line(choice.layout, choice.hull, str(path)), (), (path,))
            if path.exists() and not runner.done(step):
                raise _other(path)
            return [step]
        in_footer = bool(footer) and choice.file == _FOOTER
        text = footer if in_footer else vehicles.read(_file_of(choice))[1]
        _keep(path, text)
        vehicles.write(text, path)
        return []

    def _execute(self, step: Step) -> None:
        """Run a step in this process and keep its exit code."""
        code = self._root.main(list(step.line), prog_name="hydro", standalone_mode=False)
        self._code = code if isinstance(code, int) else 0
        if self._code and step.line[0] != "check":
            raise typer.Exit(self._code)

    def _draw(self, places: Places) -> None:
        """Draw the imported recording."""
        from hydro.io import table
        from hydro.report import figures, overview

        rows = overview.overview(table.read(places.recording, ("raw",)).frame)
        figures.save(overview.draw(rows, " ".join(self._given.logs)), places.picture)

    def _write_script(self, places: Places, steps: Sequence[Step]) -> None:
        """Write the commands as a script."""
        from hydro.io.files import write_bytes
        from hydro.study import guided

        meaning = [] if places.map is None else ["--map", str(places.map)]
        again = ["start", *self._given.logs, *meaning, "--vehicle", str(places.vehicle), *self._given.reading]
        write_bytes(guided.script(steps, Path.cwd(), again).encode(), places.script)

    def _tell(self, places: Places) -> None:
        """List the files and folders written; an empty folder is of a step that failed."""
        told = [
            (places.map, "map of the log"),
            (places.vehicle, "vehicle file"),
            (places.recording, "imported recording, for all other commands"),
            (places.picture, "picture of the recording"),
            (places.study, "results of explain, step by step"),
            (places.script, "all commands above, as a shell script"),
            (places.report, "report: open it in a browser"),
        ]
        width = max(len(str(path)) for path, _ in told)
        for path, what in told:
            if path is not None and path.exists() and (path.is_file() or any(path.iterdir())):
                typer.echo(f"{path!s:<{width}}  {what}")


_FOOTER = "footer"
"""Answer that selects the vehicle file in the footer of the recording."""


def _wanting(log: str, missing: Sequence[str]) -> str:
    """Return the message for a map in which required blocks are missing."""
    from hydro.core.guessing.map_lines import EXAMPLES

    name = missing[0] if missing[0] in EXAMPLES else "rates"
    example = EXAMPLES[name].partition(", or ")[0]
    return (
        f"{log}: no columns found for {listed(missing)}: give them, such as --{name} '{example}', or --map "
        f"FILE; `hydro import {in_shell(log)} --topics` lists the columns"
    )


def _count(vehicle: Path) -> int:
    """Return the number of thrusters of a vehicle file."""
    from hydro.io import vehicle as vehicles

    return len(vehicles.read(vehicle)[0].thruster)


def _fleet() -> list[Preset]:
    """Return the known vehicles to choose from: the bundled vehicle files, and the BlueROV2."""
    from hydro.core.guessing.vehicle_choice import BLUEROV2, Hull, Preset
    from hydro.io import vehicle as vehicles
    from hydro.io.files import bundled

    found = [BLUEROV2]
    for path in sorted(bundled("vehicles").glob("*.toml")):
        known, _ = vehicles.read(path)
        sides = (known.hull.length, known.hull.width, known.hull.height)
        servos = not all(each.pushes for each in known.thruster)
        box = Hull(known.rigid_body.mass, sides)
        found.append(Preset(path.stem, len(known.thruster), box, servos=servos))
    return found


def _described(fleet: Sequence[Preset]) -> str:
    """Return a text with one line on each known vehicle."""
    rows = (
        f"{one.name:<16} {one.thrusters} thrusters, {one.hull.mass:g} kg, "
        f"{' x '.join(f'{side:g}' for side in one.hull.sides)} m"
        for one in fleet
    )
    return "\n".join(rows)


def _file_of(choice: Choice) -> Path:
    """Return the path of the vehicle file that the user chose: an own file, or a bundled preset."""
    from hydro.io.files import bundled

    return Path(choice.file) if choice.file is not None else bundled("vehicles") / f"{choice.preset}.toml"


def _keep(path: Path, text: str) -> None:
    """Refuse to overwrite a file with another content than `text`, because it may have been edited.

    Raises:
        DataError: The file exists with another content.
    """
    if path.exists() and path.read_text(encoding="utf-8") != text:
        raise _other(path)


def _other(path: Path) -> DataError:
    """Return the error for an existing file whose content differs from the options."""
    return DataError(
        f"{path}: the file exists and differs from the options: leave the options out to use it, delete it, "
        "or choose another folder with -o"
    )


COMMANDS = {
    start: "hydro start datasets/logs/example.csv --vehicle datasets/logs/rov.toml -o study",
}
