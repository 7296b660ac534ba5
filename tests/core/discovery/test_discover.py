"""Laws that the catalogue has not are found from recordings, and none where none is."""

from __future__ import annotations

import msgspec
import numpy as np
import polars as pl
import pytest

from hydro.core.columns import POSE, VELOCITY
from hydro.core.diagnosis.findings import Diagnosis, Finding, tables
from hydro.core.diagnosis.log_faults import preprocess
from hydro.core.diagnosis.pipeline import diagnose_log
from hydro.core.discovery.discover import discovered
from hydro.core.effects import CATALOGUE
from hydro.core.effects.formula import joined, one_term
from hydro.core.errors import DataError
from hydro.core.explanation.explain import explain
from hydro.core.simulation.sensor_noise import PROFILES, disturb
from hydro.core.simulation.simulate import simulate
from hydro.io import vehicle as files

LAW = joined([one_term("N |v|^n sgn(v)", 60.0, [2.4]), one_term("Z u q", 90.0)])
ROWS = 500  # of each of two sessions, 20 s at 50 Hz in all


@pytest.fixture(scope="module")
def known(datasets):
    return files.read(datasets / "vehicles" / "auv151.toml")[0]


def flown(vehicle, seed, rows=ROWS):
    """One session: two sines of their own on each thruster, and ordinary noise of the sensors."""
    rng, t = np.random.default_rng(seed), np.arange(rows) * 0.02
    columns = {"session": [f"s{seed}"] * rows, "t": t} | {name: np.zeros(rows) for name in (*POSE, *VELOCITY)}
    for i in range(8):
        fast, slow = rng.uniform(0.1, 0.4), rng.uniform(0.01, 0.05)
        wave = 0.4 * np.sin(2 * np.pi * (fast * t + rng.uniform())) + 0.3 * np.sin(
            2 * np.pi * (slow * t + rng.uniform())
        )
        columns[f"cmd_{i + 1}"] = wave
    motion = simulate(vehicle, pl.DataFrame(columns | {"z": np.full(rows, 10.0)}))
    noisy = disturb(motion.select(*POSE, *VELOCITY).to_numpy(), PROFILES["ordinary"], rng)
    return motion.with_columns(pl.DataFrame(noisy, schema=[*POSE, *VELOCITY]))


@pytest.fixture(scope="module")
def recording(known):
    hidden = msgspec.structs.replace(known, effect=(*known.effect, LAW))
    return pl.concat([flown(hidden, seed) for seed in (0, 1)])


@pytest.fixture(scope="module")
def explained(known, recording):
    """Steps of an explanation, and what each diagnosis with its discovery found."""
    heard, diagnoses = [], []

    def beyond(vehicle, log, diagnosis, _):
        diagnoses.append(
            discovered(vehicle, log, diagnosis, lambda words, share: heard.append((words, share)))
        )
        return diagnoses[-1]

    steps = list(explain(known, recording, beyond=beyond))
    assert heard
    assert all(0.0 <= share <= 1.0 for _, share in heard)
    return steps, diagnoses


@pytest.fixture(scope="module")
def found(explained):
    return explained[1][0]


def test_a_law_of_two_terms_is_found_with_its_power_and_values(found):
    (formula,) = (one for one in found.findings if one.effect == "formula")
    assert (formula.verdict, formula.parameters["forces"], formula.parameters["moments"]) == (
        "suspect",
        ["Z u q"],
        ["N |v|^n sgn(v)"],
    )
    truth = CATALOGUE["formula"].pack(LAW, thrusters=8)
    values = CATALOGUE["formula"].pack(dict(formula.parameters), thrusters=8)
    errors = np.array(
        [
            *formula.standard_errors["force"],
            *formula.standard_errors["moment"],
            *formula.standard_errors["exponents"],
        ]
    )
    assert (np.abs(values - truth)[-3:] < 4.5 * errors).all()
    assert formula.share > 0.9
    assert found.chi2[2] == pytest.approx(1.0, abs=0.1)
    assert "sway causes a moment in yaw that grows as |v|^2.4" in formula.advice
    assert "a force in heave is proportional to u q" in formula.advice


def test_forces_that_were_named_for_it_are_no_more_than_suspects(found):
    forces = [one for one in found.findings if one.effect and CATALOGUE[one.effect].kind == "wrench"]
    assert not [one for one in forces if one.verdict == "missing"]


def test_a_diagnosis_takes_the_formula_to_add_by_its_name(found):
    frame = found.frame()
    with pytest.raises(DataError, match="formula"):
        tables(frame)
    (table,) = tables(frame, ["formula"])
    assert table["moments"] == ["N |v|^n sgn(v)"]
    assert {entry.effect for entry in found.estimates.entries} >= {"formula"}


def test_a_force_that_obeys_a_command_is_found(known):
    """As of a fin: a command, and the square of the speed ahead."""
    law = one_term("N |u|^n c2", 25.0, [2.0])
    hidden = msgspec.structs.replace(known, effect=(*known.effect, law))
    log = preprocess(known, pl.concat([flown(hidden, seed) for seed in (0, 1)]))
    nothing = Diagnosis((Finding("far_from_noise"),), known, (9.0, 9.0, 9.0))
    found = discovered(known, log, nothing)
    (formula,) = (one for one in found.findings if one.effect == "formula")
    assert formula.parameters["moments"] == ["N |u|^n c2"]
    assert formula.parameters["moment"] == pytest.approx([25.0], rel=0.1)
    assert formula.parameters["exponents"] == pytest.approx([2.0], abs=0.3)
    assert "command c2 causes a moment in yaw that grows as |u|^" in formula.advice


def test_nothing_is_discovered_where_nothing_is_missing(known):
    log = preprocess(known, pl.concat([flown(known, seed) for seed in (0, 1)]))
    plain = diagnose_log(known, log)
    assert discovered(known, log, plain) is plain


def test_what_no_term_explains_stays_unexplained(known):
    """Excess error that is noise of the forces, from a swell that nothing in the motion tells of."""
    raw = pl.concat([flown(known, seed, rows=1100) for seed in (0, 1)])
    rng = np.random.default_rng(5)
    jitter = np.cumsum(rng.normal(0.0, 0.01, (raw.height, 6)), axis=0)
    shaken = raw.with_columns(**{name: pl.col(name) + jitter[:, i] * 0.3 for i, name in enumerate(VELOCITY)})
    log = preprocess(known, shaken)
    nothing = Diagnosis((Finding("far_from_noise"),), known, (9.0, 9.0, 9.0))
    assert not [one for one in discovered(known, log, nothing).findings if one.effect == "formula"]


def test_explain_adds_the_formula_as_a_step(explained):
    steps, _ = explained
    assert steps[1].added == ("formula",)
    assert steps[-1].chi2[2] == pytest.approx(1.0, abs=0.1)
    assert steps[1].error("fit") < 0.5 * steps[0].error("fit")


def test_a_file_with_a_formula_gets_further_terms(known, recording):
    """The half that the file has stays, and the other half joins it."""
    given = msgspec.structs.replace(known, effect=(*known.effect, one_term("Z u q", 90.0)))
    log = preprocess(given, recording)
    nothing = Diagnosis((Finding("far_from_noise"),), given, (9.0, 9.0, 9.0))
    found = discovered(given, log, nothing)
    (formula,) = (one for one in found.findings if one.effect == "formula" and one.verdict == "suspect")
    assert (formula.parameters["forces"], formula.parameters["moments"]) == (["Z u q"], ["N |v|^n sgn(v)"])
