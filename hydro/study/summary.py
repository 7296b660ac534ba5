"""Summary of all networks of a study: means over seeds, and the agreement of two rankings of the models."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import polars as pl

SIDE_BY_SIDE = Path("replayed") / "side-by-side.parquet"
"""Errors of one replay with all networks of the first seed and all baselines."""
EFFECTS = Path("replayed") / "effects.parquet"
"""Errors of the replay with identified effects, with and without a network."""
CONDITIONINGS = ("paper-old", "paper-new", "low-pass-old", "low-pass-new", "clipping", "dead-band")
"""Kinds of conditioning under which networks are replayed."""


@dataclass(frozen=True)
class Run:
    """One network of a study.

    Attributes:
        model: Name of the architecture.
        seed: Seed of the training.
        minutes: Minutes of training data; None for all data.
    """

    model: str
    seed: int
    minutes: float | None = None

    @property
    def name(self) -> str:
        """Name of the network's files without suffix, such as `mlp-seed0-5min`."""
        part = "" if self.minutes is None else f"-{self.minutes:g}min"
        return f"{self.model}-seed{self.seed}{part}"

    @property
    def label(self) -> str:
        """Label of the network among those of the same model: seed, and minutes of data if limited."""
        return f"seed {self.seed}" + ("" if self.minutes is None else f", {self.minutes:g} min")


def conditioned(kind: str) -> Path:
    """Return the path, in the folder of a study, of the replay errors under one kind of conditioning.

    Args:
        kind: Kind of conditioning, the filter of a network's wrench.
    """
    return Path("replayed") / f"conditioning-{kind}.parquet"


def summarise(runs: Sequence[Run], folder: Path, made: Collection[Path]) -> dict[str, pl.DataFrame]:
    """Write metrics tables of the given networks into the folder of a study, and return them by name.

    Args:
        runs: Networks whose errors are complete.
        folder: Folder of the study.
        made: Files that this study has written; shared tables of an earlier study are not used.

    Returns:
        Always `evaluation`, errors of the predicted wrench, and `errors`, those of the replay: means over
        seeds, with the smallest and the largest value as `low` and `high`.  Where there are data, `minutes`,
        the same by length of the training data; `conditioning`, replay errors of the first seed under each
        kind of conditioning; and `ranking`, Kendall's tau of the rankings of the models by the two errors.
    """
    import polars as pl

    from hydro.io import table
    from hydro.report.seeds import behind_the_best, by_minutes, ranking, seeds_together
    from hydro.report.tables import PIECE_SUFFIX

    def errors(kind: str, some: Sequence[Run]) -> pl.DataFrame:
        return pl.concat(
            table.read(folder / kind / f"{run.name}.parquet", "metrics").frame.with_columns(
                run=pl.lit(run.label), minutes=pl.lit(run.minutes, pl.Float64)
            )
            for run in some
        )

    whole = [run for run in runs if run.minutes is None]
    predicted, replayed = errors("evaluated", whole), errors("replayed", whole)
    beside = table.read(folder / SIDE_BY_SIDE, "metrics").frame
    baselines = [beside.filter(~pl.col("variant").is_in(replayed["variant"].unique().to_list()))]
    if folder / EFFECTS in made:
        baselines.append(table.read(folder / EFFECTS, "metrics").frame)
    found = {
        "evaluation": seeds_together(predicted),
        "errors": pl.concat([*baselines, seeds_together(replayed)]),
    }
    if not (ranks := ranking(predicted, replayed)).is_empty():
        found["ranking"] = ranks
    if len(runs) > len(whole):
        parts = [run for run in runs if run.minutes is not None]
        offline, flown = errors("evaluated", parts), errors("replayed", parts)
        means = [seeds_together(by_minutes(some)) for some in (offline, flown)]
        found["minutes"] = pl.concat([*means, behind_the_best(flown)])
    if kinds := [kind for kind in CONDITIONINGS if folder / conditioned(kind) in made]:
        of_kinds = [(kind, table.read(folder / conditioned(kind), "metrics").frame) for kind in kinds]
        learnt = pl.col("variant").is_in(replayed["variant"].unique().to_list())
        whole_flight = ~pl.col("dataset").str.contains(PIECE_SUFFIX)
        found["conditioning"] = pl.concat(
            frame.filter(learnt, whole_flight).with_columns(dataset=pl.lit(kind))
            for kind, frame in (("off", beside), *of_kinds)
        )
    for name in {"ranking", "minutes", "conditioning"} - found.keys():  # of an earlier study of this folder
        (folder / f"{name}.parquet").unlink(missing_ok=True)
    for name, frame in found.items():
        table.write(
            table.make("metrics", frame, stage="study", parameters={"part": name}), folder / f"{name}.parquet"
        )
    return found
