"""Commands `labels`, `split` and `features`: training data of networks from a recording."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from hydro.commands.engines import HERE, Address, EngineName, Threads, engine_for, refuse_engine
from hydro.commands.help import ADVANCED
from hydro.commands.places import FILE, Output, SessionsOutput
from hydro.commands.recordings import (
    Definitions,
    Logs,
    MapFile,
    MaxExpanded,
    Measured,
    called,
    dataset,
    tell_strangers,
)
from hydro.commands.shell import (
    STREAM,
    NoiseSpec,
    VehicleFile,
    about,
    left_out,
    noise_for,
    progress,
    read,
    refuse_terminal,
    report,
    report_gaps,
    tell_voltage,
    vehicle_for,
    vehicle_or,
    write,
)
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from hydro.study.engine import Engine

MOST_ROWS = 1_000_000_000
"""Largest number of rows of a block: 230 days at 50 Hz, more than any session has."""

Labels = Annotated[
    str, typer.Argument(metavar="LABELS", show_default=False, help="Labels table; nothing or - is stdin.")
]
LabelsOrSplit = Annotated[
    str,
    typer.Argument(
        metavar="LABELS", show_default=False, help="Labels or split table; nothing or - is stdin."
    ),
]
MaxVelocity = Annotated[
    float,
    typer.Option(
        metavar="SD",
        min=0.0,
        help="With nulls: largest 1-sigma of a velocity.",
        rich_help_panel=ADVANCED,
    ),
]
MaxAcceleration = Annotated[
    float,
    typer.Option(
        metavar="SD",
        min=0.0,
        help="With nulls: largest 1-sigma of an acceleration.",
        rich_help_panel=ADVANCED,
    ),
]


def labels(
    raw: Measured = None,
    acceleration: Annotated[
        Literal["rts", "kalman", "kalman-difference"],
        typer.Option(help="Smoother, filter, or differences of filtered velocity."),
    ] = "rts",
    noise: NoiseSpec = None,
    subtract: Annotated[
        Literal["inertia", "effects"],
        typer.Option(help="Subtract only added mass, or all effects of the file."),
    ] = "inertia",
    max_sd_velocity: MaxVelocity = 0.05,
    max_sd_acceleration: MaxAcceleration = 0.25,
    vehicle: VehicleFile = None,
    map_: MapFile = None,
    msg: Definitions = None,
    max_expanded: MaxExpanded = None,
    engine: EngineName = HERE,
    address: Address = None,
    threads: Threads = 1,
    output: SessionsOutput = STREAM,
) -> None:
    """Compute the force that the known physics does not explain.

    Smooths velocities, estimates accelerations and adds the residual wrench tau_res = tau_prop - M nu_dot - g
    to the raw columns. The vehicle feels -tau_res. Of a folder of sessions (session=NAME/part.parquet),
    labels are another such folder.

        hydro labels dives -o labels
        hydro labels dives -o labels --engine ray --address 10.0.0.1:6379

    Details:

    With --subtract effects and a complete vehicle file the residual wrench is C_RB(nu) nu. Gaps in time are
    one line on stderr; no filter acts across a gap.

    For a recording with nulls a smoother of pose and velocity fuses the samples, and every value has a
    standard deviation. A row has a label if attitude (to 0.05 rad), velocity and acceleration are determined
    to the bounds [m/s, rad/s; m/s^2, rad/s^2]. One line on stderr says how many rows have no label, and why.

    Sessions of a folder are processed one by one, so memory is needed for one session. The noise of the
    filter is estimated once from all of them. With --engine ray the nodes of a Ray cluster share the
    sessions; the results are the same bytes.
    """
    from hydro.core.distillation.labels_of_samples import Bounds
    from hydro.study.labelling import Labelling, label

    limits = Bounds(max_sd_velocity, max_sd_acceleration)
    how: dict[str, Any] = {"acceleration": acceleration, "subtract": subtract, "limits": limits}
    if noise is not None:
        given = noise_for(noise)
        how["noise"] = (*[given.velocity] * 3, *[given.rate] * 3)
    if (folder := dataset(raw)) is not None:
        _labels_of_sessions(folder, vehicle, how, output, engine_for(engine, address, threads))
        return
    refuse_engine(engine, "labels are shared out by sessions: give a folder of them")
    refuse_terminal(output)
    name, source = called(raw), Logs(map_, msg, vehicle).read(raw)
    known, text = vehicle_for(source, vehicle)
    tell_voltage(known, source.frame)
    with about(name):
        made, notes = label(source, Labelling(text, **how))
    for words in notes:
        report(name, words)
    write(made, output)


def _labels_of_sessions(
    folder: str,
    vehicle: Path | None,
    how: dict[str, Any],
    output: str,
    where: AbstractContextManager[Engine],
) -> None:
    """Write the labels of a data set, session by session."""
    from hydro.io import partitions
    from hydro.study.labelling import Labelling, label_part, shared, warm

    if output == STREAM:
        raise UsageError(f"the labels of {folder} are a folder, too: add -o FOLDER")
    data = partitions.opened(folder, ("raw",))
    _, text = vehicle_or(None if vehicle else data.vehicle, data.kind, vehicle)
    labelling = shared(data, Labelling(text, **how))
    tasks = [(part, Path(output), labelling) for part in data.parts]
    with where as engine, progress("labels") as update:
        engine.prepare(partial(warm, data.parts[0], labelling))
        done = engine.each(label_part, tasks)
        for number, (part, labelled) in enumerate(zip(data.parts, done, strict=True)):
            update(number + 1, len(data.parts), part.session)
            for words in labelled.notes:
                report(str(part.path), words)
    tell_strangers(output, (part.session for part in data.parts))


def split(
    labels: Labels = STREAM,
    block: Annotated[
        int, typer.Option(min=1, max=MOST_ROWS, help="Rows of a block; a session's last has more.")
    ] = 150,
    test: Annotated[float, typer.Option(min=0.0, max=1.0, help="Share of blocks that are test data.")] = 0.2,
    salt: Annotated[str, typer.Option(help="Text mixed into the hashes: another salt, another split.")] = "",
    blocks: Annotated[
        str | None,
        typer.Option(metavar="FILE", help="Also write the small table of blocks and their parts."),
        FILE,
    ] = None,
    from_: Annotated[
        str | None,
        typer.Option("--from", metavar="FILE", help="Repeat the split of this table of blocks."),
    ] = None,
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Split labels into training and test blocks by a content hash.

    The same data give the same split on any machine and in any order, and new sessions never move an old
    block. Rows within the smoother's reach of a block of the other side are marked guard and used by neither.
    """
    from hydro.core.distillation.split import split as divide
    from hydro.core.distillation.split import split_from
    from hydro.io import table
    from hydro.io.provenance import parameters_of

    refuse_terminal(output)
    inputs = [source := read(labels, "labels")]
    parameters: dict[str, Any] = {"block": block, "test": test, "salt": salt}
    with about(labels):
        if from_ is None:
            frame, made = divide(source.frame, **parameters)
        else:
            inputs.append(given := read(from_, "blocks"))
            parameters |= parameters_of(given.provenance, "split")
            frame, made = split_from(
                source.frame, given.frame, block=parameters["block"], salt=parameters["salt"]
            )
        report_gaps(labels, source.frame)
        report(labels, left_out(source.frame))
    if blocks is not None:
        write(table.make("blocks", made, stage="split", parameters=parameters, inputs=inputs), blocks)
    write(table.make("split", frame, stage="split", parameters=parameters, inputs=inputs), output)


def features(
    labels: LabelsOrSplit = STREAM,
    set_: Annotated[
        Literal["raw", "physfeat"],
        typer.Option("--set", help="Only the twelve states, or 45 features with drag and cross products."),
    ] = "physfeat",
    max_expanded: MaxExpanded = None,
    output: Output = STREAM,
) -> None:
    """Compute the inputs and targets of a residual network.

    Use it to inspect the inputs of a network, or to train one in another program; `hydro train` computes them
    itself.
    """
    from hydro.core.distillation.features import table as compute
    from hydro.io import table

    refuse_terminal(output)
    source = read(labels, "labels", "split")
    with about(labels):
        frame = compute(source.frame, set_)
        report(labels, left_out(source.frame))
    write(table.make("features", frame, stage="features", parameters={"set": set_}, inputs=[source]), output)


COMMANDS = {
    labels: "hydro labels datasets/stonefish/sample.parquet -o labels.parquet",
    split: "hydro labels datasets/stonefish/sample.parquet | hydro split -o split.parquet",
    features: "hydro labels datasets/stonefish/sample.parquet | hydro features -o features.parquet",
}
