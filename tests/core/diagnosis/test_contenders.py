"""Which of the effects that were fitted to a change is named, and how surely."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recordings import damped

from hydro.core.diagnosis import contenders
from hydro.core.diagnosis.by_change import ByChange, Change, Changes
from hydro.core.diagnosis.confidence import left_out_costs
from hydro.core.diagnosis.contenders import Contender, Contest
from hydro.core.diagnosis.model import Model, passive
from hydro.core.diagnosis.settings import FIT, NEARLY_EQUAL, NEGLIGIBLE, QUICK_STEPS, RIGHT, SURE
from hydro.core.effects import CATALOGUE
from hydro.core.identification.levenberg_marquardt import ITERATIONS
from hydro.core.identification.passivity import accepted
from hydro.core.prediction.normal_equations import Normal
from hydro.core.prediction.parameters import free

SHOTS = 40
NAMES = st.sampled_from(sorted(CATALOGUE))
FLOORS = st.floats(0.1, 100.0)
ABSORBING = sorted(name for name, effect in CATALOGUE.items() if effect.identification.absorbs > 0.0)
PLAIN = sorted(set(CATALOGUE) - set(ABSORBING))


def rival(effect: str, left: float, parameters: int) -> Contender:
    """One that leaves so many floors, the same of each shot."""
    model = cast(Any, SimpleNamespace(values=np.zeros(parameters)))
    return Contender(effect, model, np.full(SHOTS, left / SHOTS))


def change(rivals: list[Contender], whole: float) -> Change:
    """The best of rivals where nothing would leave so many floors, of which there is one."""
    last = SimpleNamespace(normal=SimpleNamespace(of=lambda _: None))
    compared = SimpleNamespace(left_out=lambda _: np.full(SHOTS, whole / SHOTS), floor=lambda _: 1.0)
    found = Change.of(cast(Any, compared), cast(Any, last), {one.effect: one for one in rivals})
    assert found is not None
    return found


@given(NAMES, st.floats(0.0, 1.0), st.integers(1, 6), st.integers(1, 6), FLOORS)
def test_a_further_parameter_must_reduce_the_residual_to_win(name, share, fewer, more, whole):
    """Data left out do not tell a larger effect from a smaller one where a hull's error is alike on all."""
    other = next(one for one in sorted(CATALOGUE) if one != name and _absorbs(one) == _absorbs(name))
    few, many = rival(name, share * whole, fewer), rival(other, share * whole, fewer + more)
    found = change([many, few], whole)
    assert found.best.effect == name
    assert found.wins == {name: 1.0, other: 0.0}
    better = rival(other, (share - 1.1 * NEGLIGIBLE * more) * whole, fewer + more)
    assert change([few, better], whole).best.effect == other


@given(st.sampled_from(ABSORBING), st.sampled_from(PLAIN), st.floats(0.0, 1.0), st.integers(1, 6), FLOORS)
def test_a_drag_formula_must_reduce_the_residual_more_than_a_weight_to_win(
    drag, other, share, parameters, whole
):
    """A formula of drag fits the error of a law of drag; weight and thrust do not."""
    both = [rival(drag, share * whole, parameters), rival(other, share * whole, parameters)]
    assert change(both, whole).best.effect == other
    much = rival(drag, share * whole - 0.1, parameters)
    assert change([much, both[1]], whole).best.effect == drag


@given(FLOORS, st.floats(0.0, 0.5), st.integers(1, 6), st.integers(1, 6), st.floats(10.0, 1000.0))
def test_a_parameter_costs_a_share_of_the_error_that_the_best_rival_leaves(left, gain, fewer, more, times):
    """The rest of the residual is due to the change, however large it was."""
    few, many = rival("net_buoyancy", left, fewer), rival("payload", (1.0 - gain) * left, fewer + more)
    found = change([few, many], times * max(left, FIT))
    at_stake = max((1.0 - gain) * left, FIT)
    assert (found.best is many) is (gain * left > NEGLIGIBLE * more * at_stake)


FAR = {"name": "tether", "k": 0.1, "attachment": [0.2, 0.1, 0.0], "anchor": [0.0, 0.0, 80.0]}
"""A tether whose pull is that of a weight at the attachment,"""
WEIGHT = {"name": "payload", "w": 8.0, "x": 0.2, "y": 0.1, "z": 0.0, "mass": 1.0}
"""and the weight."""


def fitted(table: dict[str, Any], count: int, costs: np.ndarray) -> Contender:
    """A fit of so many values, with the cost of each shot."""
    model = cast(Any, SimpleNamespace(values=np.zeros(count), vehicle=damped(table)))
    return Contender(table["name"], model, costs)


def tether(costs: np.ndarray) -> Contender:
    return fitted(FAR, 8, costs)


def payload(costs: np.ndarray) -> Contender:
    return fitted(WEIGHT, 5, costs)


def kept(*fits: Contender) -> list[str]:
    """The effects that stay of these fits when needless ones go; nothing explains 50 floors."""
    compared = SimpleNamespace(floor=lambda _: float(SHOTS), cost=lambda _: 50.0 * SHOTS)
    last = SimpleNamespace(normal=SimpleNamespace(of=lambda _: None), vehicle=damped())
    contest = Contest(cast(Any, compared), cast(Any, last))
    return sorted(contest.with_plainer({one.effect: one for one in fits}))


@pytest.mark.parametrize(("off", "names"), [(0.1, ["payload"]), (0.5, ["payload", "tether"])])
def test_a_tether_with_a_far_anchor_below_must_be_distinct_from_a_payload(monkeypatch, off, names):
    noise = np.random.default_rng(0).normal(scale=0.5, size=SHOTS)

    def join(contest: Contest, fits: dict[str, Contender], table: Any) -> None:
        assert table == {"name": "payload", "w": pytest.approx(8.0), "x": 0.2, "y": 0.1, "z": 0.0}
        fits["payload"] = payload(1.0 + off + noise - noise.mean())

    monkeypatch.setattr(Contest, "_join", join)
    assert kept(tether(np.ones(SHOTS))) == names


@pytest.mark.parametrize(("off", "names"), [(0.0, ["payload"]), (-0.01, ["payload", "tether"])])
def test_a_tether_that_fits_no_better_is_no_rival_of_a_payload(monkeypatch, off, names):
    """Otherwise the same force under another name lowers the confidence in the payload."""
    monkeypatch.setattr(Contest, "_join", lambda *_: None)
    assert kept(payload(np.ones(SHOTS)), tether(np.full(SHOTS, 1.0 + off))) == names


@pytest.mark.parametrize(
    ("x", "share", "names"),
    [
        (20.0, 1.1 * NEARLY_EQUAL, ["buoyancy_offset"]),
        (20.0, 0.9 * NEARLY_EQUAL, ["buoyancy_offset", "payload"]),
        (0.2, 1.1 * NEARLY_EQUAL, ["buoyancy_offset", "payload"]),
    ],
)
def test_a_payload_beyond_the_hull_gives_way_to_the_moment_that_it_exerts(monkeypatch, x, share, names):
    """A shifted centre of buoyancy that removes most of the error is possible, such a payload is not."""
    shifted = {"name": "buoyancy_offset", "dx": 0.01, "dy": 0.0, "dz": 0.0}
    monkeypatch.setattr(Contest, "_join", lambda *_: None)
    monkeypatch.setattr(contenders, "plainer", lambda vehicle, name, file: [shifted] * (name == "payload"))
    beyond = fitted(WEIGHT | {"w": 0.1, "x": x}, 5, np.ones(SHOTS))
    left = 50.0 - share * 49.0 + 0.01 * np.arange(SHOTS)
    assert kept(beyond, fitted(shifted, 3, left)) == names


def pair(left: float, ahead: float, whole: float) -> Change:
    """A best that leaves so many floors, and a next as large that leaves some more."""
    return change([rival("net_buoyancy", left, 1), rival("command_delay", left + ahead, 1)], whole)


@given(st.floats(0.1, 20.0), st.floats(0.0, 20.0), st.floats(0.0, 20.0), st.floats(1.0, 100.0))
def test_confidence_grows_with_the_margin(left, ahead, more, further):
    """It is a probability; of two names that leave as much, the one farther ahead is the surer."""
    whole = left + ahead + more + 1.0
    near, far = pair(left, ahead, whole), pair(left, ahead + more, whole)
    assert 0.0 <= near.confidence(whole) <= far.confidence(whole) <= 1.0
    assert near.confidence(whole * further) <= near.confidence(whole)


@given(st.floats(0.1, 20.0), st.floats(0.01, 5.0))
def test_confidence_is_continuous_in_the_remaining_residual(left, ahead):
    """No limit is passed at which confidence jumps."""
    whole = left + 2.0 * ahead + 1.0
    here, there = (pair(one, ahead, whole).confidence(whole) for one in (left, left + 1e-4))
    assert abs(there - here) < 0.01


@pytest.mark.parametrize(("left", "sure"), [(0.9, True), (1.9, False)])
def test_a_candidate_with_a_large_residual_needs_a_lead_to_be_stated(left, sure):
    """Where it leaves more than a model that is right, another that leaves almost as much could be it."""
    assert (pair(left, 0.3, 10.0).confidence(10.0) > SURE) is sure
    assert pair(left, 5.0, 10.0).confidence(10.0) > SURE


def test_laws_of_drag_that_fit_as_well_are_one_change_together():
    """Neither law of drag is sure; a current is out of question."""
    laws = [rival("linear_damping", 1.0, 3), rival("quadratic_damping", 1.01, 3)]
    found = change([*laws, rival("cross_axis_drag", 1.1, 3), rival("ocean_current", 1.6, 3)], 1.8)
    tied, together = found.tied(1.8)
    assert tied == ("linear_damping", "quadratic_damping")
    assert found.confidence(1.8) < 0.6 < SURE < together
    apart = change([laws[0], rival("thruster_gain", 1.01, 3)], 1.8)
    assert apart.tied(1.8) == (("linear_damping",), apart.confidence(1.8))


def test_a_candidate_no_better_than_no_change_has_confidence_0():
    assert pair(1.0, 0.5, 1.001).confidence(1.001) == 0.0


def test_a_candidate_has_values_that_a_passive_hull_can_have():
    """Without added mass in roll, sway and roll cannot be coupled; without the coupling nothing is gained."""
    added = {"name": "added_mass", "diagonal": [5.0] * 3 + [0.0] * 3}
    vehicle = msgspec.structs.replace(damped(), effect=(added,))
    unknown = free(vehicle, ["added_mass_coupling"])
    values = np.array([2.0 * (entry.parameter == "M13") for entry in unknown.entries])

    def linear(vehicle, changed, steps):
        gram = np.tile(np.eye(len(changed) + 1), (SHOTS, 1, 1))
        return Normal(gram, 50, gram[:, -1:, -1], np.zeros((SHOTS, 0, len(changed) + 1)))

    problem = cast(Any, SimpleNamespace(linearise=linear))
    wild = Model(unknown, values, problem, linear(vehicle, values, values))
    assert not accepted(unknown, values)
    assert passive(wild).values == pytest.approx(np.zeros(5), abs=1e-3)
    still = replace(wild, values=np.zeros(5))
    assert passive(still) is still


@pytest.mark.parametrize(
    ("error", "left", "fitted"),
    [
        (0.9 * FIT, 0.9 * RIGHT, ["payload"]),
        (0.9 * FIT, 1.1 * RIGHT, ["payload", "added_mass"]),
        (1.1 * FIT, 0.9 * RIGHT, ["added_mass"]),
        (1.1 * FIT, 1.1 * RIGHT, ["added_mass", "payload"]),
    ],
)
def test_large_changes_are_sought_on_the_first_parts_of_shots_first(monkeypatch, error, left, fitted):
    """The other choice of candidates follows if none of the first is right."""
    monkeypatch.setattr(Contest, "_best_of_whole_shots", lambda *_: [{"name": "payload"}])
    monkeypatch.setattr(Contest, "_best_of_first_parts", lambda *_: [{"name": "added_mass"}])
    joined, reported = list[str](), list[list[str]]()

    def join(contest: Contest, fits: dict[str, Contender], table: Any) -> None:
        joined.append(table["name"])
        fits[table["name"]] = rival(table["name"], left, 1)

    monkeypatch.setattr(Contest, "_join", join)
    monkeypatch.setattr(Contest, "with_one_value", lambda contest, fits: fits)
    monkeypatch.setattr(Contest, "with_plainer", lambda contest, fits: fits)
    log = SimpleNamespace(track=np.zeros((2, 4)))
    compared = SimpleNamespace(log=log, floor=lambda _: 1.0, chi2=lambda _: error)
    contest = Contest(cast(Any, compared), cast(Any, SimpleNamespace(vehicle=damped())))
    contest.fits([], lambda *_: None, lambda fits: reported.append(list(fits)))
    assert joined == fitted
    assert reported == [fitted[:1]]


def test_only_fits_that_have_not_converged_are_repeated(monkeypatch):
    """Both choices have the same candidates; one more step would help only one of the smooth ones."""
    promised = {"payload": 0.1 * NEGLIGIBLE, "net_buoyancy": 10.0 * NEGLIGIBLE, "thruster_deadband": 0.0}
    for choice in ("_best_of_whole_shots", "_best_of_first_parts"):
        monkeypatch.setattr(Contest, choice, lambda *_: [{"name": name} for name in promised])
    joined = list[tuple[str, int]]()

    def join(contest: Contest, fits: dict[str, Contender], table: Any, iterations: int = QUICK_STEPS) -> None:
        name = table["name"]
        joined.append((name, iterations))
        model = SimpleNamespace(
            unknown=free(damped(), [name]),
            vehicle=damped({"name": name}),
            promised=promised[name],
            normal=SimpleNamespace(cost=1.0),
        )
        fits[name] = Contender(name, cast(Any, model), np.full(SHOTS, 1.1 * FIT / SHOTS))

    monkeypatch.setattr(Contest, "_join", join)
    monkeypatch.setattr(Contest, "with_one_value", lambda contest, fits: fits)
    monkeypatch.setattr(Contest, "with_plainer", lambda contest, fits: fits)
    compared = SimpleNamespace(
        log=SimpleNamespace(track=np.zeros((2, 4))), floor=lambda _: 1.0, chi2=lambda _: 10.0
    )
    contest = Contest(cast(Any, compared), cast(Any, SimpleNamespace(vehicle=damped())))
    contest.fits([], lambda *_: None)
    first, again = list(promised), ["net_buoyancy", "thruster_deadband"]
    quick = [(name, QUICK_STEPS) for name in [*first, *again]]
    assert joined == [*quick, *((name, ITERATIONS) for name in again)]


@pytest.mark.parametrize(
    ("confidences", "goes_on"),
    [((1.0,), True), ((0.3,), True), ((1.0, 0.9), True), ((0.3, 0.2), True), ((1.0, 0.2), False)],
)
def test_a_doubtful_change_after_a_likely_one_is_the_last(confidences, goes_on):
    """What both leave is the error of the hull-force model."""

    def one(confidence: float) -> Any:
        return SimpleNamespace(confidence=lambda given: confidence, best=SimpleNamespace(model=None))

    compared = cast(Any, SimpleNamespace(chi2=lambda _: 5.0))
    regime = ByChange(damped(), compared, cast(Any, None), 10.0)
    assert regime.is_open(Changes(tuple(map(one, confidences)))) is goes_on


@pytest.mark.parametrize(("whole", "kept"), [(5.0, [0, 2]), (0.9, [0, 1, 2])])
def test_components_that_a_recording_hardly_separates_share_no_step(whole, kept):
    costs = {(): 10.0, (0,): 2.0, (1,): 6.0, (2,): 3.0, (0, 1): 1.1, (0, 2): 1.0, (0, 1, 2): whole}
    contest = Contest(cast(Any, SimpleNamespace(cost=costs.get)), cast(Any, None))
    normal = SimpleNamespace(of=tuple)
    assert contest._needed(cast(Any, normal), [0, 1, 2]) == kept


def _absorbs(name: str) -> float:
    return CATALOGUE[name].identification.absorbs


class _Kept(Exception):
    """Says which entries a leaner contender holds at the file's values."""


@pytest.mark.parametrize(
    ("amounts", "held"),
    [
        ((0.8, 0.0, 0.0), [False, True, True]),
        ((0.8, 0.0, -0.6), [False, True, False]),
        ((0.8, -0.7, 0.6), None),
    ],
)
def test_needless_entries_keep_the_values_of_the_file(monkeypatch, amounts, held):
    """Three of eight thrusters are fitted; each needed one explains what no other column does."""
    rng, vehicle = np.random.default_rng(0), damped()
    whole = free(vehicle, ["thruster_gain"])
    unknown = replace(whole, entries=whole.entries[:3], starts=(np.zeros(3),))
    columns = rng.standard_normal((SHOTS, 50, 3))
    values = np.array(amounts) * unknown.scales
    error = 0.1 * rng.standard_normal((SHOTS, 50))
    both = np.concatenate([columns, error[..., None]], axis=-1)
    gram = both.transpose(0, 2, 1) @ both
    model = Model(unknown, values, None, Normal(gram, 50, gram[:, -1:, -1], np.zeros((SHOTS, 0, 4))))
    contender = Contender("thruster_gain", model, gram[:, -1, -1])

    def cost(normal):
        step = (
            np.linalg.solve(normal.matrix.sum(axis=0), normal.score.sum(axis=0))
            if normal.gram.shape[1] > 1
            else []
        )
        return float(normal.expected(np.asarray(step, float)).sum())

    def held_at(_, begun, mask, iterations):
        np.testing.assert_allclose(begun, np.where(mask, 0.0, values))
        raise _Kept(mask.tolist())

    monkeypatch.setattr(contenders, "held_at", held_at)
    contest = Contest(cast(Any, SimpleNamespace(cost=cost)), cast(Any, SimpleNamespace(vehicle=vehicle)))
    if held is None:
        assert contest.without_needless_entries(contender) is contender
    else:
        with pytest.raises(_Kept, match=re.escape(str(held))):
            contest.without_needless_entries(contender)


def test_components_that_act_alike_do_not_hide_an_effect():
    """With a constant command, a fin's area, offset and deflection at full command scale one force."""
    rng = np.random.default_rng(1)
    force = rng.standard_normal((SHOTS, 50))
    alike = [scale * force + 1e-3 * rng.standard_normal((SHOTS, 50)) for scale in (1.0, -0.1, 0.1)]
    error = 10.0 * force + 0.1 * rng.standard_normal((SHOTS, 50))
    both = np.stack([*alike, error], axis=-1)
    gram = both.transpose(0, 2, 1) @ both
    normal = Normal(gram, 50, gram[:, -1:, -1], np.zeros((SHOTS, 0, 4)))
    contest = Contest(cast(Any, SimpleNamespace(cost=_left_in_halves)), cast(Any, None))
    assert contest._needed(normal, [0, 1, 2]) == [0]
    assert contest._needed(normal.of([1]), [0]) == [0]


def _left_in_halves(normal: Normal) -> float:
    """Return the cost of the shots of each half after a step to the other half."""
    return float(left_out_costs(normal, np.arange(SHOTS) % 2).sum())
