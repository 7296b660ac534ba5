"""Deviations of the thrusters from the vehicle file: changes to the thruster table of `vehicle.thrusters`.

Scalar parameters apply to all thrusters.  The chain is: clip -> delay -> {dead band, curve, lag} -> gain ->
asymmetry -> inflow -> reaction torque.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hydro.core.columns import Array
from hydro.core.effects.case import Case
from hydro.core.effects.gains import gains_sentence
from hydro.core.effects.phrases import Sentence, beyond, more, shortened, undetermined
from hydro.core.effects.record import (
    SLIGHTLY_ABSORBED,
    Advice,
    Effect,
    Fill,
    Identification,
    Index,
    Limits,
    Parameter,
    Rest,
    Role,
)
from hydro.core.effects.shapes import Room, of_sizes
from hydro.core.effects.wording import listed, number, quantity
from hydro.core.effects.words import CHIRP, COASTING, a_sample_late
from hydro.core.vehicle.description import Thruster, Vehicle
from hydro.core.vehicle.plausible import Plausible, between
from hydro.core.vehicle.thrusters import (
    ASYMMETRY,
    DEADBAND,
    DELAY,
    GAIN,
    INFLOW,
    POWER,
    REACTION,
    TIME_CONSTANT,
    UNIT_FORCE,
    UNIT_MOMENT,
    UNIT_WRENCH,
    curve_power,
    table_of,
)

LEAST_POWER, MOST_POWER = 0.5, 4.0
"""Bounds of the exponent of a thrust curve."""
QUICKER, HALF = 1.5, 0.75  # samples by which a smaller lag counts as equal, or as half
BANDS = (0.05, 0.1, 0.2)  # shares of the command, tried as half-widths
MORE_BANDS = (0.025, 0.035, 0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4)
TIMES, MORE_TIMES = (0.05, 0.2), (0.02, 0.035, 0.06, 0.1, 0.2, 0.4)  # s, tried as lags and delays
POWERS, MORE_POWERS = (-0.5, 0.5), (-1.0, -0.5, -0.25, 0.25, 0.5, 1.0, 1.5)  # changes of the exponent tried
PLAIN = 0.05  # distance from a whole exponent within which a curve counts as the other named curve


def thruster_gain(p: Array, table: Array) -> None:
    """Thrust f_i (1 + g_i) of thruster i with the nominal thrust f_i and the gain g_i.

    A worn or fouled propeller has g < 0; another supply voltage changes all thrusters.  A common factor does
    not affect servos, whose rows exert no wrench.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    pushes = np.abs(table[:, UNIT_WRENCH]).max(axis=1) > 0.0
    table[:, GAIN] += p if len(p) == len(table) else p[0] * pushes


def thruster_asymmetry(p: Array, table: Array) -> None:
    """Thrust (1 - a) f where the nominal thrust f is negative: blades and ducts are shaped for one direction.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, ASYMMETRY] += p[0]


def thruster_lag(p: Array, table: Array) -> None:
    """Time constant T + dT of the first-order lag of all thrusters, with the time constant T of the file.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, TIME_CONSTANT] += p[0]


def command_delay(p: Array, table: Array) -> None:
    """Command u(t - d), later by d: transport and computing time before a thruster responds.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, DELAY] += p[0]


def thruster_deadband(p: Array, table: Array) -> None:
    """Dead band wider by d, in units of command or normalised speed; for a table, in units of full thrust.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, DEADBAND] += p[0]


def thruster_curve(p: Array, table: Array) -> None:
    """Thrust |n|^(a + da) sign(n) of the maximum for the command n; the file's exponent a is changed by da.

    a is 1 for a linear curve, 2 for a quadratic one.  A propeller's thrust is proportional to the square of
    its speed.  A command may be a share of voltage, speed or thrust, which depends on the driver.  So a wrong
    curve is the most common error of a thruster table.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, POWER] += p[0]


def thruster_inflow(p: Array, table: Array) -> None:
    """Thrust f - c sqrt(|f| f_max) u_a, u_a = d_i . (v_r + omega x r_i) the water's speed into the propeller.

    f is the thrust without inflow, f_max its maximum, d_i and r_i direction and place of thruster i.  This is
    the linear part of the open-water curve K_T(J) = a_0 - a_1 J.  With T ~ n^2 the loss is proportional to n
    u_a, thus to sqrt(|T|) u_a.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, INFLOW] += p[0]


def propeller_torque(p: Array, table: Array) -> None:
    """Moment Q_i = k_i f_i about the axis of thruster i with thrust f_i: the propeller's reaction.

    k = D K_Q/K_T of the open-water diagram, about a tenth of the diameter D.  It is positive for a propeller
    whose reaction turns the hull like a right-handed screw, and negative for the opposite direction.  The
    axis of a thruster given by its wrench is that of its force.

    Changes `table`, the thruster table of `vehicle.thrusters`, (thrusters, columns), by the parameters `p`;
    arguments as in `layout`.
    """
    table[:, REACTION] += p
    table[:, UNIT_MOMENT] += p[:, None] * table[:, UNIT_FORCE]


def common_gain(table: Mapping[str, Any], vehicle: Vehicle) -> list[dict[str, Any]]:
    """Return the simpler effect that may replace unequal gains: one `thruster_gain` table with their mean.

    Args:
        table: `[[effect]]` table of `thruster_gain`.
        vehicle: Not used.

    Returns:
        A list of one new table with `common`, the mean of the gains `g`; empty if `table` has no `g`.
    """
    if "g" not in table:
        return []
    return [{"name": "thruster_gain", "common": float(np.mean(table["g"]))}]


def thrusters(vehicle: Vehicle) -> list[Thruster]:
    """Return the thrusters of a vehicle, without the servos in its list, which exert no wrench."""
    return [thruster for thruster in vehicle.thruster if thruster.pushes]


def room_of_lag(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and greatest admissible change of the thrusters' time constant [s].

    The minimum leaves no thruster with a negative time constant.  If the vehicle file gives the integration
    step of the simulator that wrote the log, the time constant stays above two of these steps.
    """
    shortest = [t.time_constant - 2.0 * (t.lag_step or 0.0) for t in thrusters(vehicle)]
    return -max(min(shortest, default=0.0), 0.0), 3.0


def room_of_delay(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and greatest admissible change of the command delay [s].

    The least is minus the shortest delay of a thruster in the vehicle file, the greatest 2 s.
    """
    return -min((t.delay for t in thrusters(vehicle)), default=0.0), 2.0


def room_of_band(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and greatest admissible change of the dead band, in units of command.

    With the change, the dead band of every thruster is from 0 to 0.9 of full command.
    """
    bands = [t.deadband for t in thrusters(vehicle)] or [0.0]
    return -min(bands), 0.9 - max(bands)


def room_of_power(vehicle: Vehicle) -> tuple[float, float]:
    """Return the least and greatest admissible change of the exponent of the thrust curve.

    With the change, the exponent of every thruster is from LEAST_POWER to MOST_POWER.
    """
    powers = [curve_power(thruster) for thruster in thrusters(vehicle)] or [1.0]
    return LEAST_POWER - min(powers), MOST_POWER - max(powers)


def in_sum(low: float, high: float, of: Callable[[Thruster], float], words: str, source: str) -> Plausible:
    """Return the plausible range of a parameter that is added to a value of the thrusters, such as a delay.

    The sum of the file's value and the parameter must lie between `low` and `high`.

    Args:
        low: Minimum of the sum.
        high: Maximum of the sum.
        of: Function that returns the file's value of one thruster.
        words: Description of the range, for reports.
        source: Publication or reason of the range.
    """

    def at(index: Index, vehicle: Vehicle) -> tuple[float, float]:
        given = [of(thruster) for thruster in thrusters(vehicle)] or [0.0]
        return low - min(given), high - max(given)

    return Plausible(at, words, source)


def within(room: Room) -> Limits:
    """Return the function that gives a parameter's bounds in a fit, for `Parameter.limits`.

    Args:
        room: Function from a vehicle to the minimum and maximum of the parameter.
    """

    def limits(index: Index, rest: Rest) -> tuple[float, float]:
        return room(rest.vehicle)

    return limits


def a_sample_early(parameters: Mapping[str, Any], dt: float) -> str | None:
    """Return a remark if thrusters are quicker than modelled by up to QUICKER samples; else None.

    The remark says that the log, not the vehicle, may cause the difference.

    Args:
        parameters: Fitted change `dT` of the time constant [s].
        dt: Sample time of the log [s].
    """
    quicker = -float(parameters["dT"])
    if 0.0 < quicker <= HALF * dt:
        return (
            "thrusters quicker by a part of a sample: most likely the source of the log holds forces over a "
            "row, or integrates by Euler's rule at the log's rate; this is not the vehicle, and nothing is "
            "to be shifted"
        )
    if 0.0 < quicker <= QUICKER * dt:
        return (
            "thrusters quicker by about one sample: most likely the log writes a command one row after it "
            "acts; shift the command columns up by one row and diagnose again"
        )
    return None


def another_curve(parameters: Mapping[str, Any], dt: float) -> str | None:
    """Return a remark if a quadratic thrust curve fits in the place of a linear one, or the reverse.

    Args:
        parameters: Fitted change `da` of the curve's exponent.
        dt: Not used.

    Returns:
        The remark; None if the change of the exponent is not near 1 or -1.
    """
    power = float(parameters["da"])
    if abs(abs(power) - 1.0) >= PLAIN:
        return None
    curve = "quadratic" if power > 0.0 else "linear"
    return (
        f'the thrust curve is {curve}: set `curve = "{curve}"` in every [[thruster]] that names one, and '
        "diagnose again; `hydro add` does it as well"
    )


def asymmetry_sentence(case: Case) -> str:
    """Return a sentence that states the thrust in reverse, in percent of the nominal thrust in reverse."""
    loss = case.one("a").times(100.0)
    left = quantity(100.0 - loss.value, loss.error, "%")
    if not loss.clear:
        return undetermined(case, "the share of reverse thrust", left)
    was = f", not {number(100.0 - loss.before)} % {case.as_given}" if case.in_file else ""
    return f"In reverse, thrusters deliver {left} of their nominal thrust{was}."


def curve_sentence(case: Case) -> str:
    """Return a sentence that states the exponent of the thrust curve and that of the file."""
    powers = {curve_power(thruster) for thruster in thrusters(case.vehicle)}
    power = case.one("da")
    if not power.clear:
        return undetermined(case, "the added power of the thrust curve", power.text())
    if len(powers) != 1:
        side = "higher" if power.change > 0.0 else "lower"
        return f"The power of the thrust curves is {power.changed()} {side} than modelled."
    plain = powers.pop()
    now, was = quantity(plain + power.value, power.error), number(plain + power.before)
    if any(table_of(thruster) for thruster in thrusters(case.vehicle)):
        return f"The share of full thrust is that of the file's curve to the power {now}, not {was}."
    return f"Thrust grows with the command to the power {now}, not {was} {case.as_given}."


def inflow_sentence(case: Case) -> str:
    """Return a sentence that states the thrust loss per speed of the water into the propellers."""
    loss = case.one("c").times(100.0)
    if not loss.clear:
        return undetermined(case, "the loss of thrust with speed", f"{loss.text('%')} per m/s")
    verb = "lose" if loss.value >= 0.0 else "gain"
    was = f"{number(loss.before)} %" if loss.before else "none"
    return (
        f"At full command, thrusters {verb} {loss.size('%')} of thrust per m/s of inflow; the file has {was}."
    )


def torque_sentence(case: Case) -> str:
    """Return a sentence that states the most significant reaction torques of the propellers on the hull."""
    given = case.values.get("k", ())
    ratios = case.many("k", (len(given) if isinstance(given, list | tuple | np.ndarray) else 0,))
    order = sorted(
        enumerate(ratios, 1), key=lambda one: (one[1].deviations, abs(one[1].change)), reverse=True
    )
    clear = [(i, one) for i, one in order if one.clear]
    if not clear:
        first = f"{order[0][1].text('N m/N')} for thruster {order[0][0]}" if order else "no value"
        return undetermined(case, "the reaction torque of the propellers", first)

    def render(count: int) -> str:
        named = [
            f"{one.size('N m/N')} {'clockwise' if one.value >= 0.0 else 'counterclockwise'} for thruster {i}"
            + (f" (was {number(one.before)})" if case.in_file else "")
            for i, one in clear[:count]
        ]
        verb = "changes" if case.in_file else "is missing"
        told = listed([*named, *more(len(clear) - count)])
        return f"Reaction torque of the propellers on the hull, seen along their thrust, {verb}: {told}."

    return shortened(render)


def _effect(
    name: str,
    fill: Fill,
    sentence: Sentence,
    definition: str,
    source: str,
    excitation: str,
    lookalikes: tuple[str, ...],
    parameter: Parameter,
    advice: Advice,
    identification: Identification = Identification(),  # noqa: B008
    roles: frozenset[Role] = frozenset(),
    instead: tuple[Parameter, ...] = (),
) -> Effect:
    """Return an actuator effect: each has one parameter, or others `instead` of it, and one function."""
    return Effect(
        name=name,
        family="actuator",
        kind="actuator",
        definition=definition,
        source=source,
        excitation=excitation,
        lookalikes=lookalikes,
        parameters=(parameter, *instead),
        one_of=tuple(one.name for one in (parameter, *instead)) if instead else (),
        actuator=fill,
        sentence=sentence,
        advice=advice,
        identification=identification,
        roles=roles,
    )


THRUST_LEFT = between(-1.0, 0.5, "", "thrust from none to 1.5 of the file's")

THRUSTER_GAIN = _effect(
    "thruster_gain",
    thruster_gain,
    gains_sentence,
    "f_i (1 + g_i)",
    "Fossen (1994), section 4.1 (propeller thrust)",
    "every thruster used apart from the others",
    ("quadratic_damping", "thruster_asymmetry", "buoyancy_offset"),
    Parameter(
        "g",
        ("1",),
        "relative gain of each thruster",
        ("thrusters",),
        low=-1.0,
        plausible=THRUST_LEFT,
    ),
    Advice(parted_by=(COASTING,)),
    Identification(absorbs=SLIGHTLY_ABSORBED, plainer=common_gain),
    instead=(Parameter("common", ("1",), "relative gain of all thrusters", low=-1.0, plausible=THRUST_LEFT),),
)

EFFECTS = (
    THRUSTER_GAIN,
    _effect(
        "thruster_asymmetry",
        thruster_asymmetry,
        asymmetry_sentence,
        "(1 - a) f for f < 0",
        "Fossen (1994), section 4.1 (propeller thrust astern)",
        "thrust of both signs on every thruster",
        ("thruster_gain", "net_buoyancy"),
        Parameter(
            "a",
            ("1",),
            "share of reverse thrust lost",
            high=1.0,
            plausible=between(-0.5, 1.0, "", "thrust astern from none to 1.5 of the file's"),
        ),
        Advice(parted_by=(COASTING,)),
    ),
    _effect(
        "thruster_lag",
        thruster_lag,
        beyond(
            "dT",
            "s",
            "the added time constant of the thrusters",
            "Thrusters answer with a time constant {change} {side} than modelled",
            ("longer", "shorter"),
        ),
        "T + dT",
        "Yoerger, Cooke and Slotine (1990)",
        "steps and fast sweeps of the commands",
        ("command_delay", "added_mass", "fluid_memory"),
        Parameter(
            "dT",
            ("s",),
            "added time constant",
            limits=within(room_of_lag),
            plausible=in_sum(
                0.0,
                2.0,
                lambda thruster: thruster.time_constant,
                "time constant in sum 0 to 2 s",
                "Yoerger, Cooke and Slotine (1990): tenths of a second",
            ),
        ),
        Advice(parted_by=(CHIRP,), saying=a_sample_early),
        Identification(
            coarse=of_sizes("thruster_lag", "dT", room_of_lag, TIMES),
            fine=of_sizes("thruster_lag", "dT", room_of_lag, MORE_TIMES),
        ),
    ),
    _effect(
        "command_delay",
        command_delay,
        beyond(
            "d",
            "s",
            "the added command delay",
            "Commands take effect {change} {side} than modelled",
            ("later", "earlier"),
        ),
        "u(t - d)",
        "pure transport delay",
        "steps and fast sweeps of the commands",
        ("thruster_lag", "sensor_delay"),
        Parameter(
            "d",
            ("s",),
            "added delay",
            limits=within(room_of_delay),
            plausible=in_sum(
                0.0,
                2.0,
                lambda thruster: thruster.delay,
                "delay in sum 0 to 2 s",
                "transport over a tether or network: below a second",
            ),
        ),
        Advice(parted_by=(CHIRP,), saying=a_sample_late),
        Identification(
            step=1e-2,
            coarse=of_sizes("command_delay", "d", room_of_delay, TIMES),
            fine=of_sizes("command_delay", "d", room_of_delay, MORE_TIMES),
        ),
    ),
    _effect(
        "thruster_deadband",
        thruster_deadband,
        beyond(
            "d",
            "%",
            "the added dead band of the thrusters",
            "The thrusters' dead band is {change} of full command {side} on each side than modelled",
            ("wider", "narrower"),
        ),
        "dead band + d",
        "Yoerger, Cooke and Slotine (1990); paper (10)",
        "small commands of both signs",
        ("thruster_gain", "linear_damping"),
        Parameter(
            "d",
            ("1",),
            "added half-width of the dead band",
            low=-1.0,
            high=1.0,
            scale=(0.1,),
            limits=within(room_of_band),
            plausible=in_sum(
                0.0,
                0.5,
                lambda thruster: thruster.deadband,
                "half-width in sum 0 to 0.5",
                "speed controllers: below a tenth; seized propellers more",
            ),
        ),
        Advice(parted_by=(COASTING,)),
        Identification(
            step=5e-2,
            resolution=1e-4,
            coarse=of_sizes("thruster_deadband", "d", room_of_band, BANDS),
            fine=of_sizes("thruster_deadband", "d", room_of_band, MORE_BANDS),
        ),
    ),
    _effect(
        "thruster_curve",
        thruster_curve,
        curve_sentence,
        "abs(n)^(a + da) sign(n)",
        "Fossen (2011), section 12.3 (thrust and the square of propeller speed)",
        "commands from small to full on every thruster",
        ("thruster_gain", "thruster_deadband", "quadratic_damping"),
        Parameter(
            "da",
            ("1",),
            "added to the power of the curve: 1 makes a linear one quadratic",
            limits=within(room_of_power),
            plausible=in_sum(
                0.5,
                3.0,
                curve_power,
                "power in sum 0.5 to 3",
                "commands of power (2/3), thrust (1), speed (2); Fossen (2011), section 12.3",
            ),
        ),
        Advice(parted_by=(COASTING,), saying=another_curve),
        Identification(
            coarse=of_sizes("thruster_curve", "da", room_of_power, POWERS),
            fine=of_sizes("thruster_curve", "da", room_of_power, MORE_POWERS),
        ),
    ),
    _effect(
        "thruster_inflow",
        thruster_inflow,
        inflow_sentence,
        "f - c sqrt(abs(f) f_max) u_a, u_a = d_i . (v_r + omega x r_i)",
        "Fossen (1994), section 4.1 (bilinear thruster model)",
        "the same thrust at several speeds, ahead and astern",
        ("linear_damping", "quadratic_damping"),
        Parameter(
            "c",
            ("s/m",),
            "relative loss per speed at full thrust",
            plausible=between(0.0, 1.0, "s/m", "no thrust left from 1 m/s or more on"),
        ),
        Advice(parted_by=(COASTING,)),
    ),
    _effect(
        "propeller_torque",
        propeller_torque,
        torque_sentence,
        "Q_i = k_i f_i about the axis of each thruster",
        "Fossen (1994), section 4.1 (propeller thrust and torque)",
        "every thruster used apart from the others",
        ("thruster_gain", "buoyancy_offset"),
        Parameter(
            "k",
            ("m",),
            "torque per thrust of each thruster",
            ("thrusters",),
            required=True,
            scale=(0.02,),
            plausible=between(-0.15, 0.15, "m", "open-water diagrams: about a tenth of the diameter"),
        ),
        Advice(parted_by=(COASTING,)),
    ),
)
