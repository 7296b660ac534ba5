"""Null p-values: uniform ones pass, skewed ones fail, and logs are screened as a diagnosis screens them."""

from __future__ import annotations

import numpy as np
import polars as pl
import pytest
from scipy.stats import kurtosis

from benchmarks import null_p_values as nulls
from benchmarks.work import Results
from hydro.core.columns import POSE, VELOCITY
from hydro.core.evaluation.score_test import FLIPS

STEPS, LOGS = FLIPS + 1, 60
GROUPS = ("payload", "tether", "added_mass", "body_lift", "fluid_memory")


def results(skewed: str = "", power: float = 3.0) -> pl.DataFrame:
    """Logs of one condition whose p-values are spread evenly in an order of each group's own.

    Those of one group may be raised to a power: too many small ones.
    """
    rng, rows = np.random.default_rng(2), []
    even = (np.arange(LOGS) + 0.5) / LOGS
    p = {name: rng.permutation(even) for name in ("overall", *GROUPS)}
    for log in range(LOGS):
        for name in GROUPS:
            value = p[name][log] ** (power if name == skewed else 1.0)
            rows.append(
                dict.fromkeys(nulls.SCHEMA)
                | {"seed": log, "noise": nulls.WHITE, "seconds": 120.0, "group": name, "failure": ""}
                | {"p_value": np.ceil(STEPS * value) / STEPS, "overall": p["overall"][log]}
            )
    return pl.DataFrame(rows, schema=nulls.SCHEMA)


def test_uniform_p_values_pass():
    each = nulls.groups(results())
    assert each["uniform_adjusted"].min() > 0.99
    assert each["rare_adjusted"].min() > 0.99
    assert each["at_alpha"].to_list() == [1] * len(GROUPS)
    (row,) = nulls.sums(results())
    assert row["logs"] == LOGS
    assert row["groups"] == len(GROUPS)
    assert row["groups at or below 0.05"] == "none"
    assert row["all at once <= 0.01"].endswith(f"(1 of {LOGS})")


@pytest.mark.parametrize("power", [3.0, 1.0 / 3.0])
def test_a_skewed_group_fails_and_only_it(power):
    each = nulls.groups(results("tether", power))
    assert each["group"][0] == "tether"
    assert each["uniform_adjusted"][0] < 1e-3
    assert each["uniform_adjusted"][1:].min() > 0.99
    (row,) = nulls.sums(results("tether", power))
    assert row["groups at or below 0.05"] == "tether"
    # p^3 <= 0.01 for 12 of the 60 quantiles, p^(1/3) for none
    assert each["at_alpha"][0] == (13 if power > 1.0 else 0)
    assert (each["rare_adjusted"][0] < 1e-6) == (power > 1.0)


def test_p_values_of_flips_that_fill_their_grid_are_uniform():
    whole = np.arange(1, STEPS + 1) / STEPS
    assert nulls.uniform(whole) == pytest.approx(1.0)
    assert nulls.uniform(np.full(200, 1.0 / STEPS)) < 1e-6


def test_rare_is_the_binomial_tail():
    p = np.array([0.005, 0.5])
    assert nulls.rare(p) == pytest.approx(1.0 - 0.99**2)
    assert nulls.rare(np.array([0.02, 0.5])) == pytest.approx(1.0)


def test_holm_steps_down():
    """The example of Holm's procedure with four hypotheses: 0.005, 0.01, 0.03 and 0.04."""
    np.testing.assert_allclose(nulls.holm(np.array([0.01, 0.04, 0.03, 0.005])), [0.03, 0.06, 0.06, 0.02])
    np.testing.assert_allclose(nulls.holm(np.array([0.9, 0.8])), [1.0, 1.0])


def test_the_summary_names_failed_logs_and_leaves_them_out():
    failed = dict.fromkeys(nulls.SCHEMA) | {"seed": 999, "noise": nulls.WHITE, "seconds": 120.0}
    table = pl.concat([results(), pl.DataFrame([failed | {"failure": "Diverges"}], schema=nulls.SCHEMA)])
    text = nulls.summary(table)
    assert "999, white: Diverges" in text
    assert f"| white, 120 s | {LOGS} |" in text


@pytest.mark.parametrize("noise", nulls.NOISES)
def test_both_noises_have_the_variance_of_the_profile_and_their_own_tails(noise):
    rows = 40_000
    quiet = pl.DataFrame(
        {"t": np.arange(rows) * 0.02} | {name: np.zeros(rows) for name in (*POSE, *VELOCITY)}
    )
    errors = nulls.written(quiet, noise, 2.0, np.random.default_rng(4)).select(*POSE, *VELOCITY).to_numpy()
    expected = np.repeat([0.04, 0.002, 0.02, 0.004], 3)
    np.testing.assert_allclose(errors.std(axis=0), expected, rtol=0.15 if noise == nulls.HEAVY else 0.02)
    assert (kurtosis(errors, axis=0) > 3.0).all() == (noise == nulls.HEAVY)


def test_logs_are_screened_by_every_effect_that_the_file_lacks(tmp_path):
    rows = nulls.run_one(90_061, 48.0, nulls.NOISES)
    assert {row["noise"] for row in rows} == set(nulls.NOISES)
    assert not any(row["failure"] for row in rows)
    results = Results(tmp_path / "rows.parquet", nulls.SCHEMA)
    results.add(*rows)
    again = Results(tmp_path / "rows.parquet", nulls.SCHEMA).table
    assert again.height == len(rows)
    for _, part in nulls.conditions(again):
        assert part["group"].is_unique().all()
        assert {"ocean_current", "thruster_lag"} <= set(part["group"])
        assert part["p_value"].is_between(1.0 / STEPS, 1.0).all()
        # Over all groups at once p is no smaller than that of the most striking one alone would be by much.
        assert part["overall"].n_unique() == 1
        assert part["chi2"][0] < 1.5


def test_a_log_that_cannot_be_screened_is_a_row():
    rows = nulls.run_one(90_061, 2.0, (nulls.WHITE,))
    assert len(rows) == 1
    assert rows[0]["failure"]
    assert rows[0]["group"] is None
