"""Errors of a study on the page: every network by its own name, whole flights apart from their pieces."""

from __future__ import annotations

import polars as pl
import pytest

from hydro.io import table
from hydro.report import seeds
from hydro.report.charts import Charts
from hydro.report.errors import section
from hydro.report.sources import Named, Sources
from hydro.report.standing import headline


def row(model: str, axis: str, value: float, **other: object) -> dict[str, object]:
    unit = {"u": "m/s", "X": "N"}.get(
        axis, "m/s, rad/s" if other.get("variant", "").startswith("M") else "N, N m"
    )
    usual = {
        "variant": "",
        "dataset": "d",
        "metric": "rmse",
        "low": 0.9 * value,
        "high": 1.1 * value,
        "unit": unit,
    }
    return {"model": model, "axis": axis, "value": value} | usual | other


def of_study(part: str, *rows: dict[str, object]) -> Named:
    frame = pl.DataFrame(rows)
    return Named(f"{part}.parquet", table.make("metrics", frame, stage="study", parameters={"part": part}))


EVALUATED = of_study(
    "evaluation",
    *(
        row(model, axis, value * (1.0 if regime == "" else 7.0), variant=regime)
        for model, value in (("mlp", 2.0), ("physfeat", 1.0))
        for axis in ("X", "all")
        for regime in ("", "speed 0-1 m/s")
    ),
    *(row(model, "all", 0.5, metric="mae") for model in ("mlp", "physfeat")),
    *(row(model, "mean", 0.999, metric="r2", unit="1") for model in ("mlp", "physfeat")),
)
FLOWN = of_study(
    "errors",
    *(
        row(variant, axis, value * (1.0 if data == "d" else 9.0), variant=variant, dataset=data)
        for variant, value in (("MJ0", 3.0), ("MJ1", 0.003), ("MJ4", 0.004))
        for axis in ("u", "all")
        for data in ("d", "d 0-10 s")
    ),
)


def test_networks_have_a_row_each_and_regimes_and_pieces_unfold() -> None:
    predicted, flown = (section(one, 0, Charts()) for one in (EVALUATED, FLOWN))
    assert predicted["table"]["rows"] == [
        [("mlp", ""), ("2.00", "1.8 to 2.2"), ("2.00", "1.8 to 2.2"), ("0.500", ""), ("0.9990", "")],
        [
            ("physfeat", ""),
            ("1.00", "0.90 to 1.1"),
            ("1.00", "0.90 to 1.1"),
            ("0.500", ""),
            ("0.9990", ""),
        ],
    ]
    assert predicted["more"][0]["rows"] == [[("speed 0-1 m/s", ""), ("14.0", ""), ("7.00", "")]]
    assert [cells[0][0] for cells in flown["table"]["rows"]] == ["MJ0", "MJ1", "MJ4"]
    assert flown["table"]["rows"][1][1] == ("0.00300", "0.0027 to 0.0033")
    assert [cells[:3] for cells in flown["more"][0]["rows"]][1] == [
        ("0-10 s", ""),
        ("MJ1", ""),
        ("0.0270", ""),
    ]


def test_the_headline_names_the_best_of_all_networks() -> None:
    told = headline(Sources(metrics=(EVALUATED, FLOWN)))
    assert "physfeat predicts the wrench best, to 1.00 over all six axes" in told
    assert "MJ1 replays best, to 0.00300 m/s and rad/s" in told


def by_length(value: float, model: str, run: str, variant: str = "") -> dict[str, object]:
    return row(model, "all", value, variant=variant) | {"run": run, "minutes": 3.0}


def test_errors_with_less_data_are_listed_by_length_and_model() -> None:
    runs = [f"seed {k}" for k in range(3)]
    offline = pl.DataFrame(by_length(1.0 + k, model, run) for k, model in enumerate("ab") for run in runs)
    flown = pl.DataFrame(
        by_length(1.0 + k + 0.1 * i, model, run, f"M{model}")
        for k, model in enumerate("ab")
        for i, run in enumerate(runs)
    )
    means = [seeds.seeds_together(seeds.by_minutes(errors)) for errors in (offline, flown)]
    told = seeds.minutes_table(pl.concat([*means, seeds.behind_the_best(flown)]))
    assert told.select("minutes", "model", "wrench", "replay").rows() == [
        (3.0, "a", 1.0, pytest.approx(1.1)),
        (3.0, "b", 2.0, pytest.approx(2.1)),
    ]
    assert told["p"].to_list() == [None, pytest.approx(1 / 20)]


def test_conditioning_is_one_row_per_variant() -> None:
    rows = [
        row("mlp", "all", 0.1 * k, variant="MJ1", dataset=kind) for k, kind in enumerate(("off", "paper-old"))
    ]
    lost = row("moe", "all", 12.0, variant="moe", dataset="off", metric="diverged")
    found = seeds.conditioning_table(pl.DataFrame([*rows, lost]))
    assert found.rows() == [("MJ1", 0.0, 0.1), ("moe", None, None)]
    section(of_study("conditioning", *rows), 0, Charts())
