"""Worker process for long work, with progress and cancelling.

Work of minutes runs in a process of its own, so that the page stays responsive.  Cancelling ends the process;
the next work starts another one.
"""

from __future__ import annotations

import multiprocessing
import signal
import threading
import warnings
from collections.abc import Callable
from importlib import import_module
from multiprocessing.connection import Connection
from typing import Any

from hydro.core.errors import DataError, HydroError, HydroNotice

Report = Callable[[str, Any], None]
"""Called with the kind of a message, `progress`, `provisional` or `notice`, and its content."""
WORK = "hydro.app.jobs"
"""Module of the work, with all its libraries."""
PATIENCE = 5.0
"""Time that a cancelled process has to end before it is killed [s]."""


class Cancelled(HydroError):
    """Error that ends work after `Worker.cancel`."""


class Worker:
    """Process that does long work, one function at a time."""

    def __init__(self) -> None:
        """Start no process yet."""
        self._lock, self._ends = threading.Lock(), threading.Lock()
        self._process: Any = None
        self._pipe: Connection | None = None
        self._cancelled = False

    def start(self) -> None:
        """Start the process before its first work, so that its libraries are loaded when work arrives."""
        self._started(WORK)

    def run(self, work: Callable[..., Any], *arguments: Any, report: Report | None = None) -> Any:
        """Run a function of a module in the process, wait for it, and return its result.

        Args:
            work: The function; it gets a `Report` after the arguments.
            arguments: Arguments, which are copied to the process.
            report: Called in this thread with each message of the function.

        Raises:
            Cancelled: `cancel` was called.
            DataError: The function raised an error of the data, or the process ended on its own.
        """
        with self._lock:
            self._cancelled = False
            pipe = self._started()
            try:
                pipe.send((work, arguments))
                while True:
                    kind, content = pipe.recv()
                    if kind == "done":
                        return content
                    if kind == "failed":
                        raise content
                    if report is not None:
                        report(kind, content)
            except (EOFError, OSError) as error:
                self._end()
                if self._cancelled:
                    raise Cancelled("cancelled") from None
                raise DataError(
                    "the worker process ended; there may not be enough memory: try a shorter recording"
                ) from error

    def cancel(self) -> None:
        """End the process with the work in it.

        The call of `run` that waits for the work raises `Cancelled`.
        """
        self._cancelled = True
        self._end()

    def close(self) -> None:
        """End the process."""
        self._end()

    def _started(self, module: str = __name__) -> Connection:
        with self._ends:
            if self._pipe is None:
                context = multiprocessing.get_context("spawn")
                self._pipe, other = context.Pipe()
                self._process = context.Process(target=serve, args=(other, module), daemon=True)
                self._process.start()
                other.close()
            return self._pipe

    def _end(self) -> None:
        with self._ends:
            process, pipe, self._process, self._pipe = self._process, self._pipe, None, None
        if process is not None:
            process.terminate()
            process.join(PATIENCE)
            if process.is_alive():
                process.kill()
        if pipe is not None:
            pipe.close()


def serve(pipe: Connection, module: str) -> None:
    """Import a module, then run each function that arrives through a pipe, until the other end closes.

    This is the main loop of the worker process.

    Args:
        pipe: Connection to the server.
        module: Dotted name of the module.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the server, which ends this process
    import_module(module)
    _forward_notices(pipe)
    while True:
        try:
            work, arguments = pipe.recv()
        except EOFError:
            return
        try:
            answer = ("done", work(*arguments, lambda kind, content: pipe.send((kind, content))))
        except HydroError as error:
            answer = ("failed", error)
        except MemoryError:
            answer = ("failed", DataError("not enough memory: use a shorter recording"))
        except Exception as error:
            told = " ".join(str(error).split())
            answer = ("failed", DataError(f"{type(error).__name__}: {told}; this is a bug: please report it"))
        pipe.send(answer)
        del work, arguments, answer  # the next work may need the memory


def _forward_notices(pipe: Connection) -> None:
    """Send notices, such as those of the first compilation, through the pipe instead of to the terminal."""
    usual = warnings.showwarning

    def show(message: Warning | str, category: type[Warning], *place: Any, **options: Any) -> None:
        if issubclass(category, HydroNotice):
            pipe.send(("notice", str(message)))
        else:
            usual(message, category, *place, **options)

    warnings.simplefilter("always", HydroNotice)
    warnings.showwarning = show
