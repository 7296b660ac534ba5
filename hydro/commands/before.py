"""Options for a recording from before a change, and the hull-force model that is fitted to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

import typer

from hydro.commands.help import ADVANCED
from hydro.commands.recordings import Logs, called
from hydro.commands.shell import about, dataset_name, network, progress, report
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
        help="Search laws of sparse terms where no effect explains the error.",
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
    """Hull-force model from a recording before a change, with the origin of its data.

    Attributes:
        hull: Hull-force model.
        inputs: Recording from before the change, and the network file if a network is the model.
        parameters: Entry for the footers of tables that are made with the model, see `report.change`.
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
    """Return a hull-force model fitted to the recording of --before, or the network of --model.

    Args:
        before: Paths of the recording from before the change.
        model: Path of the network.
        vehicle: Vehicle file.
        source: Recording after the change.
        logs: Settings for reading the recording.
        discover: Whether --discover was given, which works only without --before.

    Returns:
        The model with its inputs; None without --before.

    Raises:
        DataError: Both recordings are the same, or the first does not fit the vehicle or is too short; or the
            network does not fit the vehicle file.
        UsageError: --model is given without --before, or --discover with it.
    """
    from hydro.core.diagnosis.pipeline import hull_of
    from hydro.core.residual.learnt import Learnt
    from hydro.report.change import parameters_of

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
    with about(name), progress("hull force before the change"):
        hull = hull_of(vehicle, earlier.frame, law)
    return Earlier(hull, tuple(inputs), parameters_of(told, hull))


def _learnt_from(trained: Artefact, recording: Artefact) -> bool:
    """Return whether a network was trained on a recording."""
    from hydro.io.provenance import lineage

    content = recording.provenance.content
    return any(node.content == content for _, node in lineage(trained.provenance))
