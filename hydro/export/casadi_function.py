"""Target `casadi`: the equations of motion as CasADi functions, for controllers and optimisation.

The functions are traced from the kernels that `simulate` runs (`export.tracing`).  The state x contains
position (3), quaternion body to NED (4), nu (6), the lag states of thrusters and the internal states of
effects.  It also contains the time if a current depends on it, and past commands of thrusters with delay.  u
are commands in [-1, 1].

The function `step` handles delays: it starts with past commands and switches to newer ones within the step.
The function f has no steps, so its u are the delayed commands, and past commands stay constant.
"""

from __future__ import annotations

import importlib.util
import itertools
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from hydro.core.effects.catalogue import CATALOGUE, thruster_table
from hydro.core.effects.layout import CURRENT_TREND
from hydro.core.effects.program import HEADER
from hydro.core.errors import UsageError
from hydro.core.simulation.dynamics import BODY
from hydro.core.vehicle.description import Vehicle
from hydro.core.vehicle.thrusters import COLUMNS, DELAY, LAG_STEP, TIME_CONSTANT, state_derivative
from hydro.export.equations import Model, effective, initial_states, interpolated, normalised, rates, targets
from hydro.export.numbers import model_of
from hydro.export.targets import Lack, Target, lacking_effects, sensor_reason, without_effects
from hydro.export.tracing import Tracer

BODY_STATES = ("x", "y", "z", "q_w", "q_x", "q_y", "q_z", "u", "v", "w", "p", "q", "r")
"""Names of the rigid body's states."""
STEP = 0.02
"""Length of the step in an exported file [s]; `functions` accepts any length."""
CLOSE = 1e-9
"""Times closer than this share of a step are the same instant."""
LEAST_SQUARE = 1e-12
"""Value below which a square root is replaced by a straight line."""
SUBSTEPS = 10
"""Runge-Kutta steps per step: 2 ms each, as in `simulate`."""


class Symbols:
    """Interface of CasADi's symbols for `export.tracing`, which runs numeric functions on symbols."""

    def __init__(self) -> None:
        import casadi as ca

        self._ca = ca
        self.functions: Mapping[Any, Callable[..., Any]] = {
            abs: self._known_or(abs, ca.fabs),
            float: lambda value: value,
            int: int,
            max: self._known_or(max, ca.fmax),
            min: self._known_or(min, ca.fmin),
            interpolated: self._interpolated,
            math.copysign: self._known_or(math.copysign, ca.copysign),
            math.pow: self._known_or(math.pow, ca.power),
            math.sqrt: self._known_or(math.sqrt, self._root),
            **{
                getattr(math, name): self._known_or(getattr(math, name), getattr(ca, name))
                for name in ("exp", "log", "log1p", "sin", "cos", "tan", "tanh", "atan2", "atan", "asin")
            },
        }

    def is_symbol(self, value: Any) -> bool:
        """Return whether a value is a CasADi symbol."""
        return isinstance(value, self._ca.SX)

    def select(self, test: Any, yes: Any, no: Any) -> Any:
        """Return `yes` where the symbolic condition `test` holds, otherwise `no`.

        The value that is not chosen has no influence, even if it is NaN.
        """
        return self._ca.if_else(test, yes, no)

    def both(self, one: Any, other: Any) -> Any:
        """Return a symbolic condition that holds if both given conditions hold."""
        return self._ca.logic_and(one, other)

    def negated(self, one: Any) -> Any:
        """Return a symbolic condition that holds if the given condition does not hold."""
        return self._ca.logic_not(one)

    def _known_or(self, known: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that applies `symbolic` if any argument is a symbol, otherwise `known`."""
        return lambda *given: (symbolic if any(map(self.is_symbol, given)) else known)(*given)

    def _root(self, value: Any) -> Any:
        """Return the square root, near 0 a line instead, because an infinite slope would stop a solver."""
        root = self._ca.sqrt(self._ca.fmax(value, LEAST_SQUARE))
        return self._ca.if_else(value > LEAST_SQUARE, root, value / math.sqrt(LEAST_SQUARE))

    def _interpolated(self, at: Any, points: list[float], values: list[float]) -> Any:
        """Interpolate linearly between ascending points; beyond the ends, the first or last value holds."""
        if not self.is_symbol(at):
            return float(self._ca.pw_lin(self._ca.DM(at), points, values))
        within = self._ca.fmin(self._ca.fmax(at, points[0]), points[-1])
        return self._ca.pw_lin(within, points, values)


@dataclass(frozen=True)
class Functions:
    """CasADi functions of a vehicle.

    Attributes:
        f: x_dot = f(x, u), with u after delays.
        jacobian: A, B = jacobian(x, u), the derivatives of f with respect to x and u.
        step: x = step(x, u) after `length`, with a normalised quaternion; it includes delays.
        start: x = start(eta, nu): thrusters at rest, effects as if the motion had always been constant.
        states: Names of the states.
        commands: Names of the commands.
        length: Length of `step` [s].
    """

    f: Any
    jacobian: Any
    step: Any
    start: Any
    states: tuple[str, ...]
    commands: tuple[str, ...]
    length: float


def functions(vehicle: Vehicle, length: float = STEP, substeps: int = SUBSTEPS) -> Functions:
    """Return the equations of motion of a vehicle as CasADi functions.

    Args:
        vehicle: The vehicle; errors of its DVL are ignored.
        length: Length of `step` [s].
        substeps: Runge-Kutta steps per step.

    Raises:
        DataError: An effect or a thruster of the vehicle is invalid.
        UsageError: CasADi is not installed.
    """
    if importlib.util.find_spec("casadi") is None:
        raise UsageError(
            "casadi is not installed: install hydro's extra `casadi`: pip install 'deep-hydro-sim[casadi]'"
        )
    import casadi as ca

    model, tracer = model_of(vehicle), Tracer(Symbols())
    lagging = [i for i, row in enumerate(model.thrusters) if row[TIME_CONSTANT] > row[LAG_STEP]]
    inner = [f"{table['name']}_{i}" for i, table in enumerate(_states(vehicle, model))]
    timed = bool(any(model.flat[HEADER + CURRENT_TREND : HEADER + CURRENT_TREND + 2]))
    commands = tuple(thruster.name for thruster in vehicle.thruster)
    moving = (*BODY_STATES, *(f"lag_{commands[i]}" for i in lagging), *inner, *(["t"] if timed else []))
    delay = CommandDelays.of([row[DELAY] for row in model.thrusters], length)
    names = (*moving, *(f"past_{commands[i]}_{k + 1}" for i, k in delay.slots))
    x, u, delayed = (
        ca.SX.sym("x", len(names)),
        ca.SX.sym("u", len(commands)),
        ca.SX.sym("delayed", len(commands)),
    )
    body = list(ca.vertsplit(x[:BODY])) + list(ca.vertsplit(x[BODY + len(lagging) : len(moving) - timed]))
    undelayed, time = list(ca.vertsplit(u)) if commands else [], x[len(moving) - 1] if timed else 0.0
    given = list(ca.vertsplit(delayed)) if commands else []
    goals = tracer.call(targets, model, given)
    rotors, lag_rates = list(goals), []
    for place, i in enumerate(lagging):
        rotors[i] = x[BODY + place]
        command = tracer.call(effective, model.thrusters[i], model.curves[i], given[i])
        lag_rates.append(tracer.call(state_derivative, model.thrusters[i], rotors[i], command))
    moved = tracer.call(rates, model, body, time, rotors, undelayed)
    still = [0.0] * len(delay.slots)
    x_dot = ca.vertcat(*moved[:BODY], *lag_rates, *moved[BODY:], *([1.0] if timed else []), *still)
    within = ca.Function("within", [x, delayed, u], [x_dot])
    x_dot = within(x, u, u)
    f = ca.Function("f", [x, u], [x_dot], ["x", "u"], ["x_dot"])
    jacobian = ca.Function(
        "jacobian", [x, u], [ca.jacobian(x_dot, x), ca.jacobian(x_dot, u)], ["x", "u"], ["A", "B"]
    )
    step = _step(within, tracer, delay, length, substeps)
    start = _start(model, tracer, lagging, timed, delay)
    return Functions(f, jacobian, step, start, names, commands, length)


@dataclass(frozen=True)
class CommandDelays:
    """Delays of the thrusters' commands, expressed in steps of one length.

    Attributes:
        whole: Whole steps of delay of each thruster.
        part: Remainder of each thruster's delay [s], below `length`.
        slots: The stored past commands, each as a thruster's index and its age in steps; 0 is the last step.
        length: Length of a step [s].
    """

    whole: tuple[int, ...]
    part: tuple[float, ...]
    slots: tuple[tuple[int, int], ...]
    length: float

    @classmethod
    def of(cls, delays: list[float], length: float) -> CommandDelays:
        """Return the thrusters' delays `delays` [s] expressed in steps of `length` [s]."""
        whole = [math.floor(delay / length + CLOSE) for delay in delays]
        rest = [max(0.0, delay - length * k) for delay, k in zip(delays, whole, strict=True)]
        part = [one if one > CLOSE * length else 0.0 for one in rest]
        slots = [(i, k) for i in range(len(delays)) for k in range(whole[i] + (1 if part[i] > 0.0 else 0))]
        return cls(tuple(whole), tuple(part), tuple(slots), length)

    def parts(self, past: Any, u: Any) -> Iterator[tuple[float, Any]]:
        """Yield the parts of a step, in order, during which no delayed command changes.

        Args:
            past: Past commands in the order of `slots`, a CasADi vector with one entry per slot.
            u: Commands of this step, a CasADi vector with one entry for each of the n thrusters.

        Yields:
            Length of the part [s], and the commands that act during it after their delays, a CasADi column
            (n, 1).  The lengths add up to `length`.
        """
        import casadi as ca

        known = {slot: past[place] for place, slot in enumerate(self.slots)}
        known |= {(i, -1): u[i] for i in range(len(self.whole))}
        for begin, end in itertools.pairwise(sorted({0.0, *self.part, self.length})):
            ago = [k - (part <= begin) for k, part in zip(self.whole, self.part, strict=True)]
            yield end - begin, ca.vertcat(*(known[i, k] for i, k in enumerate(ago)))

    def after(self, past: Any, u: Any) -> list[Any]:
        """Return the stored past commands, in the order of `slots`, after a step with the commands `u`.

        Args:
            past: Past commands before the step, a CasADi vector with one entry per slot.
            u: Commands of the step, a CasADi vector with one entry per thruster.
        """
        known = {slot: past[place] for place, slot in enumerate(self.slots)}
        return [u[i] if k == 0 else known[i, k - 1] for i, k in self.slots]


def _step(within: Any, tracer: Tracer, delay: CommandDelays, length: float, substeps: int) -> Any:
    """Build the classical Runge-Kutta step over `length` [s], split at changes of the delayed commands."""
    import casadi as ca

    x, u = ca.MX.sym("x", within.size1_in(0)), ca.MX.sym("u", within.size1_in(2))
    state, moving = ca.SX.sym("x", within.size1_in(0)), within.size1_in(0) - len(delay.slots)
    whole = ca.vertcat(*tracer.call(normalised, list(ca.vertsplit(state))))
    unit, y = ca.Function("normalised", [state], [whole]), x
    for lasting, delayed in delay.parts(x[moving:], u):
        steps = max(1, math.ceil(lasting * substeps / length - CLOSE))
        h = lasting / steps
        for _ in range(steps):
            a = within(y, delayed, u)
            b = within(y + 0.5 * h * a, delayed, u)
            c = within(y + 0.5 * h * b, delayed, u)
            d = within(y + h * c, delayed, u)
            y = unit(y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    moved = ca.vertcat(y[:moving], *delay.after(x[moving:], u))
    return ca.Function("step", [x, u], [moved], ["x", "u"], ["x_next"])


def _start(model: Model, tracer: Tracer, lagging: list[int], timed: bool, delay: CommandDelays) -> Any:
    """Build the function from pose eta and velocity nu to the state; thrusters and past commands are 0."""
    import casadi as ca

    from hydro.export.craft import quaternion

    eta, nu = ca.SX.sym("eta", 6), ca.SX.sym("nu", 6)
    angles = tracer.call(quaternion, eta[3], eta[4], eta[5])
    body = [*ca.vertsplit(eta[:3]), *angles, *ca.vertsplit(nu)]
    inner = tracer.call(initial_states, model, body, 0.0)
    x = ca.vertcat(*body, *([0.0] * len(lagging)), *inner, *([0.0] * (timed + len(delay.slots))))
    return ca.Function("start", [eta, nu], [x], ["eta", "nu"], ["x"])


def _states(vehicle: Vehicle, model: Model) -> list[Any]:
    """Return, for every internal state, the table of the effect to which it belongs."""
    running = [table for table in vehicle.effect if CATALOGUE[table["name"]].kernel is not None]
    return [table for table, entry in zip(running, model.effects, strict=True) for _ in range(entry[3])]


def without_delays(vehicle: Vehicle) -> Vehicle:
    """Return a copy of the vehicle without command delays, as the exported differential equation f has it."""
    still = without_effects(vehicle, delays)
    return msgspec.structs.replace(
        still, thruster=tuple(msgspec.structs.replace(one, delay=0.0) for one in still.thruster)
    )


def delays(effect: Any) -> bool:
    """Return whether an effect of the catalogue delays commands."""
    if effect.actuator is None:
        return False
    table = np.zeros((1, COLUMNS))
    effect.actuator(np.ones(1), table)
    return bool(table[0, DELAY])


def lacks(vehicle: Vehicle) -> list[Lack]:
    """Return the properties of a vehicle that f cannot represent: DVL errors and command delays."""
    found = lacking_effects(vehicle, sensor_reason)
    if (thruster_table(vehicle)[:, DELAY] > 0.0).any():
        why = "included in step, as past commands; f and jacobian take delayed commands"
        found.append(Lack("command delay", why, without_delays(vehicle)))
    return found


def to_casadi(vehicle: Vehicle) -> bytes:
    """Return a file's content with the CasADi functions f, jacobian, step and start, in this order.

    Raises:
        DataError: An effect or a thruster of the vehicle is invalid.
        UsageError: CasADi is not installed.
    """
    found = functions(vehicle)
    import casadi as ca

    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "vehicle.casadi"
        serializer = ca.FileSerializer(str(place))
        for one in (found.f, found.jacobian, found.step, found.start):
            serializer.pack(one)
        del serializer
        return place.read_bytes()


TARGET = Target(
    name="casadi",
    takes="vehicle",
    suffix=".casadi",
    summary="f(x, u) with lag states, its Jacobians and a Runge-Kutta step as CasADi functions",
    write=to_casadi,
    lacks=lacks,
    text=False,
)
