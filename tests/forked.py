"""Commands of `hydro`, each a process of its own, forked from one that has read the libraries already.

A shell that runs twenty commands would read NumPy, Polars, SciPy, Numba and PyTorch twenty times, a second or
two each. Modules of `hydro`, and libraries that read the environment, every command imports for itself.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import runpy
import select
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

LIBRARIES = ("numba", "numpy", "polars", "pyarrow.parquet", "scipy.optimize", "scipy.signal", "torch")
CLIENT = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    told = json.dumps([sys.argv[1:], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(told).to_bytes(8, "little")], [0, 1, 2])
    server.sendall(told)
    sys.exit(int(server.recv(8) or b"70"))
"""


@contextlib.contextmanager
def hydro(place: Path) -> Iterator[None]:
    """Write a program to `place` that does what `python -m hydro.cli` does, for as long as this lasts."""
    address = str(place.with_name(f"{place.name}.socket"))
    with subprocess.Popen(
        [sys.executable, __file__, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        assert server.stdout.readline() == b"ready\n"
        place.write_text(CLIENT.format(python=sys.executable, address=address))
        place.chmod(0o755)
        try:
            yield
        finally:
            server.stdin.close()


@functools.cache
def program() -> str:
    """Path of such a program, the same for all tests of this process."""
    kept = contextlib.ExitStack()
    atexit.register(kept.close)
    place = Path(kept.enter_context(tempfile.TemporaryDirectory())) / "hydro"
    kept.enter_context(hydro(place))
    return str(place)


def serve(address: str) -> None:
    """Fork a process for each caller, until the standard input ends; each returns here and goes on alone."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    print("ready", flush=True)
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        caller, _ = listener.accept()
        if not os.fork():
            listener.close()
            return attend(caller)
        caller.close()
        with contextlib.suppress(ChildProcessError):
            while os.waitpid(-1, os.WNOHANG)[0]:
                pass
    with contextlib.suppress(ChildProcessError):
        while os.wait():
            pass
    os._exit(0)


def attend(caller: socket.socket) -> None:
    """Start the caller's command and tell how it ended; return in the command's process."""
    size, streams, _, _ = socket.recv_fds(caller, 8, 3)
    told = b""
    while len(told) < int.from_bytes(size, "little"):
        told += caller.recv(1 << 20)
    if command := os.fork():
        for stream in (0, 1, *streams):
            os.close(stream)
        code = os.waitstatus_to_exitcode(os.waitpid(command, 0)[1])
        caller.sendall(str(code if code >= 0 else 128 - code).encode())
        os._exit(0)
    caller.close()
    for number, stream in enumerate(streams):
        os.dup2(stream, number)
        os.close(stream)
    sys.argv[1:], folder, environment = json.loads(told)
    os.chdir(folder)
    os.environ.clear()
    os.environ.update(environment)


if __name__ == "__main__":
    for library in LIBRARIES:
        importlib.import_module(library)
    gc.freeze()
    serve(sys.argv[1])
    sys.path[0] = os.getcwd()
    runpy.run_module("hydro.cli", run_name="__main__", alter_sys=True)
