"""Studies of advised runs: make ambiguous recordings, run the advice, diagnose both logs together.

A results file grows by one row per study; the same command continues an earlier run.  `--tied N` ends a run
at N open studies.  Seeds below 10,000 are for development, those from 70,000 for published figures.  `write`
makes benchmarks/results/flown_advice.csv and the page that shows it.

    python -m benchmarks.flown_advice run --studies 60 --first-seed 0 -o flown.parquet
    # Report, and keep the tables of the documentation.
    python -m benchmarks.flown_advice report flown.parquet
    python -m benchmarks.flown_advice write flown.parquet --commit 1234567
"""

from __future__ import annotations

import os

from hydro.core.diagnosis.settings import SURE

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(_name, "1")  # studies run in parallel

import argparse
from pathlib import Path
from typing import Any

import polars as pl

from benchmarks.flown_advice import study
from benchmarks.kept_tables import Row, keep, markdown, origin
from benchmarks.shares import rate
from benchmarks.work import Results, add_report, add_workers, done

KEY = ("seed", "seconds")
FLIGHTS = {"advised": "the advised run", "random": "a random one as long"}


def run(chosen: argparse.Namespace) -> None:
    """Run the studies that the results file lacks."""
    results = Results(chosen.out, study.SCHEMA)
    known = set(results.table.select(KEY).rows())
    seeds = range(chosen.first_seed, chosen.first_seed + chosen.studies)
    tasks = [(seed, chosen.seconds) for seed in seeds if (seed, chosen.seconds) not in known]
    for number, row in enumerate(done(study.run, tasks, chosen), 1):
        results.add(row)
        print(f"{number}/{len(tasks)} {line(row)}", flush=True)
        if chosen.tied and results.table.filter(pl.col("open") != "").height >= chosen.tied:
            break


def line(row: dict[str, Any]) -> str:
    """Describe a study in one line."""
    head = f"{row['seed']} {row['preset']}, {row['family']}: {row['effect']}"
    if row["failure"]:
        return f"{head} FAILED {row['failure']}"
    told = f"{head} -> {row['first_findings'] or 'nothing'}"
    if not row["open"]:
        return f"{told}: not open | cpu {row['cpu']:.0f} s"
    apart = "" if row["expected"] is None else f": {row['expected']:.2g} s.d."
    return (
        f"{told}, {row['open']} | {', '.join(row['sessions'])}{apart} | "
        f"advised {row['advised_outcome']} ({row['advised_findings']}), random {row['random_outcome']} | "
        f"cpu {row['cpu']:.0f} s"
    )


def summary(results: pl.DataFrame) -> str:
    """Return the summary of a results table as Markdown."""
    tied = left_open(results)
    lines = [
        f"{results.height} recordings of one manoeuvre, {len(tied)} of them open: the diagnosis has "
        "the truth among rivals, or says that the recording does not show it. 95 % intervals after Clopper "
        "and Pearson.",
        "",
        markdown(table(results)),
    ]
    inside = sum(bool(row["inside"]) for row in tied)
    lines += ["", f"{inside} of {len(tied)} advised flights kept to the limits with what was hidden."]
    failed = results.filter(pl.col("failure") != "")
    lines += [f"Seed {seed} failed: {why}" for seed, why in failed.select("seed", "failure").rows()]
    return "\n".join(lines) + "\n"


def left_open(results: pl.DataFrame) -> list[Row]:
    """Return the studies whose first diagnosis does not confirm the true effect, but does not exclude it."""
    return results.filter((pl.col("failure") == "") & (pl.col("open") != "")).to_dicts()


def table(results: pl.DataFrame) -> list[Row]:
    """Return rows on open studies, all and by cause: results after the advised and after a random flight."""
    tied = left_open(results)
    rows: list[Row] = []
    for part in ("all", "rivals", "unseen", *dict.fromkeys(row["family"] for row in tied)):
        group = [row for row in tied if part in ("all", row["open"], row["family"])]
        if not group:
            continue
        named = {
            f"truth first after {words}": rate(row[f"{flight}_outcome"] == "named" for row in group)
            for flight, words in FLIGHTS.items()
        }
        sure = rate(row["advised_outcome"] == "named" and row["advised_confidence"] >= SURE for row in group)
        wrong = rate(row["advised_outcome"].startswith("wrong") for row in group)
        told = {"stated after the advised one": sure, "wrong after it": wrong}
        rows.append({"open": part, "studies": len(group)} | named | told)
    return rows


def write(chosen: argparse.Namespace) -> None:
    """Write the kept table, and generate the pages that show it."""
    results = pl.read_parquet(chosen.results)
    command = "python -m benchmarks.flown_advice run"
    keep("flown_advice", [row | origin(results, command, chosen.commit) for row in table(results)])


def parser() -> argparse.ArgumentParser:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.flown_advice", description=about)
    commands = top.add_subparsers(required=True)
    one = commands.add_parser("run", help="run studies")
    one.add_argument("--studies", type=int, default=60, help="seeds at most")
    one.add_argument("--first-seed", type=int, default=0)
    one.add_argument("--tied", type=int, default=0, help="end at so many open studies; 0: at the last seed")
    one.add_argument("--seconds", type=float, default=120.0, help="of the first recording, in four sessions")
    add_workers(one)
    one.add_argument("-o", "--out", type=Path, default=Path("flown_advice.parquet"))
    one.set_defaults(action=run)
    add_report(commands, summary, KEY)
    one = commands.add_parser("write", help="make benchmarks/results/flown_advice.csv")
    one.add_argument("results", type=Path)
    one.add_argument("--commit", required=True, help="of the code that was measured")
    one.set_defaults(action=write)
    return top


def main() -> None:
    chosen = parser().parse_args()
    chosen.action(chosen)


if __name__ == "__main__":
    main()
