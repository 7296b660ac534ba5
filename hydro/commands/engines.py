"""Option `--engine`: run the work of a command in this process, or on the nodes of a Ray cluster."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from hydro.commands.help import CLUSTER
from hydro.commands.shell import here, message
from hydro.core.errors import UsageError

if TYPE_CHECKING:
    from hydro.study.engine import Engine
    from hydro.study.steps import Runner, Step

HERE: Literal["here"] = "here"
EngineName = Annotated[
    Literal["here", "ray"],
    typer.Option(
        show_default=False, help="This process (default), or a Ray cluster.", rich_help_panel=CLUSTER
    ),
]
Address = Annotated[
    str | None,
    typer.Option(
        metavar="HOST:PORT",
        show_default=False,
        help="Head of the cluster; default: RAY_ADDRESS.",
        rich_help_panel=CLUSTER,
    ),
]
Threads = Annotated[
    int,
    typer.Option(min=1, show_default=False, help="Processors of each task.", rich_help_panel=CLUSTER),
]


def engine_for(
    name: str,
    address: str | None,
    threads: int,
    execute: Callable[[Step], None] | None = None,
) -> AbstractContextManager[Engine]:
    """Return the engine that runs the tasks of a command, for use in a `with` block.

    Args:
        name: `here` (this process) or `ray` (a cluster).
        address: Address of the cluster.
        threads: Number of processors of each task on the cluster.
        execute: Function that runs steps of a study in this process; by default each step runs in its own
            process.

    Raises:
        UsageError: Ray is not installed, no cluster answers at the address, or an address is given without
            `ray`.
    """
    if name == HERE:
        from hydro.study.engine import Here
        from hydro.study.steps import apart

        if address is not None:
            raise UsageError(f"--address {address}: is of a Ray cluster: add --engine ray")
        return nullcontext(Here(execute or apart))
    from hydro.study.cluster import Cluster

    return Cluster(address, threads)


@contextmanager
def runner(
    context: typer.Context, folder: Path, workers: int, name: str, address: str | None, threads: int
) -> Iterator[tuple[Runner, int]]:
    """Yield, for a `with` block, the runner of a study's steps and how many steps may run at the same time.

    A step is one command of hydro.  Without a cluster, one step runs in this process, or several run in
    parallel in their own processes.  A cluster runs as many steps as it has free processors.

    Args:
        context: Context of the command, whose root group runs steps in this process.
        folder: Folder of the study, in which the runner records the finished steps.
        workers: Number of steps at the same time without a cluster.
        name: `here` (this machine) or `ray` (a cluster).
        address: Address of the cluster.
        threads: Number of processors of each task on the cluster.
    """
    from hydro.study.steps import Runner, apart

    execute = here(context.find_root().command) if workers == 1 else apart
    with engine_for(name, address, threads, execute) as engine:
        engine.prepare()
        yield Runner(folder, engine.execute, message), workers if name == HERE else engine.slots


def refuse_engine(name: str, why: str) -> None:
    """Raise an error if a cluster is requested for work that cannot be divided.

    Args:
        name: Value of --engine, `here` or `ray`.
        why: Reason, for the message.

    Raises:
        UsageError: A cluster is requested.
    """
    if name != HERE:
        raise UsageError(f"--engine {name}: {why}")
