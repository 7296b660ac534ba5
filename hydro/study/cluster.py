"""Tasks on a Ray cluster: the same functions and command lines, on any node with free processors.

Every node has the same version of hydro and sees the files under the same paths.  A task reads a file and
writes a file atomically, so the task of a lost node is run again on another.  Each node compiles its kernels
once before tasks start; otherwise every worker would compile them for itself.
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
"""Maximum number of times that a task is run again after its worker or node was lost."""
PATIENCE = 5.0
"""Time limit for an address to accept a connection, and to answer as Ray does [s]."""
_SETTINGS = b"\x04"
_GREETING = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + b"\0\0\0" + _SETTINGS + bytes(5)
"""First message of a client in gRPC, the protocol of Ray; a server answers with its own settings."""


class Cluster:
    """Connection to a Ray cluster that runs tasks on its nodes, for use in a `with` block."""

    def __init__(self, address: str | None = None, processors: int = 1) -> None:
        """Connect to a cluster, or start one of this machine.

        Args:
            address: `HOST:PORT` of its head, or `ray://HOST:PORT`.  The default is RAY_ADDRESS, else a
                cluster that runs on this machine, else a new one that ends with the block.
            processors: Number of processors, and of threads, of each task.

        Raises:
            UsageError: Ray is not installed, no Ray cluster answers at the address, or no node has that many
                processors.
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
        self.slots = sum(room for _, _, room in self.nodes())
        if not self.slots:
            self.close()
            raise UsageError(
                f"no node of the cluster has {processors} processors: ask for fewer with --threads"
            )

    def __enter__(self) -> Cluster:
        """Return the cluster itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Disconnect from the cluster."""
        self.close()

    def close(self) -> None:
        """Disconnect from the cluster; end a cluster that was started for this process."""
        self._ray.shutdown()

    def each(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> Iterator[Result]:
        """Run a task on the nodes, once for each tuple of arguments, and yield the results in that order.

        Args:
            task: Function of a module, which nodes import by its name.
            arguments: Positional arguments of each call.

        Raises:
            HydroError: A task failed; the error of the first task that failed.
            DataError: A node does not see the working folder, or nodes were lost too often.
        """
        for one in self._begun(task, arguments):
            yield self._result(one)

    def as_they_end(
        self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]
    ) -> Iterator[Result]:
        """Run a task on the nodes, once for each tuple of arguments, and yield each result when it is ready.

        The results have no particular order; all else is as for `each`.

        Args:
            task: Function of a module, which nodes import by its name.
            arguments: Positional arguments of each call.
        """
        waiting = self._begun(task, arguments)
        while waiting:
            ended, waiting = self._ray.wait(waiting)
            yield from map(self._result, ended)

    def _begun(self, task: Callable[..., Result], arguments: Sequence[tuple[Any, ...]]) -> list[Any]:
        """Start the tasks and return references to their results.

        Tasks whose results are no longer needed end when this process disconnects.  They are not cancelled
        earlier: Ray 2.60 ends the process if a cancelled task completes in the meantime.
        """
        return [self._run.remote(self._home, task, each) for each in arguments]

    def execute(self, step: Step) -> None:
        """Run a command of a study (a step) on a node, in its own process, and print its output here.

        Args:
            step: The step.

        Raises:
            StepFailed: The step failed and has printed the reason.
        """
        code, out, err = self._result(self._run.remote(self._home, captured, (step,)))
        sys.stdout.write(out)
        sys.stderr.write(err)
        if code:
            raise StepFailed(step, code)

    def nodes(self) -> list[tuple[str, str, int]]:
        """Return a tuple for each live node with a slot: identity, address, and number of task slots."""
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
        """Raise an error for nodes with another version of hydro or Python.

        Run a function once on every node.

        Args:
            warm: Function to run, such as one that compiles kernels; None only checks the nodes.

        Raises:
            DataError: A node has another version, or does not see the working folder.
        """
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy as On

        nodes = self.nodes()
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
        """Return the result of a task.

        Raises:
            HydroError: The task raised it.
            DataError: Nodes were lost too often, or hydro is not installed on them.
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
    """Run a task on a node, in the working folder of the command, because its paths may be relative."""
    try:
        os.chdir(home)
    except OSError as error:
        raise DataError(
            f"node {socket.gethostname()} does not see {home} ({error.strerror}): give all nodes one file "
            "system, with the same paths"
        ) from error
    return task(*arguments)


def _prepared(warm: Callable[[], object] | None) -> str:
    """Run `warm` on a node, such as to compile kernels, and return the versions that the node has."""
    if warm is not None:
        warm()
    return _versions()


def _versions() -> str:
    """Return the versions that must be the same on all nodes."""
    from hydro.io.provenance import package_version

    return f"hydro {package_version()} on Python {'.'.join(platform.python_version_tuple()[:2])}"


def _imported() -> Any:
    """Return the Ray module, with its usage statistics and its warning on accelerators switched off."""
    os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
    try:
        import ray
    except ImportError:
        raise UsageError("--engine ray needs Ray: pip install 'deep-hydro-sim[ray]'") from None
    return ray


def _require_answer(address: str) -> None:
    """Refuse an address without a Ray cluster, because Ray itself would wait without a time limit.

    Raises:
        UsageError: The text is not an address, or the server there is not Ray.
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
        raise UsageError(f"--address {address}: the server there is not a Ray head: see `ray status`")
