"""The options of a recording before a change, and the hull-force model that is fitted to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.recordings import Logs, called
from hydro.commands.shell import about, dataset_name, network, report
from hydro.core.errors import DataError, UsageError

if TYPE_CHECKING:
    from hydro.core.residual.hull import Hull
    from hydro.core.vehicle.description import Vehicle
    from hydro.io.table import Artefact

Before = Annotated[
    list[str] | None,
    typer.Option(
        "--before",
        metavar="RAW",
        show_default=False,
        help="Recording before a change; may be repeated.",
    ),
]
Discover = Annotated[
    bool,
    typer.Option(
        "--discover",
        help="Fit a formula where no effect explains the error.",
        rich_help_panel=ADVANCED,
    ),
]
Network = Annotated[
    str | None,
    typer.Option(
        "--model",
        metavar="MODEL",
        show_default=False,
        help="With --before: network as the hull-force model.",
        rich_help_panel=ADVANCED,
    ),
]

ASIDE = "name another recording of the unchanged vehicle"


@dataclass(frozen=True)
class Earlier:
    """What a recording from before has taught.

    Attributes:
        hull: What the hull does beside the file.
        inputs: The recording, and the network where one is asked.
        parameters: What a table that rests on it says in its footer, see `report.change`.
    """

    hull: Hull
    inputs: tuple[Artefact, ...]
    parameters: dict[str, Any]


def learnt(
    before: list[str] | None,
    model: str | None,
    vehicle: Vehicle,
    source: Artefact,
    logs: Logs,
    *,
    discover: bool = False,
) -> Earlier | None:
    """Learn a hull from --before, or ask --model for it; None without a recording before.

    Args:
        before: Where the recording is.
        model: Where the network is.
        vehicle: The file that the hull's model stands beside.
        source: The recording after.
        logs: How the recording is read.
        discover: Whether --discover was asked for, which is for one recording.

    Raises:
        DataError: It is the recording after itself, does not fit the vehicle or is too short; or the network
            cannot stand beside the file.
        UsageError: There is a network alone, or something to discover beside a hull whose law is known.
    """
    from hydro.core.diagnosis.diagnose import hull_of
    from hydro.core.residual.learnt import Learnt

    if not before:
        if model is not None:
            raise UsageError("--model needs --before, which says how much the network leaves unexplained")
        return None
    if discover:
        raise UsageError("--discover is for one recording: leave out --before, whose hull has a law already")
    earlier, name = logs.read(before), called(before)
    if earlier.provenance.content == source.provenance.content:
        raise DataError(f"{name}: the same rows as the measured recording; a change needs two")
    told: dict[str, Any] = {"recording": dataset_name(name)}
    inputs, law = [earlier], None
    if model is not None:
        artefact, trained = network(model)
        with about(model):
            law = Learnt.of(trained, vehicle)
        told |= {"network": dataset_name(model), "learnt": _learnt_from(artefact, earlier)}
        if told["learnt"]:
            report(model, f"was trained on {name}, so that its error there is too small: {ASIDE}")
        inputs.append(artefact)
    with about(name):
        hull = hull_of(vehicle, earlier.frame, law)
    figures = {"given": float(f"{hull.given:.4g}"), "left": float(f"{hull.left:.4g}")}
    return Earlier(hull, tuple(inputs), {"before": told | figures})


def _learnt_from(trained: Artefact, recording: Artefact) -> bool:
    """Whether a network was trained on a recording."""
    from hydro.io.provenance import lineage

    content = recording.provenance.content
    return any(node.content == content for _, node in lineage(trained.provenance))
