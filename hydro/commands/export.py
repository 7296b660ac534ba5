"""Command `export`: files for other programs, and the effects that these programs cannot represent."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Annotated

import typer

from hydro.commands.places import Output
from hydro.commands.recordings import MaxExpanded
from hydro.commands.shell import STREAM, about, message, read, refuse_terminal
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from hydro.core.vehicle.description import Vehicle
    from hydro.export.targets import Target
    from hydro.io.model import Model
    from hydro.rl.training.policy import Policy

VEHICLE_SUFFIX = ".toml"


def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            show_default=False,
            help="Vehicle file, model or policy; - is stdin.",
        ),
    ] = STREAM,
    to: Annotated[
        str | None,
        typer.Option(metavar="TARGET", show_default=False, help="Target; default: by the suffix of -o."),
    ] = None,
    on: Annotated[
        str | None,
        typer.Option(
            "--on",
            metavar="RAW",
            help="Recording for the errors; default: manoeuvres.",
        ),
    ] = None,
    cost: Annotated[
        bool, typer.Option("--cost/--no-cost", help="Compute the errors from effects that are left out.")
    ] = True,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Export a vehicle file, a network or a policy to other programs.

        target  takes    writes
        python  vehicle  .py      a class without dependencies, as Fossen's
        casadi  vehicle  .casadi  f(x, u), Jacobians, a step (extra casadi)
        mujoco  vehicle  .xml     MJCF, for hydro.load_student(path)
        gz      vehicle  .sdf     a Gazebo world (SDF 1.11) with water
        onnx    model    .onnx    a residual model or a policy (extra onnx)

    Effects that a target cannot hold are listed on stderr, each with the error that this makes in predictions
    5 s ahead.

        hydro export vehicle.toml --to casadi -o vehicle.casadi

    Details:

    The error is the root mean square of the velocity, axes weighted by inertia; the error of the vehicle file
    itself is shown as well.

    A model's graph takes states (N, 12), u v w p q r and their rates in the body frame (forward, right,
    down), and gives tau_res (N, 6) in N and N m; features and scalers are part of it. The vehicle feels
    -tau_res. A temporal model also takes past (N, 42), the velocities of the seven control steps before,
    newest first, which the caller keeps. A policy's graph (policy.parquet of a training) takes observations
    (N, 36) in SI units and gives actions (N, 6) in [-1, 1].
    """
    from hydro.export.targets import choose
    from hydro.io import vehicle as vehicles
    from hydro.io.files import write_bytes

    is_vehicle = source.endswith(VEHICLE_SUFFIX)
    target = choose(to, "vehicle" if is_vehicle else "model", output)
    if not target.text:
        refuse_terminal(output)
    if not is_vehicle and on is not None:
        raise UsageError("--on: nothing is left out of a network; leave the option out")
    if is_vehicle:
        known, _ = vehicles.read(source)
        with about(source):
            content = target.write(known)
        for line in target.warnings(known):
            message(f"hydro: {line}")
        _tell_left_out(target, source, known, on, cost)
    else:
        content = target.write(_trained(source))
    write_bytes(content, sys.stdout.buffer if output == STREAM else output)


def _trained(source: str) -> Model | Policy:
    """Read a residual network or a policy.

    Raises:
        DataError: The table is neither, or its footer does not describe it.
    """
    from hydro.io.model import from_artefact

    artefact = read(source, "model", "policy")
    with about(source):
        if artefact.kind == "model":
            return from_artefact(artefact)
        from hydro.rl.training.runs import policy_of

        return policy_of(artefact)


def _tell_left_out(target: Target, source: str, vehicle: Vehicle, on: str | None, cost: bool) -> None:
    """Print on stderr the effects that a target cannot represent, with the resulting errors."""
    from hydro.commands.tables import person, print_table
    from hydro.export.cost import of_lacks

    lacks = target.lacks(vehicle)
    if not lacks:
        message(f"hydro: {source}: {target.name} holds all that the file says")
        return
    if not cost:
        for lack in lacks:
            message(f"hydro: {source}: left out: {lack.what}: {lack.why}")
        return
    raw = None if on is None else read(on, "raw").frame
    with about(source if on is None else on):
        table = of_lacks(vehicle, lacks, raw)
    print_table(table, f"Left out by {target.name}", person(aside=True))


COMMANDS = {
    export: "hydro export datasets/stonefish/vehicle.toml --to python -o auv.py",
}
