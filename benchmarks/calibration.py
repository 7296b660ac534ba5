"""Is a stated confidence a probability?  Confidence of first names against the truth.

The forecast of a study is the confidence in the first effect that its diagnosis names.  It comes true if
that effect is hidden.  A name is wrong where nothing is hidden, or something that the catalogue lacks.  A
diagnosis that names nothing makes no forecast; it is right where nothing of the catalogue is hidden.  *Before
calibration* is the number that the confidence was computed from: the share of resamples that the effect
wins, or the share of held-out error that it removes.  The slope is that of the least-squares line of right
names (1) and wrong ones (0) over their confidence: 1 if confidence is a probability, less if doubtful names
are too doubtful or certain ones too certain.

    python -m benchmarks.calibration report clean.parquet logs.parquet --plot reliability.png
    python -m benchmarks.calibration report benchmarks/results/judge-7389b25.parquet --decide --seeds odd
    python -m benchmarks.calibration write clean.parquet logs.parquet --commit 1234567

Results files are those of `benchmarks.judge`; studies with seeds for development are left out.  `write` makes
benchmarks/results/calibration.csv, its picture and the page of the documentation that shows both.
`--decide` repeats the decisions on the kept candidates with the present code, see `benchmarks.judge.rescore`.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from benchmarks.judge import rescore, results
from benchmarks.judge.scores import SURE, Score, scored
from benchmarks.kept_tables import ROOT, Row, keep, markdown, origin
from benchmarks.shares import interval, rate
from hydro.core.evaluation.block_resampling import weights

HELD_BACK = 10_000
"""First seed that is not for development."""
BIN = 100
"""Least number of names in a bin of the reliability table: its interval is at most 20 points wide."""
SCHEMA: dict[str, Any] = {
    **{"list": pl.String, "seed": pl.Int64, "confidence": pl.Float64, "support": pl.Float64},
    **{"named": pl.Boolean, "right": pl.Boolean},
}
"""Columns of forecasts, one row per study; `right` is of the first name, or of naming nothing."""
FORECASTS = {"as stated": "confidence", "before calibration": "support"}
COLOURS = {"as stated": "#0072B2", "before calibration": "#D55E00"}
ALL = "all lists"
RESAMPLES = 2000
"""Number of bootstrap resamples of a slope: its interval is known to 5 % of its width."""
PARITIES = {"even": 0, "odd": 1}
"""Halves of the studies, by the remainder of their seed: a law fitted on one is tested on the other."""
PICTURE = ROOT / "docs" / "images" / "calibration.png"


def read(paths: Iterable[Path], decide: bool = False) -> pl.DataFrame:
    """Return the forecasts of results files, each study once.

    Args:
        paths: Results files.
        decide: Whether the present code decides again on the kept candidates.

    Raises:
        SystemExit: A file holds no results of `benchmarks.judge`.
    """
    table = results.read(paths)
    return forecasts(rescore.rescored(table, {}) if decide else scored(table))


def forecasts(studies: Sequence[Score]) -> pl.DataFrame:
    """Return a row for each study on held-back seeds with its forecast; failed studies make none."""
    kept = [one for one in studies if one.row["seed"] >= HELD_BACK and not one.failed]
    return pl.DataFrame([_forecast(one) for one in kept], schema=SCHEMA)


def _forecast(one: Score) -> Row:
    """Return the first effect that a study names, and whether it is hidden; for a tie, the best effect."""
    found: Row = {"list": one.row["list"], "seed": one.row["seed"], "named": bool(one.named)}
    first = one.answer
    if first is None:
        return found | {"right": not one.changed}
    confidence = None if first.unsure else first.confidence
    right = first.effect in one.row["called"] if first.tie else first.right
    return found | {"confidence": confidence, "support": first.support, "right": right}


def parts(those: pl.DataFrame) -> Iterator[tuple[str, pl.DataFrame]]:
    """Yield label and forecasts of all studies, then of each list if there are several."""
    yield ALL, those
    names = those["list"].unique(maintain_order=True).to_list()
    for name in names if len(names) > 1 else ():
        yield name, those.filter(list=name)


def brier(confidence: np.ndarray, right: np.ndarray) -> float:
    """Return the mean squared difference of stated confidence and truth (Brier 1950); NaN without names."""
    return float(np.mean((confidence - right) ** 2)) if confidence.size else float("nan")


def bins(confidence: np.ndarray) -> list[np.ndarray]:
    """Return the indices of names sorted into at most ten bins of equal count by rising confidence.

    A bin has at least BIN names.  Equal confidences share a bin, so that the bins do not depend on the order
    of names.  Names with the greatest confidence have a bin of their own if they fill it, so that they do not
    hide less certain names.
    """
    order = np.argsort(confidence, kind="stable")
    rising = confidence[order]
    below = int(np.searchsorted(rising, rising[-1:].max(initial=0.0), "left"))
    if min(below, order.size - below) >= BIN:
        lower, greatest = np.split(order, [below])
        return [*(lower[part] for part in bins(confidence[lower])), greatest]
    count = int(np.clip(order.size // BIN, 1, 10))
    ends = np.cumsum([part.size for part in np.array_split(order, count)])
    edges = [0]
    for end in np.searchsorted(rising, rising[ends - 1], "right"):
        if end - edges[-1] >= BIN:
            edges.append(int(end))
    if len(edges) > 1 and order.size - edges[-1] < BIN:
        edges.pop()
    return [part for part in np.split(order, edges[1:]) if part.size]


def pairs(those: pl.DataFrame, column: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the probabilities that one forecast states, and whether each came true (1.0 or 0.0), (N,) each.

    Args:
        those: Table of forecasts.
        column: Column with the probability.
    """
    told = those.filter("named").drop_nulls(column)
    return told[column].to_numpy().clip(0.0, 1.0), told["right"].cast(pl.Float64).to_numpy()


def slope(those: pl.DataFrame, column: str) -> tuple[float, float, float]:
    """Return the slope of the least-squares line of the truth over one forecast, with its 95 % interval.

    Studies of one seed share their vehicle, so whole seeds are resampled (Bayesian bootstrap, Rubin 1981).
    The slope is NaN where all forecasts are equal.

    Args:
        those: Table of forecasts.
        column: Column with the probability.
    """
    told = those.filter("named").drop_nulls(column)
    stated, right = pairs(those, column)
    if not stated.size or not np.ptp(stated) > 0.0:
        return float("nan"), float("nan"), float("nan")
    _, seed = np.unique(told["seed"].to_numpy(), return_inverse=True)
    drawn = weights(int(seed.max()) + 1, RESAMPLES, 0)[:, seed]
    slopes = [_weighted_slope(stated, right, each) for each in (np.ones(stated.size), *drawn)]
    low, high = np.quantile(slopes[1:], [0.025, 0.975])
    return slopes[0], float(low), float(high)


def _weighted_slope(stated: np.ndarray, right: np.ndarray, weight: np.ndarray) -> float:
    """Return the slope of the weighted least-squares line of `right` over `stated`, (N,) each."""
    away = stated - np.average(stated, weights=weight)
    return float((weight * away * right).sum() / (weight * away**2).sum())


def base_rate(right: np.ndarray) -> float:
    """Return the Brier score of a constant forecast, the share of right names: the baseline."""
    return brier(np.full(right.size, right.mean()), right) if right.size else float("nan")


def scores(those: pl.DataFrame) -> Iterator[Row]:
    """Yield a row with the Brier score of each list and forecast."""
    for name, part in parts(those):
        silent = part.filter(~pl.col("named"))["right"].to_list()
        for words, column in FORECASTS.items():
            stated, right = pairs(part, column)
            if not stated.size:
                continue
            studies = {"studies": part.height, "nothing named, rightly": rate(silent)}
            yield {
                **{"names of": name, "forecast": words, "confidence": "any", "names": stated.size},
                **{"mean": f"{stated.mean():.3f}", "right": rate(map(bool, right))},
                **{
                    "Brier score": f"{brier(stated, right):.4f}",
                    "of the base rate": f"{base_rate(right):.4f}",
                },
                **({"slope": "{:.2f} [{:.2f}, {:.2f}]".format(*slope(part, column))} if name == ALL else {}),
                f"right names at {SURE:g}": rate((stated >= SURE)[right == 1.0]),
                f"wrong names at {SURE:g}": rate((right == 0.0)[stated >= SURE]),
                **(studies if column == "confidence" else {}),
            }


def reliability(those: pl.DataFrame) -> Iterator[Row]:
    """Yield a row for each bin of equal count, over all lists."""
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
    """Return for each bin whether the mean confidence lies in the interval of the share of right names.

    Args:
        those: Table of forecasts.
        column: Column with the probability.
    """
    stated, right = pairs(those, column)
    limits = [(part, interval(int(right[part].sum()), part.size)) for part in bins(stated) if stated.size]
    return [bool(low <= stated[part].mean() <= high) for part, (low, high) in limits]


def summary(those: pl.DataFrame) -> str:
    """Return the report of forecasts as Markdown."""
    unsure = those.filter(pl.col("named") & pl.col("confidence").is_null()).height
    lines = [
        f"{those.height} studies; 95 % intervals after Clopper and Pearson, studies counted as independent."
        + (f" {unsure} state no confidence in their first name, and are left out." if unsure else "")
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
    """Draw the reliability diagram as .png or .svg: share of right names against mean confidence, by bin."""
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
    """Write the kept table, its picture, and the page that shows them."""
    draw(those, PICTURE)
    whence = origin(those, f"python -m benchmarks.calibration write {' '.join(names)}", commit)
    keep("calibration", [row | whence for row in (*scores(those), *reliability(those))])


def main() -> None:
    about = (__doc__ or "").splitlines()[0]
    top = argparse.ArgumentParser(prog="python -m benchmarks.calibration", description=about)
    commands = top.add_subparsers(required=True, dest="command")
    common = argparse.ArgumentParser(add_help=False)
    common.add_argument("results", type=Path, nargs="+")
    common.add_argument("--decide", action="store_true", help="decide again with the present code")
    one = commands.add_parser("report", help="print the tables", parents=[common])
    one.add_argument("--plot", type=Path, help="draw the reliability diagram, as .png or .svg")
    one.add_argument("--seeds", choices=PARITIES, help="one half of the studies; by default all")
    two = commands.add_parser("write", help="keep table and picture for the pages", parents=[common])
    two.set_defaults(seeds=None)
    two.add_argument("--commit", required=True, help="of the code that was measured")
    chosen = top.parse_args()
    found = read(chosen.results, chosen.decide)
    if chosen.seeds:
        found = found.filter(pl.col("seed") % 2 == PARITIES[chosen.seeds])
    if found.filter("named").drop_nulls("confidence").is_empty():
        raise SystemExit("nothing was named with a confidence on held-back seeds; run more studies")
    print(summary(found), end="")
    if chosen.command == "write":
        names = [*(path.name for path in chosen.results), *(["--decide"] if chosen.decide else [])]
        write(found, names, chosen.commit)
    elif chosen.plot:
        draw(found, chosen.plot)


if __name__ == "__main__":
    main()
