"""Commands of `hydro` and scripts, each a process of its own, forked from one that has imported the modules.

A shell that runs twenty commands would import NumPy, Polars, SciPy, Numba, PyTorch and `hydro` twenty times,
which takes one or two seconds each time.  Each command itself imports libraries that read the environment,
and the modules of `hydro` that need them.  A command ends without the interpreter's clean-up, which takes a
third of a second.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import gc
import importlib
import json
import os
import pkgutil
import runpy
import select
import socket
import subprocess
import sys
import tempfile
import threading
import traceback
from collections.abc import Iterator
from pathlib import Path

LIBRARIES = (
    "filterpy.kalman",
    "numba",
    "numpy",
    "polars",
    "pyarrow.parquet",
    "pydantic",
    "rich.table",
    "scipy.interpolate",
    "scipy.optimize",
    "scipy.signal",
    "scipy.spatial.transform",
    "torch",
)
PACKAGES = ("hydro.core", "hydro.io", "hydro.commands", "hydro.report", "hydro.study")
ROOT = Path(__file__).resolve().parents[1]
HYDRO = ("-m", "hydro.cli")
SHARED = "HYDRO_FORKED"
"""Variable that names the folder of the programs that the workers of a test run share."""
CLIENT = """#!{python} -IS
import json, os, socket, sys
with socket.socket(socket.AF_UNIX) as server:
    server.connect({address!r})
    told = json.dumps([[*{before!r}, *sys.argv[1:]], os.getcwd(), dict(os.environ)]).encode()
    socket.send_fds(server, [len(told).to_bytes(8, "little")], [0, 1, 2])
    server.sendall(told)
    sys.exit(int(server.recv(8) or b"70"))
"""


@contextlib.contextmanager
def served(address: str) -> Iterator[None]:
    """Serve programs at a socket, for as long as this lasts."""
    with subprocess.Popen(
        [sys.executable, __file__, address], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as server:
        assert server.stdin is not None
        assert server.stdout is not None
        assert server.stdout.readline() == b"ready\n"
        try:
            yield
        finally:
            server.stdin.close()


@contextlib.contextmanager
def offered() -> Iterator[Path]:
    """Folder of the programs `hydro` and `script`, which work for as long as this lasts."""
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        address = str(place / "socket")
        with served(address):
            for program, before in (("hydro", HYDRO), ("script", ())):
                client = place / program
                client.write_text(CLIENT.format(python=sys.executable, address=address, before=before))
                client.chmod(0o755)
            yield place


@functools.cache
def folder() -> Path:
    """Folder of the programs: that of the whole test run, or one for all tests of this process."""
    if there := os.environ.get(SHARED):
        return Path(there)
    kept = contextlib.ExitStack()
    atexit.register(kept.close)
    return kept.enter_context(offered())


def program() -> str:
    """Path of a program that does what `python -m hydro.cli` does."""
    return str(folder() / "hydro")


def python() -> str:
    """Path of a program that runs a script, `-m MODULE` or `-` (stdin) as `python` does."""
    return str(folder() / "script")


def serve(address: str) -> None:
    """Fork a process for each caller, until the standard input ends; each returns here and goes on alone."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(address)
    listener.listen()
    print("ready", flush=True)
    while listener in select.select([listener, sys.stdin], [], [])[0]:
        caller, _ = listener.accept()
        prepare()
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


def run(what: str) -> None:
    """Run a script, the standard input or a module, with the search path that Python would give it.

    Args:
        what: The first argument: `-m`, `-`, or the path of a script.
    """
    given = [path for path in os.environ.get("PYTHONPATH", "").split(os.pathsep) if path]
    first = str(Path(what).resolve().parent) if what not in ("-m", "-") else os.getcwd()
    sys.path[:1] = list(dict.fromkeys([first, *given]))
    if what == "-m":
        runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
    elif what == "-":
        sys.argv[0] = what
        exec(compile(sys.stdin.read(), "<stdin>", "exec"), {"__name__": "__main__"})
    else:
        sys.argv[0] = what
        runpy.run_path(what, run_name="__main__")


def modules() -> Iterator[str]:
    """Names of the modules that every command finds imported."""
    yield from LIBRARIES
    for package in map(importlib.import_module, PACKAGES):
        yield from (found.name for found in pkgutil.walk_packages(package.__path__, f"{package.__name__}."))


def leave(code: object) -> None:
    """End the process as Python does, except that it leaves all objects to the operating system."""
    if code is not None and not isinstance(code, int):
        print(code, file=sys.stderr)
    number = code if isinstance(code, int) else int(code is not None)
    threading._shutdown()
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            if stream is not None:
                stream.flush()
        except (OSError, ValueError):
            number = 120
    os._exit(number & 0xFF)


@functools.cache
def prepare() -> None:
    """Import all modules when the first program is run."""
    for module in modules():
        importlib.import_module(module)
    numba = importlib.import_module("numba.core.registry")
    numba.cpu_target.target_context.refresh()
    gc.freeze()


if __name__ == "__main__":
    sys.path.insert(1, str(ROOT))
    serve(sys.argv[1])
    _, what, *sys.argv[1:] = sys.argv
    try:
        run(what)
    except SystemExit as ended:
        leave(ended.code)
    except BaseException:
        traceback.print_exc()
        leave(1)
    leave(0)
