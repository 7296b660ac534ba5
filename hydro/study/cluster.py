"""Tasks on a Ray cluster: the same functions and command lines, on whichever node has room.

Every node has the same hydro and sees the files under the same paths.  A task reads a file and writes a file,
whole or not at all; so one whose node has gone is simply run again elsewhere.  Nodes compile their kernels
before any work is given out: of several workers that begin at once each would compile them for itself.
"""

from __future__ import annotations

import contextlib
import os
import platform
import socket
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from hydro.core import threads
from hydro.core.errors import DataError, HydroError, UsageError
from hydro.study.steps import Step, StepFailed, captured

Result = TypeVar("Result")
RETRIES = 4
"""Times that a task is run again whose worker or node has gone."""
PATIENCE = 5.0
"""Seconds that an address has to take a connection, and to answer as Ray does."""
_SETTINGS = b"\x04"
_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + _SETTINGS + bytes(5)
"""What a client of gRPC, which Ray speaks, says first; its server answers with settings of its own."""


class Cluster:
    """A Ray cluster, as long as a `with` block holds it."""

    def __init__(self, address: str | None = None, processors: int = 1) -> None:
        """Connect to a cluster, or start one of this machine.

        Args:
            address: `HOST:PORT` of its head, or `ray://HOST:PORT`; without one that of RAY_ADDRESS, of a
                cluster that runs on this machine, or a new one that ends with the block.
            processors: Processors, and so threads, of each task.

        Raises:
            UsageError: Ray is not installed, or nothing answers as Ray does at the address, or no node has
                so many processors.
        """
        ray = _imported()
        if address is not None:
            _require_answer(address)
        self._ray, self._processors, self._home = ray, processors, str(Path.cwd())
        variables = {threads.VARIABLE: str(processors), "OMP_NUM_THREADS": str(processors)}
        variables |= {"OPENBLAS_NUM_THREADS": "1", "POLARS_MAX_THREADS": str(processors)}
        try:
            ray.init(
                address=address,
                log_to_driver=False,
                logging_level="ERROR",
                include_dashboard=None if address else False,
                runtime_env={"env_vars": variables},
            )
        except (ConnectionError, ImportError, RuntimeError, ValueError) as error:
            reason = str(error).strip().partition("\n")[0]
            asked = (
                "" if os.environ.get("RAY_AUTH_MODE") else "; if it asks for a token, set RAY_AUTH_MODE=token"
            )
            raise UsageError(f"no Ray cluster at {address or 'this machine'}: {reason}{asked}") from error
        self._run = ray.remote(num_cpus=processors, max_retries=RETRIES)(_run)
        self.slots = sum(room for _, _, room in self._nodes())
        if not self.slots:
            self.close()
            raise UsageError(
                f"no node of the cluster has {processors} processors: ask for fewer with --threads"
            )

    def __enter__(self) -> Cluster:
        """The cluster itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Let go of it."""
        self.close()

    def close(self) -> None:
        """Disconnect; a cluster that was started for this process ends."""
        self._ray.shutdown()

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """See `study.engine.Engine.each`.

        Raises:
            HydroError: What the first task that failed said.
            DataError: A node does not see this folder, or nodes went too often.
        """
        for one in self._begun(task, arguments):
            yield self._result(one)

    def as_they_end(
        self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Result]:
        """The same results, each as soon as it is there."""
        waiting = self._begun(task, arguments)
        while waiting:
            ended, waiting = self._ray.wait(waiting)
            yield from map(self._result, ended)

    def _begun(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """References to results that are still to come.

        What nobody waits for any more ends as this process disconnects.  It is not cancelled before: Ray 2.60
        ends the process where a task that is cancelled completes meanwhile.
        """
        return [self._run.remote(self._home, task, each) for each in arguments]

    def execute(self, step: Step) -> None:
        """Run a step of a study on a node, in a process of its own.

        Raises:
            StepFailed: It failed, and has said why.
        """
        code, out, err = self._result(self._run.remote(self._home, captured, (step,)))
        sys.stdout.write(out)
        sys.stderr.write(err)
        if code:
            raise StepFailed(step, code)

    def _nodes(self) -> list[tuple[str, str, int]]:
        """Identity, address and room for tasks of each node that is alive and has any."""
        found = [
            (
                node["NodeID"],
                node["NodeManagerAddress"],
                int(node["Resources"].get("CPU", 0)) // self._processors,
            )
            for node in self._ray.nodes()
            if node["Alive"]
        ]
        return [node for node in found if node[2]]

    def prepare(self, warm: Callable[[], object] | None = None) -> None:
        """Let every node do something once, and refuse one that has another hydro or Python.

        Raises:
            DataError: A node has another version, or does not see this folder.
        """
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy as On

        nodes = self._nodes()
        begun = [
            self._run.options(scheduling_strategy=On(node, soft=True)).remote(self._home, _prepared, (warm,))
            for node, _, _ in nodes
        ]
        here = _versions()
        for (_, address, _), one in zip(nodes, begun, strict=True):
            there = self._result(one)
            if there != here:
                raise DataError(f"node {address} has {there}, here is {here}: install the same there")

    def _result(self, reference: Any) -> Any:
        """What a task returned.

        Raises:
            HydroError: What it raised.
            DataError: Nodes went too often, or have no hydro.
        """
        errors = self._ray.exceptions
        try:
            return self._ray.get(reference)
        except errors.RayTaskError as error:
            if isinstance(error.cause, HydroError):
                raise error.cause from None
            if isinstance(error.cause, ModuleNotFoundError):
                raise DataError(
                    f"a node cannot run hydro ({error.cause}): install it on every node"
                ) from error
            raise (error.cause if isinstance(error.cause, Exception) else error) from None
        except errors.RayError as error:
            reason = str(error).strip().partition("\n")[0]
            raise DataError(
                f"a task was lost {RETRIES + 1} times with its worker or node ({reason}): see the memory and "
                "the logs of the nodes"
            ) from error


def _run(home: str, task: Callable[..., Result], arguments: tuple[Any, ...]) -> Result:
    """On a node: a task in the folder that the command was called in, whose relative paths it is given."""
    try:
        os.chdir(home)
    except OSError as error:
        raise DataError(
            f"node {socket.gethostname()} does not see {home} ({error.strerror}): give all nodes one file "
            "system, with the same paths"
        ) from error
    return task(*arguments)


def _prepared(warm: Callable[[], object] | None) -> str:
    """On a node: prepare it; its versions."""
    if warm is not None:
        warm()
    return _versions()


def _versions() -> str:
    """Of what all nodes must share."""
    from hydro.io.provenance import package_version

    return f"hydro {package_version()} on Python {'.'.join(platform.python_version_tuple()[:2])}"


def _imported() -> Any:
    """Ray, told to stay quiet."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError:
        raise UsageError("--engine ray needs Ray: pip install 'deep-hydro-sim[ray]'") from None
    return ray


def _require_answer(address: str) -> None:
    """Refuse an address at which there is no Ray: by itself it would wait for one for ever.

    Raises:
        UsageError: The address is none, or nothing answers there as Ray does.
    """
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise UsageError(
            f"--address {address!r:.80}: give HOST:PORT of the cluster's head, or ray://HOST:PORT"
        )
    try:
        line = socket.create_connection((host, int(port)), timeout=PATIENCE)
    except OSError as error:
        reason = error.strerror or str(error)
        raise UsageError(
            f"--address {address}: cannot be reached ({reason}): does `ray start --head` run there?"
        ) from None
    answer = b""
    with line, contextlib.suppress(OSError):
        line.sendall(_GREETING)
        answer = line.recv(len(_GREETING))
    if answer[3:4] != _SETTINGS:
        raise UsageError(f"--address {address}: what listens there is no Ray head: see `ray status`")
