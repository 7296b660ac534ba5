"""Ray clusters on this machine, for tests and timings: nodes of one processor, on loopback addresses."""

from __future__ import annotations

import contextlib
import os
import secrets
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

HEAD, SECOND = ADDRESSES = "127.0.0.2", "127.0.0.3"
"""A head bound to 127.0.0.1 would hang: Ray takes that for `whichever address this machine has`."""
ROOT = Path(__file__).resolve().parents[1]
WAIT = 60.0
AUTHENTICATION = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": secrets.token_hex(32)}
"""Token of these clusters alone.  By default Ray creates one in the home folder with the first cluster of a
machine.  Afterwards `ray start` requires it, and a user who gives an address must declare it."""
os.environ.update(AUTHENTICATION)  # before Ray is imported, which reads it once
BOUND = """
import ctypes, runpy, signal
ctypes.CDLL(None).prctl(1, signal.SIGTERM)
runpy.run_module("ray.scripts.scripts", run_name="__main__", alter_sys=True)
"""
"""Command `ray` that ends, with its node, when its parent process ends for any reason."""


@dataclass
class Nodes:
    """A Ray cluster, and the processes of its nodes.

    Attributes:
        address: Address of the cluster's head.
        nodes: Process of each node by name.
    """

    address: str
    nodes: dict[str, subprocess.Popen[bytes]] = field(default_factory=dict)

    def begin(self, node: str, *options: str) -> None:
        """Start a node; `ray start --block` ends with it."""
        line = [sys.executable, "-c", BOUND, "start", *options, f"--node-ip-address={node}"]
        line += ["--num-cpus=1", "--object-store-memory=80000000", "--disable-usage-stats", "--block"]
        quiet = {"RAY_USAGE_STATS_ENABLED": "0", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        quiet |= {"RAY_worker_niceness": "0"}  # by default 15: they would hardly run while other tests do
        paths = os.pathsep.join([str(ROOT), str(ROOT / "tests"), os.environ.get("PYTHONPATH", "")])
        environment = os.environ | quiet | {"PYTHONPATH": paths}
        self.nodes[node] = subprocess.Popen(
            line,
            env=environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )

    def wait(self) -> None:
        """Wait until the cluster knows all its nodes."""
        from hydro.study.cluster import Cluster

        with Cluster(self.address) as cluster:  # only one, as Ray starts new workers for every connection
            for _ in range(int(WAIT / 0.2)):
                if len(cluster.nodes()) == len(self.nodes):
                    return
                time.sleep(0.2)
        raise OSError("not all nodes have come")

    def kill(self, node: str) -> None:
        """Kill a node and all its workers, like a power failure."""
        process = self.nodes.pop(node)
        for one in _descendants(process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(one, signal.SIGKILL)
        process.kill()
        process.wait()


def _descendants(process: int) -> list[int]:
    """Return the numbers of all processes below a process."""
    listed = subprocess.run(["ps", "-eo", "pid=,ppid="], capture_output=True, text=True, check=True).stdout
    of = [tuple(map(int, line.split())) for line in listed.splitlines()]
    found = [process]
    for parent in found:
        found += [pid for pid, above in of if above == parent]
    return found[1:]


def _free_port() -> int:
    """Return a free port, outside those that Ray gives to its workers."""
    for port in range(20000 + os.getpid() % 5000, 32000):
        with socket.socket() as one, contextlib.suppress(OSError):
            one.bind((HEAD, port))
            return port
    raise OSError("no free port")


def _wait_for(address: str, process: subprocess.Popen[bytes]) -> None:
    host, port = address.split(":")
    for _ in range(int(WAIT / 0.2)):
        with contextlib.suppress(OSError):
            socket.create_connection((host, int(port)), timeout=1.0).close()
            return
        if process.poll() is not None:
            break
        time.sleep(0.2)
    raise OSError(f"no head at {address}")


@contextlib.contextmanager
def nodes(count: int = 2) -> Iterator[Nodes]:
    """Start a cluster of one or two nodes, and stop the remaining nodes at the end of the block."""
    port = _free_port()
    cluster = Nodes(f"{HEAD}:{port}")
    # paths of sockets are short: not pytest's own folders
    with tempfile.TemporaryDirectory(prefix="ray", ignore_cleanup_errors=True) as folder:
        try:
            head = ("--head", f"--port={port}", "--include-dashboard=false", f"--temp-dir={folder}")
            cluster.begin(HEAD, *head)
            _wait_for(cluster.address, cluster.nodes[HEAD])
            for node in ADDRESSES[1:count]:
                cluster.begin(node, f"--address={cluster.address}")
            yield cluster
        finally:
            for node in list(cluster.nodes):
                cluster.kill(node)
