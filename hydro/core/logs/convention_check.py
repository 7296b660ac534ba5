"""Test of frames, units and signs of a log by the kinematics of its pose and velocities.

A reading of a log is a map that states the frame, unit and sign of each column.  One number compares two
readings.  With the residuals r of the first and r' of the second (`logs.agreement`), c = <r, r - r'> /
|r - r'|^2.  It is 0 if the first reading is right, 1 if the second is, and 1/2 if the data cannot decide, as
on an axis without motion.

Kinematics cannot show a frame that is wrong in all blocks alike.  If the pose was itself integrated from
these velocities, the test shows only that both use the same convention.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.logs.agreement import COMPARED_SECONDS, RESOLUTION, Evidence, tested, windows
from hydro.core.logs.alternatives import Change, cost, difference, exchanges, flips, frame_changes
from hydro.core.logs.conventions import SessionLog, beyond_a_turn
from hydro.core.logs.logmap import BLOCKS, LogMap, measured

LEAST_WINDOWS = 6  # minimum number of windows for a test
TIE = 0.05  # negligible difference of misfits
DOUBT = 0.5  # unexplained share of the motion above which all combinations of frames are tried
UNEXPLAINED = 0.7  # unexplained share above which a reading cannot be better than another
UNEXPLAINED_UNIT = 0.5  # the same limit for a reading in other units
TELLING, SURE = 0.75, 3.0  # c that favours another reading, and its distance from 1/2 in standard errors
TESTED = 6.0  # standard errors above which a sign counts as tested; many signs are tested
UPSIDE_DOWN, FLYING = 5.0, 1.5  # costs of readings with the vehicle upside down, and above the water
MOSTLY = 0.9
WORSE = 1.5  # ratio of unexplained shares in few windows above which a reading is dropped
STARTS = 8  # number of combinations of frames from which single signs are tried
DEAD_RECKONED = 0.4  # ratio of error to velocity noise below which the pose was dead-reckoned
STRETCHES = 30  # number of blocks of the log for standard errors


@dataclass(frozen=True)
class Verdict:
    """Result of the test whether a log follows the map of its columns.

    Attributes:
        agreement: RMS difference of the position's rate [m/s] and of the attitude's rate [rad/s] from the
            logged velocities, with the declared map; NaN where the log cannot test it.
        contradictions: One line for each setting of the map that the data contradict.
        notes: Lines on untestable settings and other anomalies.
        follows: Map that the data follow; the declared one if nothing contradicts it.
        disagree: Whether position and velocity disagree under every alternative meaning, and whether attitude
            and rates do.
    """

    agreement: tuple[float, float]
    contradictions: tuple[str, ...]
    notes: tuple[str, ...]
    follows: LogMap
    disagree: tuple[bool, bool] = (False, False)


def check(logs: Sequence[SessionLog], times: Sequence[Array], dt: float, declared: LogMap) -> Verdict:
    """Test by the log's kinematics whether its columns mean what a map declares, or something else.

    Args:
        logs: The sessions.
        times: Times of the rows of each session [s]; all channels have values there.
        dt: Sample time [s].
        declared: Map with the declared meaning of the columns.

    Returns:
        The result, with the map that the data follow.
    """
    return _with_turns(_by_kinematics(logs, times, dt, declared), logs)


def _with_turns(verdict: Verdict, logs: Sequence[SessionLog]) -> Verdict:
    """Add the contradiction that angles are in degrees, where only their size shows it."""
    attitude = verdict.follows.attitude
    if attitude is None:
        return verdict
    line = next((line for log in logs if (line := beyond_a_turn(log, attitude))), "")
    if not line:
        return verdict
    follows = msgspec.structs.replace(verdict.follows, attitude=msgspec.structs.replace(attitude, unit="deg"))
    return replace(verdict, contradictions=(*verdict.contradictions, line), follows=follows)


def _by_kinematics(
    logs: Sequence[SessionLog], times: Sequence[Array], dt: float, declared: LogMap
) -> Verdict:
    """Test a map by the rates of position and attitude."""
    taken = windows(times, dt)
    if sum(map(len, taken)) < LEAST_WINDOWS:
        lacking = f"{LEAST_WINDOWS} windows of {COMPARED_SECONDS:g} s without a gap"
        note = f"frames and signs not tested: there are not {lacking}"
        return Verdict((np.nan, np.nan), (), (note,), declared)
    if not any(tested(declared)):
        needs = "attitude with rates, or position and attitude with velocity"
        note = f"frames and signs not tested: this needs {needs}"
        return Verdict((np.nan, np.nan), (), (note,), declared)
    evidence = Evidence(logs, taken)
    whole, declared, resting = declared, *_without_rest(evidence, declared)
    if not any(tested(declared)):
        note = "frames and signs not tested: the vehicle did not move beyond the noise of its sensors"
        return Verdict((np.nan, np.nan), (), (note,), whole)
    found = _best(evidence, declared)
    if declared.rates is None:
        found = _with_attitude_at_rest(evidence, declared, found)
    changes = difference(declared, found)
    lines = [contradiction(evidence, declared, found, change) for change in changes]
    odd = _disagree(evidence, found)
    notes = [*_oddities(evidence, found, odd), *_void(evidence, found, odd, resting)]
    both = tested(declared)
    translation, rotation = np.where(both, evidence.errors(declared), np.nan).tolist()
    kept = {name: getattr(found, name) or getattr(whole, name) for name in ("velocity", "rates")}
    found = msgspec.structs.replace(found, **kept)
    return Verdict((translation, rotation), tuple(lines), tuple(notes), found, odd)


def _without_rest(evidence: Evidence, declared: LogMap) -> tuple[LogMap, list[str]]:
    """Return the map without velocities that lack motion for a test, and the columns of these.

    For a vehicle at rest, a smaller unit explains the noise better, and so does any frame by chance.
    """
    resting = list[str]()
    for block, moves in zip(("velocity", "rates"), evidence.moves(declared), strict=True):
        if not moves:
            resting += [column.column for column in measured(getattr(declared, block))]
            declared = msgspec.structs.replace(declared, **{block: None})
    return declared, resting


def _with_attitude_at_rest(evidence: Evidence, declared: LogMap, found: LogMap) -> LogMap:
    """Return the found map, with the declared attitude unless the found one explains clearly more.

    Without rates or turns, only the travel tests the attitude, and weakly for a level vehicle.

    Args:
        evidence: Windows of the log.
        declared: Declared map.
        found: Map that the data follow.
    """
    given = msgspec.structs.replace(found, attitude=declared.attitude)
    plainly = evidence.misfit(found) < evidence.misfit(given) - TIE
    return found if plainly else given


def _best(evidence: Evidence, declared: LogMap) -> LogMap:
    """Return the map that the data follow: the smallest change of the declared one with the same misfit."""
    found = declared
    if (evidence.shares(declared) > DOUBT).any():
        found = _among_all(evidence, declared)
    return _pruned(evidence, declared, _polished(evidence, declared, found))


def _among_all(evidence: Evidence, declared: LogMap) -> LogMap:
    """Return the best of all combinations of frames and units, each with the signs that improve it.

    There are thousands of combinations, so a few windows select those that are tested on all windows.
    """
    few = evidence.few
    ranked = sorted(_combinations(few, declared), key=lambda one: one[0])
    starts = [given for _, given in ranked[:STARTS]]
    signed = {_with_signs(evidence, declared), *(_with_signs(few, start) for start in starts)}
    return _least_change(evidence, declared, {*signed, *starts})


def _combinations(evidence: Evidence, declared: LogMap) -> Iterable[tuple[float, LogMap]]:
    """Yield combinations of frames and units with their misfit, using the best rates for each attitude."""
    changes = frame_changes(declared)
    for attitude in _readings(declared, changes["attitude"]):
        turned = min(_readings(attitude, changes["rates"]), key=evidence.misfit)
        for velocity in _readings(turned, changes["velocity"]):
            for given in _readings(velocity, changes["position"]):
                yield evidence.misfit(given), given


def _readings(given: LogMap, changes: Sequence[Change]) -> list[LogMap]:
    """Return a map with none, one, and any two of the changes of one block that affect different settings."""
    singles = [change.apply(given) for change in changes]
    pairs = [
        second.apply(first.apply(given))
        for first, second in combinations(changes, 2)
        if not dict(first.settings).keys() & dict(second.settings).keys()
    ]
    return list(dict.fromkeys([given, *singles, *pairs]))


def _with_signs(evidence: Evidence, start: LogMap) -> LogMap:
    """Reverse or exchange columns one after another while that lowers the misfit."""
    given, misfit = start, evidence.misfit(start)
    while True:
        options = [change.apply(given) for change in [*flips(given), *exchanges(given)]]
        best = min([*options, *_reversed_together(given)], key=evidence.misfit)
        if evidence.misfit(best) > misfit - TIE:
            return given
        given, misfit = best, evidence.misfit(best)


def _reversed_together(given: LogMap) -> list[LogMap]:
    """Return the maps with any two columns reversed.

    Where z and w are both positive up, one reversal alone does not help.
    """
    pairs = combinations(flips(given), 2)
    return [second.apply(first.apply(given)) for first, second in pairs]


def _least_change(evidence: Evidence, declared: LogMap, options: Iterable[LogMap]) -> LogMap:
    """Return the map closest to the declared one among those with nearly the best misfit."""
    misfits = {given: evidence.misfit(given) for given in options}
    good = [given for given, misfit in misfits.items() if misfit < min(misfits.values()) + TIE]

    def price(given: LogMap) -> tuple[float, float]:
        fallen = not evidence.upright(given.attitude)
        flying = evidence.above_water(given.position) > MOSTLY
        return cost(declared, given) + UPSIDE_DOWN * fallen + FLYING * flying, misfits[given]

    return min(good, key=price)


def _polished(evidence: Evidence, declared: LogMap, given: LogMap) -> LogMap:
    """Apply every single change that the data demand, the most significant first."""
    for _ in range(len(flips(declared))):
        singles = [change for changes in frame_changes(given).values() for change in changes]
        options = [change.apply(given) for change in [*singles, *flips(given), *exchanges(given)]]
        demanded = _demanded(evidence, given, options)
        if not demanded:
            demanded = _demanded(evidence, given, _reversed_together(given))
        if not demanded:
            return given
        surest = max(demanded.values())
        near = [option for option, sureness in demanded.items() if sureness > (1.0 - TIE) * surest]
        given = min(near, key=lambda option: (cost(declared, option), -demanded[option]))
    return given


def _demanded(evidence: Evidence, given: LogMap, options: Sequence[LogMap]) -> dict[LogMap, float]:
    """Return the readings that the data demand instead of `given`, with their significance.

    If the vehicle is upright under `given`, readings that put it upside down are left out.

    Args:
        evidence: Windows of the log.
        given: Present reading.
        options: Other readings.

    Returns:
        Significance in standard errors, by reading.
    """
    before = evidence.few.shares(given)
    options = [option for option in options if _may_be_better(before, evidence.few.shares(option))]
    if evidence.upright(given.attitude):
        options = [option for option in options if evidence.upright(option.attitude)]
    judged = {option: _speaks_for(evidence, given, option) for option in options}
    return {option: sureness for option, sureness in judged.items() if sureness is not None}


def _may_be_better(before: Array, after: Array) -> bool:
    """Return whether a reading may be better than another.

    Args:
        before: Error shares of translation and rotation of the other reading in a few windows, (2,).
        after: Error shares of this reading, (2,).
    """
    return bool(((after < WORSE * before) & (after != before)).any())


def _pruned(evidence: Evidence, declared: LogMap, found: LogMap) -> LogMap:
    """Remove changes that the data do not demand given the others."""
    for change in difference(declared, found):
        without = _without(declared, found, change)
        if _speaks_for(evidence, without, found) is None:
            return _pruned(evidence, declared, without)
    return found


def _without(declared: LogMap, found: LogMap, change: Change) -> LogMap:
    """Return the found map with one of its changes reverted."""
    given = declared
    for other in difference(declared, found):
        if other != change:
            given = other.apply(given)
    return given


def _speaks_for(evidence: Evidence, first: LogMap, second: LogMap) -> float | None:
    """Return the significance of the second reading in standard errors; None if the data do not demand it.

    The second reading must also explain the motion.  A smaller unit makes every error smaller, and a signal
    without motion, such as the rates of a lever arm, favours a smaller unit.
    """
    before, after = evidence.shares(first), evidence.shares(second)
    better = int(np.argmax(before / after))
    most = UNEXPLAINED_UNIT if _other_units(first, second) else UNEXPLAINED
    if not after[better] < min(before[better], most):
        return None
    c, error = _contrast(evidence, first, second)
    sureness = (c - 0.5) / error
    return sureness if c > TELLING and sureness > SURE else None


def _other_units(first: LogMap, second: LogMap) -> bool:
    """Return whether two readings differ in the unit of a block."""
    units = [[getattr(getattr(given, name), "unit", None) for name in BLOCKS] for given in (first, second)]
    return units[0] != units[1]


def _contrast(evidence: Evidence, first: LogMap, second: LogMap) -> tuple[float, float]:
    """Return how far the data prefer the second of two readings, and the standard error of that number.

    The number is c of the module's text: 0 if the first reading is right, 1 if the second is.  The error is
    the jackknife's over blocks of the log.
    """
    before, after = evidence.residuals(first), evidence.residuals(second)
    scale = np.repeat(np.hypot(np.minimum(evidence.errors(first), evidence.errors(second)), RESOLUTION), 3)
    r, moved = before / scale, (before - after) / scale
    products = np.stack([(r * moved).sum(axis=1), (moved**2).sum(axis=1)])
    if not products[1].sum() > 1e-6 * products.shape[1]:
        return 0.5, np.inf
    groups = np.stack([part.sum(axis=1) for part in np.array_split(products, min(STRETCHES, len(r)), axis=1)])
    total, count = groups.sum(axis=0), len(groups)
    left_out = (total - groups)[:, 0] / np.maximum((total - groups)[:, 1], 1e-300)
    error = np.sqrt((count - 1) / count * ((left_out - left_out.mean()) ** 2).sum())
    return float(total[0] / total[1]), float(max(error, 1e-9))


def rivals(evidence: Evidence, declared: LogMap, found: LogMap) -> list[LogMap]:
    """Return maps with a change in another block that fit the log as well as `found`.

    For example, for a level vehicle, w reversed is equivalent to z reversed.

    Args:
        evidence: Windows of the log.
        declared: Declared map.
        found: Declared map with a change in one block.

    Returns:
        For each other block, the declared map with the smallest change that fits, if there is one.
    """
    (own,) = difference(declared, found)
    changes = [change for several in frame_changes(declared).values() for change in several]
    changes = sorted([*changes, *flips(declared), *exchanges(declared)], key=lambda change: change.cost)
    least: dict[str, LogMap] = {}
    for change in changes:
        option = change.apply(declared)
        if change.block in (own.block, *least) or not _demanded(evidence, declared, [option]):
            continue
        c, error = _contrast(evidence, found, option)
        if c + SURE * error > 0.5:
            least[change.block] = option
    return list(least.values())


def contradiction(evidence: Evidence, declared: LogMap, found: LogMap, change: Change) -> str:
    """Return one line on a setting of the map that the data contradict: the true setting, errors and advice.

    Args:
        evidence: Windows of the log.
        declared: Declared map.
        found: Map that the data follow.
        change: The contradicted setting, one of the differences between both maps.
    """
    best, left = evidence.errors(found), evidence.errors(_without(declared, found, change))
    which = int(np.argmax(left / np.hypot(best, RESOLUTION)))
    quantity, unit = (("d(position)/dt", "m/s"), ("the attitude's rate", "rad/s"))[which]
    return (
        f"{change.claim(declared)}: {quantity} agrees to {best[which]:.2g} {unit} "
        f"instead of {left[which]:.2g} {unit}; {change.advice(declared)}"
    )


def _void(evidence: Evidence, found: LogMap, odd: tuple[bool, bool], resting: Sequence[str]) -> Iterable[str]:
    """Yield notes on properties that the log cannot test.

    These are signs of axes with little motion, and a pose that was integrated from the velocities.  Pairs
    that disagree under every reading are skipped, because no sign could correct them.

    Args:
        evidence: Windows of the log.
        found: Map that the data follow.
        odd: Whether position and velocity disagree under every reading, and whether attitude and rates do.
        resting: Columns of velocities without motion.
    """
    untested = []
    both = [there and not wrong for there, wrong in zip(tested(found), odd, strict=True)]
    sides = [name for name, there in zip(("velocity", "rates"), both, strict=True) if there]
    for change in flips(found):
        if change.block in sides and change.flip is not None:
            c, error = _contrast(evidence, found, change.apply(found))
            if not (c < 1.0 - TELLING and c + TESTED * error < 0.5):
                untested.append(measured(getattr(found, change.block))[change.flip].column)
    untested += resting
    if untested:
        yield f"too little motion to test the sign of {', '.join(untested)}"
    allowed = _least_errors(evidence, found)
    closest = np.min([evidence.errors(found, rule) for rule in evidence.rules], axis=0)
    for there, reached, least, pose, source in zip(
        both, closest, allowed, ("position", "attitude"), ("velocity", "rates"), strict=True
    ):
        if there and reached < DEAD_RECKONED * least:
            yield (
                f"the {pose} agrees with the {source} better than the noise of the {source} allows, as if it "
                "was integrated from them: their frames belong together, but a wrong scale, bias or mounting "
                "of the sensor cannot show here"
            )


def _least_errors(evidence: Evidence, found: LogMap) -> Array:
    """Return the errors of translation [m/s] and rotation [rad/s] by noise of the velocities alone, (2,).

    They are 0 if there is hardly any noise.
    """
    steps = evidence.t.shape[1] - 1
    noise = np.zeros(2)
    if found.velocity is not None:
        noise[0] = _white(evidence.velocity(found.velocity))
    if found.rates is not None:
        noise[1] = _white(evidence.spinning(found.rates))
    return np.where(noise > 3.0 * RESOLUTION, noise / np.sqrt(steps), 0.0)


def _noise_of_pose(evidence: Evidence, found: LogMap) -> Array:
    """Return the errors of translation [m/s] and rotation [rad/s] by noise of the pose alone, (2,).

    The noise acts at both ends of a window.
    """
    noise: Array = np.zeros(2)
    if found.position is not None:
        noise[0] = _white(evidence.placed(found.position))
    if found.attitude is not None:
        turned = evidence.attitude(found.attitude).reshape(*evidence.t.shape, 9)
        noise[1] = _white(turned) / np.sqrt(2.0)
    return noise * float(np.sqrt(2.0) / evidence.length)


def _white(values: Array) -> float:
    """Return the standard deviation of a vector's white noise, from fourth differences.

    Args:
        values: Vectors at the rows of W windows, (W, m + 1, C); with fewer than five rows the result is 0.
    """
    if values.shape[1] < 5:
        return 0.0
    size = np.median(np.abs(np.diff(values, 4, axis=1)), axis=(0, 1)) / (0.6745 * np.sqrt(70.0))
    return float(np.linalg.norm(size))


def _disagree(evidence: Evidence, found: LogMap) -> tuple[bool, bool]:
    """Return whether position and velocity, and attitude and rates, disagree under the best reading."""
    errors, motion = evidence.errors(found), evidence.motion(found)
    least = np.maximum([0.05, 0.02], 2.0 * _noise_of_pose(evidence, found))
    first, second = ((errors > least) & (errors > UNEXPLAINED * motion)).tolist()
    return first, second


def _oddities(evidence: Evidence, found: LogMap, odd: tuple[bool, bool]) -> Iterable[str]:
    """Yield notes on disagreements under every reading of the columns."""
    errors, motion = evidence.errors(found), evidence.motion(found)
    for name, error, whole, unit, other, wrong in zip(
        ("position", "attitude"), errors, motion, ("m/s", "rad/s"), ("velocity", "rates"), odd, strict=True
    ):
        if wrong:
            yield (
                f"the {name} changes by {whole:.2g} {unit} and disagrees with the logged {other} by "
                f"{error:.2g} {unit}, and no choice of frames, units and signs removes it: look for a wrong "
                "column, a delay or jumps"
            )
    if not evidence.upright(found.attitude):
        yield "by its attitude the vehicle is upside down: check attitude.body and attitude.world"
    if (above := evidence.above_water(found.position)) > MOSTLY:
        yield (
            f"the depth is negative in {100.0 * above:.0f} % of the log: unless it counts from below the "
            "surface, up was taken for down, which no kinematics shows where all blocks agree (ROS: worlds "
            "ENU, bodies FLU)"
        )
