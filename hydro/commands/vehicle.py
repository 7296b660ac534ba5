"""Commands `vehicle new` and `vehicle flip`: write a vehicle file, and reverse its thrusters."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.places import FILE, Output
from hydro.commands.shell import STREAM
from hydro.core.errors import DataError, UsageError, shown

if TYPE_CHECKING:
    from hydro.core.columns import Array
    from hydro.core.geometry.estimate import Estimate, Known
    from hydro.core.geometry.solid import Solid
    from hydro.core.vehicle.description import Thruster, Vector3

NAME = "vehicle"
HELP = "Make a vehicle file, or reverse its thrusters."
NEUTRAL = "neutral"
T200, VOLTAGE = "t200", 16.0
"""Name of the T200's thrust curve, and its default supply voltage [V]: four charged lithium cells."""
UNEVEN = 0.2
"""Minimum difference of buoyancy and weight for a warning, as a share of the weight."""

Shape = Literal["torpedo", "ellipsoid", "box"]
Layout = Literal["none", "single", "tunnel5", "vectored6", "vectored8", "bluerov2", "bluerov2_heavy"]
Curve = Literal["linear", "quadratic", "t200"]
Number = float | None
Text = str | None


@dataclass
class Asked:
    """Options of `vehicle new`, completed by the answers to questions so far; None for a missing answer.

    Attributes:
        name: Name of the vehicle.
        mass: Dry mass [kg].
        sides: Length, width, height of the hull [m].
        buoyancy: Text of the buoyant force [N], or `neutral`.
        metacentric_height: Height of the centre of buoyancy over that of gravity [m].
        thrusters: Texts with the numbers of one thruster each.
        layout: Name of a layout of thrusters.
        thrust: Greatest thrust of each thruster [N].
        curve: Name of the thrust curve.
    """

    name: str | None
    mass: float | None
    sides: list[float | None]
    buoyancy: str | None
    metacentric_height: float | None
    thrusters: list[str]
    layout: str | None
    thrust: float | None
    curve: str | None = None

    @property
    def needs_thrust(self) -> bool:
        """Whether the maximum thrust of a layout is required; the curve of the T200 contains it."""
        return not self.thrusters and self.layout != "none" and self.thrust is None and self.curve != T200

    def missing(self, mesh: bool) -> list[str]:
        """Return the names of the options that an estimate needs and that have no value yet.

        Args:
            mesh: Whether a mesh of the hull is given, which replaces the dimensions.
        """
        lacking = ["--mass"] if self.mass is None else []
        if not mesh:
            names = ("--length", "--width", "--height")
            lacking += [name for name, value in zip(names, self.sides, strict=True) if value is None]
        if not self.thrusters and self.layout is None:
            lacking.append("--thruster (or --layout with --thrust)")
        elif self.needs_thrust:
            lacking.append("--thrust")
        return lacking


def new(
    name: Annotated[Text, typer.Option(help="Name; default: that of the file.")] = None,
    mass: Annotated[Number, typer.Option(metavar="KG", help="Dry mass [kg].")] = None,
    length: Annotated[Number, typer.Option(metavar="M", help="Length of the hull's box [m].")] = None,
    width: Annotated[Number, typer.Option(metavar="M", help="Width of the hull's box [m].")] = None,
    height: Annotated[Number, typer.Option(metavar="M", help="Height of the hull's box [m].")] = None,
    mesh: Annotated[
        Path | None,
        typer.Option(
            metavar="OBJ",
            help="Hull as a closed mesh [m], instead of a box.",
        ),
    ] = None,
    shape: Annotated[Shape | None, typer.Option(help="Shape of the hull; default: by proportions.")] = None,
    fins: Annotated[
        bool, typer.Option("--fins/--no-fins", help="Tail fins of a torpedo.", rich_help_panel=ADVANCED)
    ] = True,
    thruster: Annotated[
        list[str] | None,
        typer.Option(
            metavar="X,Y,Z,DX,DY,DZ,MAX",
            help="Position [m], direction, largest thrust [N]; repeat.",
        ),
    ] = None,
    layout: Annotated[
        Layout | None,
        typer.Option(help="Usual layout, instead of --thruster."),
    ] = None,
    thrust: Annotated[
        Number, typer.Option(metavar="N", help="Largest thrust of each thruster of --layout [N].")
    ] = None,
    curve: Annotated[
        Curve | None,
        typer.Option(help="Thrust by command; t200: by its maker's table."),
    ] = None,
    voltage: Annotated[
        Number,
        typer.Option(
            metavar="V", help="Supply voltage of --curve t200 [V]; default: 16.", rich_help_panel=ADVANCED
        ),
    ] = None,
    time_constant: Annotated[
        Number,
        typer.Option(metavar="S", help="Lag of the thrusters [s]; default: 0.1.", rich_help_panel=ADVANCED),
    ] = None,
    buoyancy: Annotated[
        Text,
        typer.Option(
            metavar="N|neutral", help="Buoyant force [N]; default: neutral.", rich_help_panel=ADVANCED
        ),
    ] = None,
    metacentric_height: Annotated[
        Number,
        typer.Option(
            metavar="M",
            help="Height of the centre of buoyancy above that of gravity [m].",
            rich_help_panel=ADVANCED,
        ),
    ] = None,
    cg: Annotated[
        Text, typer.Option(metavar="X,Y,Z", help="Centre of gravity [m].", rich_help_panel=ADVANCED)
    ] = None,
    cb: Annotated[
        Text,
        typer.Option(metavar="X,Y,Z", help="Centre of buoyancy [m].", rich_help_panel=ADVANCED),
    ] = None,
    inertia: Annotated[
        Text,
        typer.Option(metavar="IX,IY,IZ", help="Moments of inertia [kg m^2].", rich_help_panel=ADVANCED),
    ] = None,
    water_density: Annotated[
        float, typer.Option(metavar="KG/M3", help="Water density [kg/m^3].", rich_help_panel=ADVANCED)
    ] = 1025.0,
    force: Annotated[bool, typer.Option("--force", help="Overwrite the file.")] = False,
    output: Annotated[
        Text,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Vehicle file; - is stdout.",
        ),
        FILE,
    ] = None,
) -> None:
    """Write a vehicle file from mass, dimensions and thrusters.

    Estimates inertia, added mass and damping from the hull's box or mesh. On a terminal, it asks for what is
    missing. Axes: x forward, y right, z down.

    Details:

    The estimates use Lamb's ellipsoids, boxes and plates of DNV-RP-C205, and streamlined bodies of Hoerner.
    Water forces have standard errors, so that fit and diagnose start from them; a comment in the file gives
    their source. The origin is the middle of the box, or the origin of the mesh (Wavefront OBJ). With the
    extra `mesh` (pip install 'deep-hydro-sim[mesh]') boundary elements give the added mass of a mesh.

    Give --thruster once for each thruster, in the order of the log's commands; an eighth number is the
    largest thrust astern, if it differs. Layouts: one propeller; that and four tunnels; four at 45 degrees
    and two or four vertical ones; none. bluerov2 and bluerov2_heavy have the numbers and directions of
    ArduSub's vectored frames.

    Defaults: a linear thrust curve, 5 % of the height between the centres of buoyancy and gravity, the centre
    of the box or the mesh as centre of buoyancy, and the inertia of a uniform body. --curve t200 is the
    maker's table of thrust by command and supply voltage, and needs no --thrust.
    """
    asked = Asked(
        *(name, mass, [length, width, height], buoyancy, metacentric_height, thruster or [], layout, thrust),
        curve,
    )
    from hydro.core.geometry.layouts import driven

    if asked.thrusters and asked.layout is not None:
        raise UsageError("--thruster and --layout: give one of them")
    if mesh is not None and any(value is not None for value in asked.sides):
        raise UsageError("--mesh has its own length, width and height: leave those options out")
    if voltage is not None and curve != T200:
        raise UsageError(f"--voltage: only --curve {T200} depends on it")
    place = _place(output, force)
    if lacking := asked.missing(mesh is not None):
        if not sys.stdin.isatty():
            raise UsageError(f"missing: {', '.join(lacking)} (or run on a terminal, to be asked)")
        place = _ask(asked, mesh is not None, place, force, chosen=output is not None)
    hull, radiated = _mesh(mesh, water_density) if mesh is not None else (None, None)
    known = _known(asked, hull, shape, fins, cg, cb, inertia, water_density, place)
    known = replace(known, thrusters=driven(known.thrusters, curve, time_constant))
    if curve == T200:
        known = replace(known, voltage=VOLTAGE if voltage is None else voltage)
    _write(known, hull, mesh, radiated, place)


def _place(output: str | None, force: bool) -> str:
    """Return the output file, `-` for stdout.

    Raises:
        UsageError: The file exists, and --force is not given.
    """
    place = STREAM if output is None else output
    if place != STREAM and not force and Path(place).exists():
        raise UsageError(f"{place}: the file exists already: choose another name or add --force")
    return place


def _ask(asked: Asked, mesh: bool, place: str, force: bool, *, chosen: bool) -> str:
    """Ask for all missing values, optional ones with their defaults, and return the output place."""
    typer.echo("Lengths in m, masses in kg, forces in N; x forward, y right, z down.", err=True)
    asked.name = asked.name or _prompt("Name of the vehicle", default="vehicle")
    asked.mass = asked.mass if asked.mass is not None else _prompt("Dry mass [kg]", above_0)
    for index, side in enumerate(("Length", "Width", "Height")):
        if not mesh and asked.sides[index] is None:
            asked.sides[index] = _prompt(f"{side} of the hull's box [m]", above_0)
    if asked.buoyancy is None:
        asked.buoyancy = _prompt("Buoyancy [N], or neutral", _buoyancy_text, NEUTRAL)
    if asked.metacentric_height is None:
        answer = _prompt("Centre of buoyancy over that of gravity [m], empty if unknown", _maybe, "")
        asked.metacentric_height = float(answer) if answer else None
    if not asked.thrusters and asked.layout is None:
        _ask_thrusters(asked)
    if asked.layout is not None and asked.needs_thrust:
        asked.thrust = _prompt("Greatest thrust of each [N]", above_0)
    if chosen:
        return place
    default = f"{''.join(c if c.isalnum() or c in '-_' else '-' for c in asked.name)}.toml"
    return str(_prompt("Write to", lambda text: _place(text, force), default))


def _ask_thrusters(asked: Asked) -> None:
    """Ask for the name of a layout, or for the numbers of each thruster."""
    from hydro.core.geometry.layouts import LAYOUTS, parsed

    def layout(text: str) -> str:
        if text not in (*LAYOUTS, "own"):
            raise UsageError(f"one of {', '.join(LAYOUTS)}, own")
        return text

    chosen = _prompt(f"Thrusters: {', '.join(LAYOUTS)}, or own", layout, "vectored6")
    if chosen != "own":
        asked.layout = chosen
        return

    def one(text: str) -> str:
        if text:
            parsed([text])
        return text

    while answer := _prompt(
        f"Thruster {len(asked.thrusters) + 1}: x,y,z,dx,dy,dz,max, empty to end", one, ""
    ):
        asked.thrusters.append(answer)
    asked.layout = None if asked.thrusters else "none"


def _prompt(question: str, check: Callable[[str], Any] = str, default: str | None = None) -> Any:
    """Return the answer to a question on stderr, which is repeated until the answer is valid."""

    def checked(text: str) -> Any:
        try:
            return check(text.strip())
        except (DataError, UsageError) as error:
            raise typer.BadParameter(str(error)) from None

    return typer.prompt(question, default=default, value_proc=checked, err=True, show_default=bool(default))


def above_0(text: str) -> float:
    """Return the positive, finite number that a text contains.

    Raises:
        UsageError: The text is not such a number.
    """
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise UsageError(f"a number above 0 is expected, not {text!r}")
    return value


def _maybe(text: str) -> str:
    """Return the text of a height, after a check, or an empty text."""
    from hydro.core.geometry.layouts import numbers_of

    if text:
        numbers_of(text, "height", (1,), "a height")
    return text


def _buoyancy_text(text: str) -> str:
    """Return the text of a positive number or `neutral`, after a check."""
    if text != NEUTRAL:
        above_0(text)
    return text


def _known(
    asked: Asked,
    hull: Solid | None,
    shape: Shape | None,
    fins: bool,
    cg: str | None,
    cb: str | None,
    inertia: str | None,
    density: float,
    place: str,
) -> Known:
    """Return all given values of a vehicle, checked, for the estimate of the others.

    Raises:
        DataError: A number or a thruster is invalid.
    """
    from hydro.core.geometry.estimate import Known
    from hydro.core.vehicle.names import usable_name

    force = None
    if asked.buoyancy not in (None, NEUTRAL):
        try:
            force = float(asked.buoyancy or "")
        except ValueError:
            raise UsageError(f"--buoyancy {asked.buoyancy!r}: give a force in N, or {NEUTRAL}") from None
    length, width, height = (float(side or 0.0) for side in (asked.sides if hull is None else hull.sides))
    stem = "vehicle" if place == STREAM else Path(place).stem
    return Known(
        name=asked.name or usable_name(stem),
        mass=float(asked.mass or 0.0),
        sides=(length, width, height),
        thrusters=_thrusters(asked, (length, width, height), hull),
        buoyancy=force,
        gravity_center=_triple("--cg", cg),
        buoyancy_center=_triple("--cb", cb),
        metacentric_height=asked.metacentric_height,
        inertia=_triple("--inertia", inertia),
        shape=shape,
        fins=fins,
        density=density,
    )


def _triple(option: str, text: str | None) -> Vector3 | None:
    """Return the three numbers of an option; None if it was not given."""
    from hydro.core.geometry.layouts import numbers_of

    if text is None:
        return None
    x, y, z = numbers_of(text, option, (3,), "x,y,z")
    return x, y, z


def _thrusters(asked: Asked, sides: Vector3, hull: Solid | None) -> tuple[Thruster, ...]:
    """Return the thrusters from their numbers or from a layout."""
    from hydro.core.geometry.layouts import laid_out, parsed

    if asked.thrusters:
        return parsed(asked.thrusters)
    middle = (0.0, 0.0, 0.0) if hull is None else tuple(hull.middle)
    thrust = asked.thrust or (1.0 if asked.curve == T200 else 0.0)  # the curve replaces it
    return laid_out(asked.layout or "none", thrust, sides, middle)  # type: ignore[arg-type]


def _mesh(path: Path, density: float) -> tuple[Solid, Array | None]:
    """Return the solid of a mesh, and its added mass if Capytaine is installed and the mesh not too fine."""
    from hydro.core.geometry.solid import MOST_FACES, radiated_added_mass, solid, solvable
    from hydro.io.mesh import read_obj

    vertices, faces = read_obj(path)
    try:
        hull = solid(vertices, faces)
    except DataError as error:
        raise DataError(f"{path}: {error}") from error
    reason = ""
    if not solvable():
        reason = "Capytaine is not installed (pip install 'deep-hydro-sim[mesh]')"
    elif len(faces) > MOST_FACES:
        reason = f"the mesh has {len(faces):,} faces, above {MOST_FACES:,} (simplify it)"
    if reason:
        typer.echo(f"hydro: {path}: added mass is that of an equivalent ellipsoid: {reason}", err=True)
        return hull, None
    return hull, radiated_added_mass(vertices, faces, density)


def _write(known: Known, hull: Solid | None, mesh: Path | None, radiated: Array | None, place: str) -> None:
    """Estimate, check and write the vehicle."""
    from hydro.core.geometry.estimate import estimate
    from hydro.io import new_vehicle, vehicle

    beside = None
    if mesh is not None:
        folder = Path.cwd() if place == STREAM else Path(place).absolute().parent
        beside = Path(os.path.relpath(mesh, folder)).as_posix()
        if not beside.isprintable():
            raise DataError(f"{shown(beside)}: a vehicle file cannot name this path: rename the mesh")
    found = estimate(known, hull, beside, radiated)
    text = new_vehicle.text(found)
    vehicle.parse(text, shown(known.name))
    if place == STREAM:
        typer.echo(text, nl=False)
    else:
        vehicle.write(text, place)
    _tell(found, place)


def _tell(found: Estimate, place: str) -> None:
    """Print a summary of the vehicle and warnings on stderr."""
    from hydro.core.effects.catalogue import implausible

    known = found.vehicle
    if place != STREAM:
        count, shape = len(known.thruster), found.form.shape
        article = "an" if shape[0] in "aeiou" else "a"
        by = f"{count} thruster{'s' * (count != 1)}, a hull like {article} {shape}"
        typer.echo(f"hydro: {place}: {by}, full to {found.form.fullness:.0%} of its box", err=True)
    weight = known.rigid_body.mass * known.environment.gravity
    if abs(known.buoyancy.force - weight) > UNEVEN * weight:
        typer.echo(
            f"hydro: buoyancy {known.buoyancy.force:.4g} N is far from the weight {weight:.4g} N: "
            "is it the dry mass?",
            err=True,
        )
    for words in implausible(known):
        typer.echo(f"hydro: {words}", err=True)


def flip(
    vehicle: Annotated[
        str,
        typer.Argument(metavar="VEHICLE", show_default=False, help="Vehicle file; nothing or - is stdin."),
    ] = STREAM,
    thruster: Annotated[
        list[str] | None,
        typer.Option(
            metavar="N[,N...]", show_default=False, help="Numbers of the thrusters, from 1. May be repeated."
        ),
    ] = None,
    output: Output = STREAM,
) -> None:
    """Reverse the direction of thrusters in a vehicle file.

    Comments and all other values stay. The thrust curve stays, too: a positive command gives max_thrust, now
    in the opposite direction. hydro check VEHICLE LOG says which thrusters push opposite to the file.

        hydro check vehicle.toml raw.parquet
        hydro vehicle flip vehicle.toml --thruster 1,2,5 -o flipped.toml
    """
    from hydro.io import toml
    from hydro.io import vehicle as vehicles

    numbers = _numbers(thruster)
    if vehicle == STREAM:
        if sys.stdin.isatty():
            raise UsageError("stdin is a terminal: name a vehicle file, or pipe one in")
        text, name = sys.stdin.read(), "stdin"
    else:
        text, name = toml.read(vehicle), vehicle
    flipped = vehicles.flip_thrusters(text, numbers, name)
    if output == STREAM:
        typer.echo(flipped, nl=False)
    else:
        vehicles.write(flipped, output)


def _numbers(texts: list[str] | None) -> list[int]:
    """Return the numbers of thrusters from texts such as `1,2`.

    Raises:
        UsageError: There are no numbers, or a text is not a number.
    """
    parts = [part.strip() for text in texts or () for part in text.split(",")]
    if not parts or not all(part.isdecimal() for part in parts):
        raise UsageError("--thruster: give the numbers of the thrusters to reverse, as in --thruster 1,2")
    return [int(part) for part in parts]


COMMANDS = {
    new: "hydro vehicle new --mass 11.5 --length 0.46 --width 0.34 --height 0.25 "
    "--layout vectored6 --thrust 40 -o rov.toml",
    flip: "hydro vehicle flip datasets/vehicles/bluerov2_heavy.toml --thruster 1,2 -o flipped.toml",
}
