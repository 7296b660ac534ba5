"""What a recording leaves open, in words: from made-up covariances, and from thrusters that never ran."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from recordings import damped, moved, noisy

from hydro.core.diagnosis import identifiability
from hydro.core.diagnosis.identifiability import undetermined, unseen
from hydro.core.diagnosis.model import Model
from hydro.core.effects import CATALOGUE
from hydro.core.errors import DataError
from hydro.core.evaluation.score_test import Evidence
from hydro.core.identification.suspects import suspects
from hydro.core.prediction import multiple_shooting, sensitivity
from hydro.core.prediction.candidate import candidate
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free
from hydro.core.recording.arrays import recording
from hydro.core.recording.shots import make_shots


def entries(effect: str):
    return free(damped(), [effect]).entries


def told(effect: str, open_: list[int]) -> tuple[str, ...] | None:
    found = entries(effect)
    errors = np.full(len(found), 0.01)
    errors[open_] = 10.0
    return undetermined(found, np.diag(errors**2)).get(effect.split(".")[0])


@pytest.mark.parametrize(
    ("effect", "open_", "words"),
    [
        ("thruster_gain", [4, 5, 6, 7], ("thrusters 5-8",)),
        ("thruster_gain", [0, 4, 5, 7], ("thrusters 1, 5-6, 8",)),
        ("thruster_gain", [2], ("thruster 3",)),
        ("quadratic_damping", [1, 5], ("sway", "yaw")),
        ("linear_damping.matrix", [0, 11], ("surge", "sway from yaw")),
        ("ocean_current", [2], ("v_D",)),
        ("sensor_lever_arm", [0, 1], ("forward", "to starboard")),
        ("sensor_misalignment", [0], ("roll",)),
        ("fluid_memory", [0, 6], ("surge (rate 1)", "rates 1")),
        ("tether", [2, 7], ("attachment forward", "anchor down")),
        ("quadratic_damping", [], None),
        ("quadratic_damping", [0, 1, 2, 3, 4, 5], None),
    ],
)
def test_undetermined_entries_are_named_in_words(effect, open_, words):
    assert told(effect, open_) == words


@pytest.mark.parametrize(
    "name", [name for name, effect in CATALOGUE.items() if not (effect.is_written or effect.is_random)]
)
def test_every_entry_of_the_catalogue_has_distinct_words(name):
    found = entries(name)
    words = [told(name, [i]) for i in range(len(found))]
    assert len(found) == 1 or len({one[0] for one in words}) == len(found)


def test_thrusters_of_which_only_the_sum_is_known_are_reported():
    found = entries("thruster_gain")
    covariance = 0.01**2 * np.eye(8)
    covariance[4:, 4:] = 25.0 * (np.eye(4) - 0.25) + 0.01**2
    assert undetermined(found, covariance) == {"thruster_gain": ("thrusters 5-8 (one from another)",)}


def verdicts_of(
    model: Model, ranked: dict[str, Any], known: Any = (), found: Any = (), fit: Any = None
) -> dict[str, str]:
    """Return the verdicts on candidates of which the recording shows nothing, by effect."""
    evidence = SimpleNamespace(covariance=lambda own, columns, chi2: 1e6 * np.eye(len(columns)))
    last = SimpleNamespace(ranked=ranked, evidence=evidence, own=[])
    baseline = SimpleNamespace(log=SimpleNamespace(track=None, noise=None, middle=None), effects=known)
    outcome = SimpleNamespace(model=model, last=last, effects=found, fit=fit)
    return {one.effect: one.verdict for one in unseen(cast(Any, baseline), cast(Any, outcome))}


def test_an_alias_is_not_separable_instead_of_not_excited(monkeypatch):
    """The recording says nothing of either effect; the payload is what the model has by other names."""
    vehicle = damped(
        {"name": "net_buoyancy", "dB": 3.0}, {"name": "buoyancy_offset", "dx": 0.01, "dy": 0.0, "dz": 0.0}
    )
    known = ["net_buoyancy", "buoyancy_offset"]
    unknown = free(vehicle, known)
    model = Model(unknown, 1.1 * unknown.starts[0], None, cast(Any, SimpleNamespace(chi2=1.0)))
    ranked = {"payload": (0.0, range(4)), "surface_suction": (0.0, range(1))}

    def diverges(*_, **__):
        raise DataError("every manoeuvre diverges")

    monkeypatch.setattr(identifiability, "showing", diverges)
    told = verdicts_of(model, ranked, known)
    assert told == {"payload": "not_separable", "surface_suction": "not_excited"}


@pytest.mark.parametrize(("mass", "verdict"), [(1e-5, "not_separable"), (0.1, "not_excited")])
def test_a_mass_within_its_error_does_not_hide_an_alias(monkeypatch, mass, verdict):
    """A payload whose mass is zero within its error equals a net buoyancy and a moved centre."""
    vehicle = damped({"name": "payload", "w": 5.0, "x": 0.2, "y": 0.1, "z": 0.3, "mass": mass})
    unknown = free(vehicle, ["payload"])
    model = Model(unknown, unknown.starts[0], None, cast(Any, SimpleNamespace(chi2=1.0)))
    ranked = {"net_buoyancy": (0.0, range(1)), "buoyancy_offset": (0.0, range(3))}
    monkeypatch.setattr(identifiability, "showing", lambda *_, **__: {})
    fit = SimpleNamespace(standard_errors=np.full(5, 0.001))
    assert verdicts_of(model, ranked, found=["payload"], fit=fit) == dict.fromkeys(ranked, verdict)


def gains(raw):
    """Covariance of the gains of all thrusters beside nothing else, from shots over a recording."""
    vehicle = damped()
    shots = make_shots(recording(vehicle, raw))
    (suspect,) = (one for one in suspects(vehicle) if one.effect == "thruster_gain")
    own = multiple_shooting.prepare(candidate(vehicle), shots)
    changed = [multiple_shooting.prepare(candidate(one), shots) for one in suspect.changed]
    normal = sensitivity.linearise(own, changed, suspect.steps, shots)
    return undetermined(entries("thruster_gain"), Evidence.of(normal).covariance([], range(8), normal.chi2))


def test_thrusters_that_never_ran_are_not_determined():
    assert gains(noisy(moved(damped(), rows=1500, thrusters=range(4)), 0)) == {
        "thruster_gain": ("thrusters 5-8",)
    }


def test_thrusters_that_all_ran_are_determined():
    assert gains(noisy(moved(damped(), rows=1500), 0)) == {}


def test_the_covariance_of_a_group_equals_that_of_least_squares():
    columns = np.random.default_rng(0).standard_normal((30, 40, 6)) * [1.0, 10.0, 0.1, 1.0, 3.0, 1.0]
    gram = columns.transpose(0, 2, 1) @ columns
    evidence = Evidence.of(Normal(gram, 40, gram[:, -1:, -1], np.zeros((30, 0, 6))))
    chosen = columns[..., [0, 1, 2, 4]].reshape(-1, 4)
    expected = 3.0 * np.linalg.inv(chosen.T @ chosen)[2:, 2:]
    np.testing.assert_allclose(evidence.covariance([0, 1], [2, 4], 3.0), expected, rtol=1e-6, atol=1e-9)
