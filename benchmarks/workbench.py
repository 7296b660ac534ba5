"""Delay of the workbench from a slider to the redrawn curves, its start, and its memory.

The recording has ten minutes at 50 Hz: the sessions of the sample, repeated.  The server runs as a user
starts it.  Chromium shows the page, and the benchmark moves a slider in it.  The delay is the time from the
event of the slider to the frame with the new curves; processor times are of the server and of the browser
together.
A second part times the computation alone: the visible minute with 60 predictions, and the whole recording
with all predictions.

    python -m benchmarks.workbench --moves 40
"""

from __future__ import annotations

import argparse
import datetime
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

import polars as pl

from benchmarks import kept_tables

ROOT = Path(__file__).resolve().parents[1]
SESSIONS = 10
"""Number of sessions of 60 s."""
TICK = os.sysconf("SC_CLK_TCK")
READY = "workbench at "
DRAWN = "Number(document.body.dataset.drawn || 0)"
"""Number of times that the page has drawn its curves, in JavaScript."""
REPEATS = 15
"""Number of computations that are timed."""
Row = dict[str, str]


def recording(folder: Path) -> Path:
    """Write ten minutes at 50 Hz, and return the path."""
    from hydro.app import opening
    from hydro.io import table

    one = table.read(opening.sample()[1], "raw").frame
    names = one["session"].unique().sort().to_list()
    parts = [
        one.filter(session=names[i % len(names)]).with_columns(session=pl.lit(f"session-{i + 1:02}"))
        for i in range(SESSIONS)
    ]
    path = folder / "ten-minutes.parquet"
    table.write(table.make("raw", pl.concat(parts), stage="benchmark"), path)
    return path


def computed(path: Path) -> list[Row]:
    """Time the computation of a redraw in this process."""
    from hydro.app import drawing, opening
    from hydro.app.bench import POINTS
    from hydro.app.session import Session

    craft = opening.Craft.read(opening.sample()[0])
    opened = opening.open_recording([str(path)], "", craft, lambda words, share: None)
    session = Session()
    session.open(craft, opened)
    live, vehicle = session.live, session.present
    assert live is not None
    rows = live.rows(0.0, drawing.FIRST_WINDOW)

    def minute() -> None:
        drawing.redrawn(live, vehicle, 5.0, rows, POINTS)

    def everything() -> None:
        drawing.redrawn(live, vehicle, 5.0, (0, live.record.rows), POINTS)
        live.errors(vehicle, 5.0, every=True)

    return [
        _timed("computation: visible minute and 60 predictions of 5 s", minute),
        _timed("computation: all ten minutes and all predictions", everything),
    ]


def _timed(words: str, work: Callable[[], None]) -> Row:
    """Return the row of a computation's time, measured several times after a first call."""
    work()
    walls, processor = [], []
    for _ in range(REPEATS):
        wall, used = time.perf_counter(), time.process_time()
        work()
        walls.append(time.perf_counter() - wall)
        processor.append(time.process_time() - used)
    return _row(words, median(processor), median(walls))


def shown(path: Path, moves: int) -> list[Row]:
    """Move a slider in a browser, and return delays, start and memory."""
    sys.path.insert(0, str(ROOT / "tests"))
    import browser

    from hydro.app import opening

    with served(opening.sample()[0], str(path)) as (server, link, started), browser.page() as tab:
        tab.seconds = 600.0
        tab.screen(1280, 800)
        begun = time.perf_counter()
        tab.visit(link, "document.querySelector('.bench') !== null")
        first, loaded = time.perf_counter() - begun, _processor(server)
        tab.wait(f"{DRAWN} >= 1")
        drawn, filled = time.perf_counter() - begun, sum(_processor(one) for one in _family(server))
        tab.wait(f"{DRAWN} >= 2")
        tab.press("4")
        tab.wait("document.querySelector('input[data-slide]') !== null")
        used = _processor(server) + _processor(os.getpid(), children=True)
        for number in range(moves):
            count = tab.run("workbench.delays.length")
            share = 0.1 + 0.02 * (number % 20)
            tab.run(
                "var one = document.querySelector('input[data-slide]');"
                f"one.value = {share} * one.max; one.dispatchEvent(new Event('input', {{bubbles: true}}))"
            )
            tab.wait(f"workbench.delays.length > {count}")
        used = _processor(server) + _processor(os.getpid(), children=True) - used
        delays = tab.run("workbench.delays")
        memory = sum(_peak(one) for one in _family(server))
    return [
        _row("slider to redraw in the browser, median", used / moves, median(delays[1:]) / 1000.0),
        _row("command to first page (processor time: server)", loaded, started + first),
        _row("command to first curves (processor time: server and worker)", filled, started + drawn),
        {
            "quantity": "peak memory of server and worker",
            "processor time": "",
            "time": "",
            "memory": f"{memory:,.0f} MB",
        },
    ]


@contextmanager
def served(*files: str) -> Iterator[tuple[int, str, float]]:
    """Run `hydro app` on files; yield its process, its link, and the seconds until it answered."""
    line = [sys.executable, "-m", "hydro", "app", *files, "--no-browser"]
    begun = time.perf_counter()
    with (
        tempfile.TemporaryDirectory() as folder,
        subprocess.Popen([*line, "--folder", folder], stderr=subprocess.PIPE, text=True) as process,
    ):
        try:
            assert process.stderr is not None
            link = next(told.partition(READY)[2].strip() for told in process.stderr if READY in told)
            yield process.pid, link, time.perf_counter() - begun
        finally:
            process.terminate()


def _family(process: int) -> list[int]:
    """Return the numbers of a process and its children, including those started by other threads."""
    children = [
        child for one in Path(f"/proc/{process}/task").glob("*/children") for child in one.read_text().split()
    ]
    return [process, *(one for child in children for one in _family(int(child)))]


def _processor(process: int, *, children: bool = False) -> float:
    """Return the processor time of a process, or with `children` that of the processes below it [s]."""
    every = _family(process)[1:] if children else [process]
    total = 0.0
    for one in every:
        fields = Path(f"/proc/{one}/stat").read_text().rpartition(")")[2].split()
        total += (int(fields[11]) + int(fields[12])) / TICK
    return total


def _peak(process: int) -> float:
    """Return the peak memory of a process [MB]."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return next(float(line.split()[1]) / 1000.0 for line in lines if line.startswith("VmHWM"))


def _row(words: str, processor: float, wall: float) -> Row:
    told = f"{1000.0 * processor:.0f} ms"
    return {"quantity": words, "processor time": told, "time": f"{1000.0 * wall:.0f} ms", "memory": ""}


def main() -> None:
    """Run both parts and print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--moves", type=int, default=40, help="moves of the slider")
    parser.add_argument(
        "--keep", metavar="COMMIT", help="write benchmarks/results for this commit of the code"
    )
    given = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = recording(Path(folder))
        rows += computed(path)
        rows += shown(path, given.moves)
    print(kept_tables.markdown(rows))
    if given.keep is not None:
        origin = {"commit": given.keep, "recorded": "", "date": datetime.date.today().isoformat()}
        origin |= {"command": f"python -m benchmarks.workbench --moves {given.moves}", "seeds": "not used"}
        kept_tables.keep("workbench", [{**one, **origin} for one in rows])


if __name__ == "__main__":
    main()
