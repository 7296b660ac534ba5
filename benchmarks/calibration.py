"""Is a stated confidence a probability?  First names of all suites held against what was right.

The forecast of a study is the confidence in the first effect that its diagnosis names, and it comes true
where that effect is hidden.  A name where nothing is hidden, or something that the catalogue does not have,
is wrong.  A diagnosis that names nothing makes no forecast and is counted apart: it is right where nothing of
the catalogue is hidden.  *Before calibration* is what the confidence was made from: the share of resamples
that the effect wins, or the share of left-out error that it removes.

    python -m benchmarks.calibration report hidden.parquet logs.parquet base.parquet --plot reliability.png
    python -m benchmarks.calibration write hidden.parquet logs.parquet base.parquet --commit 1234567

Results files are those of `hidden_effects`, `imperfect_logs` and `imperfect_base`, in any order and number;
studies of seeds for development are left out.  `write` makes benchmarks/results/calibration.csv, its picture
and the page of the documentation that shows both.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.hidden_effects.scoring import interval, rate, score
from benchmarks.imperfect_base.scoring import BIN, bins, brier
from benchmarks.imperfect_base.work import together
from benchmarks.kept_tables import ROOT, Row, keep, markdown, origin

HELD_BACK = {"hidden_effects": 10_000, "imperfect_logs": 70_000, "imperfect_base": 70_000}
"""First seed of each suite that nothing was mended with."""
KEY = ("kind", "seed", "source", "condition", "with_before", "seconds")
"""Columns that tell studies apart, where a suite has them."""
SCHEMA: dict[str, Any] = {
    **{"suite": pl.String, "seed": pl.Int64, "confidence": pl.Float64, "support": pl.Float64},
    **{"named": pl.Boolean, "right": pl.Boolean},
}
"""Columns of forecasts, one row per study; `right` is of the first name, or of naming nothing."""
FORECASTS = {"as stated": "confidence", "before calibration": "support"}
COLOURS = {"as stated": "#0072B2", "before calibration": "#D55E00"}
ALL = "all suites"
PICTURE = ROOT / "docs" / "images" / "calibration.png"


def read(paths: Iterable[Path]) -> pl.DataFrame:
    """Forecasts of results files, each study once.

    Raises:
        SystemExit: A file holds no studies of diagnoses.
    """
    suites: dict[str, list[pl.DataFrame]] = {}
    for path in paths:
        table = pl.read_parquet(path)
        if not {"verdicts", "confidences", "called"} <= set(table.columns):
            raise SystemExit(f"{path} holds no studies of diagnoses; give results of {', '.join(HELD_BACK)}")
        suites.setdefault(suite_of(table), []).append(table)
    return pl.concat([forecasts(together(tables)) for tables in suites.values()])


def suite_of(table: pl.DataFrame) -> str:
    """The suite that a table of results comes from, by its columns."""
    if "condition" in table.columns:
        return "imperfect_logs"
    return "imperfect_base" if "with_before" in table.columns else "hidden_effects"


def forecasts(table: pl.DataFrame) -> pl.DataFrame:
    """The forecasts of one suite's results on held-back seeds; studies that failed make none."""
    suite, key = suite_of(table), [name for name in KEY if name in table.columns]
    kept = table.unique(key, keep="last", maintain_order=True).filter(
        pl.col("seed") >= HELD_BACK[suite], pl.col("failure") == ""
    )
    return pl.DataFrame([_forecast(suite, row) for row in kept.iter_rows(named=True)], schema=SCHEMA)


def _forecast(suite: str, row: Row) -> Row:
    """What a study states first, and whether it is right."""
    one, words = score(row), " --before" if row.get("with_before") else ""
    found: Row = {"suite": suite + words, "seed": row["seed"], "named": bool(one.named)}
    if not one.named:
        return found | {"right": not one.truth}
    first = one.named[0]
    return found | {"confidence": first.confidence, "support": first.support, "right": one.top}


def parts(those: pl.DataFrame) -> Iterator[tuple[str, pl.DataFrame]]:
    """All studies, and those of each suite where there are several."""
    yield ALL, those
    names = those["suite"].unique(maintain_order=True).to_list()
    for name in names if len(names) > 1 else ():
        yield name, those.filter(suite=name)


def pairs(those: pl.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Forecast probabilities of one kind and whether they came true (1.0) or not (0.0), (N,) each."""
    told = those.filter("named").drop_nulls(column)
    return told[column].to_numpy().clip(0.0, 1.0), told["right"].cast(pl.Float64).to_numpy()


def base_rate(right: np.ndarray) -> float:
    """Brier score of the share of right names as everyone's forecast: what a score must be below."""
    return brier(np.full(right.size, right.mean()), right) if right.size else float("nan")


def scores(those: pl.DataFrame) -> Iterator[Row]:
    """A row per suite and forecast with its Brier score."""
    for suite, part in parts(those):
        silent = part.filter(~pl.col("named"))["right"].to_list()
        for words, column in FORECASTS.items():
            stated, right = pairs(part, column)
            if not stated.size:
                continue
            studies = {"studies": part.height, "nothing named, rightly": rate(silent)}
            yield {
                **{"names of": suite, "forecast": words, "confidence": "any", "names": stated.size},
                **{"mean": f"{stated.mean():.3f}", "right": rate(map(bool, right))},
                **{
                    "Brier score": f"{brier(stated, right):.4f}",
                    "of the base rate": f"{base_rate(right):.4f}",
                },
                **(studies if column == "confidence" else {}),
            }


def reliability(those: pl.DataFrame) -> Iterator[Row]:
    """A row per bin of equal count, over all suites."""
    for words, column in FORECASTS.items():
        stated, right = pairs(those, column)
        for part in bins(stated) if stated.size else ():
            low, high = stated[part].min(), stated[part].max()
            yield {
                **{"names of": ALL, "forecast": words},
                **{"confidence": f"{low:.3f}" if low == high else f"{low:.3f} to {high:.3f}"},
                **{"names": part.size, "mean": f"{stated[part].mean():.3f}"},
                **{"right": rate(map(bool, right[part]))},
            }


def held(those: pl.DataFrame, column: str) -> list[bool]:
    """Of each bin, whether the mean that was stated lies in the 95 % interval of the share of right names."""
    stated, right = pairs(those, column)
    limits = [(part, interval(int(right[part].sum()), part.size)) for part in bins(stated) if stated.size]
    return [bool(low <= stated[part].mean() <= high) for part, (low, high) in limits]


def summary(those: pl.DataFrame) -> str:
    """Everything that forecasts say, as Markdown."""
    unsure = those.filter(pl.col("named") & pl.col("confidence").is_null()).height
    lines = [
        f"{those.height} studies; 95 % intervals after Clopper and Pearson, studies counted as independent."
        + (f" {unsure} name first what has no confidence, and are left out." if unsure else "")
    ]
    for words, column in FORECASTS.items():
        inside, (stated, _) = held(those, column), pairs(those, column)
        if stated.size < BIN:
            lines.append(f"{words}: {stated.size} names, too few for a bin of {BIN}.")
        else:
            lines.append(
                f"{words}: the mean stated lies in the interval of {sum(inside)} of {len(inside)} bins."
            )
    return "\n\n".join([*lines, markdown(list(scores(those))), markdown(list(reliability(those)))]) + "\n"


def draw(those: pl.DataFrame, path: Path) -> None:
    """Draw the reliability diagram as .png or .svg: share of right names against the mean stated, by bin."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.8, 4.8), dpi=150, layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0.0, 1.0], [0.0, 1.0], color="#888888", linewidth=0.8, linestyle="--")
    for words, column in FORECASTS.items():
        stated, right = pairs(those, column)
        if not stated.size:
            continue
        split = bins(stated)
        mean = np.array([stated[part].mean() for part in split])
        share = np.array([right[part].mean() for part in split])
        limits = np.array([interval(int(right[part].sum()), part.size) for part in split])
        label = f"{words}: Brier score {brier(stated, right):.3f}, {stated.size} names"
        errors = np.abs(limits.T - share)
        axes.errorbar(mean, share, errors, fmt="o-", color=COLOURS[words], label=label, capsize=3)
    axes.set(xlim=(0.0, 1.02), ylim=(0.0, 1.02), aspect="equal")
    axes.set_xlabel("mean confidence of a bin")
    axes.set_ylabel("share of right first names")
    axes.grid(color="#E6E6E6", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, loc="lower right", fontsize=8)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, metadata={"Software": ""} if path.suffix == ".png" else None)


def write(those: pl.DataFrame, names: Sequence[str], commit: str) -> None:
    """Keep the figures: the table, the picture, and the page that shows them."""
    draw(those, PICTURE)
    whence = origin(those, f"python -m benchmarks.calibration write {' '.join(names)}", commit)
    keep("calibration", [row | whence for row in (*scores(those), *reliability(those))])


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=about)
    commands = top.add_subparsers(required=True, dest="command")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("results", type=Path, nargs="+")
    one = commands.add_parser("report", help="print the tables", parents=[common])
    one.add_argument("--plot", type=Path, help="draw the reliability diagram, as .png or .svg")
    two = commands.add_parser("write", help="keep table and picture for the pages", parents=[common])
    two.add_argument("--commit", required=True, help="of the code that was measured")
    chosen = top.parse_args()
    found = read(chosen.results)
    if found.filter("named").drop_nulls("confidence").is_empty():
        raise SystemExit("nothing was named with a confidence on held-back seeds; run more studies")
    print(summary(found), end="")
    if chosen.command == "write":
        write(found, [path.name for path in chosen.results], chosen.commit)
    elif chosen.plot:
        draw(found, chosen.plot)


if __name__ == "__main__":
    main()
