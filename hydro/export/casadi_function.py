"""Target `casadi`: the equations of motion as CasADi functions, for controllers and optimisation.

They are traced from the same kernels that `simulate` runs (`export.tracing`).  The state x holds position
(3), quaternion body to NED (4), nu (6), the lag states of the thrusters that have one, the internal states of
effects, and the time where a current changes with it; u are commands in [-1, 1].
"""

from __future__ import annotations

import importlib.util
import math
import tempfile
from collections.abc import Callable, Mapping
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
from hydro.export.equations import Model, beginning, effective, interpolated, normalised, rates, targets
from hydro.export.numbers import model_of
from hydro.export.targets import Lack, Target, lacking, of_sensors, without_effects
from hydro.export.tracing import Tracer

BODY_STATES = ("x", "y", "z", "q_w", "q_x", "q_y", "q_z", "u", "v", "w", "p", "q", "r")
STEP = 0.02
"""Length of the step in an exported file [s]; `functions` makes one of any length."""
LEAST_SQUARE = 1e-12
"""Squares below it are as good as 0."""
SUBSTEPS = 10
"""Runge-Kutta steps in it: 2 ms each, as in `simulate`."""


class Symbols:
    """CasADi for the tracer."""

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
        """Whether a value is CasADi's."""
        return isinstance(value, self._ca.SX)

    def select(self, test: Any, yes: Any, no: Any) -> Any:
        """One of two values, the other one never in the result, even where it is not finite."""
        return self._ca.if_else(test, yes, no)

    def both(self, one: Any, other: Any) -> Any:
        """Whether both hold."""
        return self._ca.logic_and(one, other)

    def negated(self, one: Any) -> Any:
        """Whether it does not hold."""
        return self._ca.logic_not(one)

    def _known_or(self, known: Callable[..., Any], symbolic: Callable[..., Any]) -> Callable[..., Any]:
        """A function of numbers, and the same of symbols."""
        return lambda *given: (symbolic if any(map(self.is_symbol, given)) else known)(*given)

    def _root(self, value: Any) -> Any:
        """The square root, straight near 0, where it has no derivative and would end a solver."""
        root = self._ca.sqrt(self._ca.fmax(value, LEAST_SQUARE))
        return self._ca.if_else(value > LEAST_SQUARE, root, value / math.sqrt(LEAST_SQUARE))

    def _interpolated(self, at: Any, points: list[float], values: list[float]) -> Any:
        """A value between points on straight lines; the ends hold beyond them."""
        if not self.is_symbol(at):
            return float(self._ca.pw_lin(self._ca.DM(at), points, values))
        within = self._ca.fmin(self._ca.fmax(at, points[0]), points[-1])
        return self._ca.pw_lin(within, points, values)


@dataclass(frozen=True)
class Functions:
    """A vehicle in CasADi.

    Attributes:
        f: x_dot = f(x, u).
        jacobian: A, B = jacobian(x, u), the derivatives of f by x and by u.
        step: x = step(x, u) after `length`, the quaternion of length 1.
        start: x = start(eta, nu): at rest thrusters, effects as if the motion had always been.
        states: Names of the states.
        commands: Names of the commands.
        length: Of `step` [s].
    """

    f: Any
    jacobian: Any
    step: Any
    start: Any
    states: tuple[str, ...]
    commands: tuple[str, ...]
    length: float


def functions(vehicle: Vehicle, length: float = STEP, substeps: int = SUBSTEPS) -> Functions:
    """The equations of motion of a vehicle as CasADi functions.

    Args:
        vehicle: The vehicle; what `lacks` lists is left out.
        length: Of `step` [s].
        substeps: Runge-Kutta steps in it.

    Raises:
        DataError: An effect or a thruster of the vehicle is at fault.
        UsageError: CasADi is not installed.
    """
    if importlib.util.find_spec("casadi") is None:
        raise UsageError(
            "casadi is not installed: install hydro's extra `casadi`: pip install 'deep-hydro-sim[casadi]'"
        )
    import casadi as ca

    vehicle = held(vehicle)
    model, tracer = model_of(vehicle), Tracer(Symbols())
    lagging = [i for i, row in enumerate(model.thrusters) if row[TIME_CONSTANT] > row[LAG_STEP]]
    inner = [f"{table['name']}_{i}" for i, table in enumerate(_states(vehicle, model))]
    timed = bool(any(model.flat[HEADER + CURRENT_TREND : HEADER + CURRENT_TREND + 2]))
    commands = tuple(thruster.name for thruster in vehicle.thruster)
    names = (*BODY_STATES, *(f"lag_{commands[i]}" for i in lagging), *inner, *(["t"] if timed else []))
    x, u = ca.SX.sym("x", len(names)), ca.SX.sym("u", len(commands))
    body = list(ca.vertsplit(x[:BODY])) + list(ca.vertsplit(x[BODY + len(lagging) : len(names) - timed]))
    given, time = list(ca.vertsplit(u)) if commands else [], x[len(names) - 1] if timed else 0.0
    goals = tracer.call(targets, model, given)
    rotors, lag_rates = list(goals), []
    for place, i in enumerate(lagging):
        rotors[i] = x[BODY + place]
        command = tracer.call(effective, model.thrusters[i], model.curves[i], given[i])
        lag_rates.append(tracer.call(state_derivative, model.thrusters[i], rotors[i], command))
    moved = tracer.call(rates, model, body, time, rotors, given)
    x_dot = ca.vertcat(*moved[:BODY], *lag_rates, *moved[BODY:], *([1.0] if timed else []))
    f = ca.Function("f", [x, u], [x_dot], ["x", "u"], ["x_dot"])
    jacobian = ca.Function(
        "jacobian", [x, u], [ca.jacobian(x_dot, x), ca.jacobian(x_dot, u)], ["x", "u"], ["A", "B"]
    )
    step = _step(f, tracer, length, substeps)
    return Functions(f, jacobian, step, _start(model, tracer, lagging, timed), names, commands, length)


def _step(f: Any, tracer: Tracer, length: float, substeps: int) -> Any:
    """The classical Runge-Kutta method over `length` [s]."""
    import casadi as ca

    x, u = ca.MX.sym("x", f.size1_in(0)), ca.MX.sym("u", f.size1_in(1))
    h, state = length / substeps, ca.SX.sym("x", f.size1_in(0))
    whole = ca.vertcat(*tracer.call(normalised, list(ca.vertsplit(state))))
    unit, y = ca.Function("normalised", [state], [whole]), x
    for _ in range(substeps):
        a = f(y, u)
        b = f(y + 0.5 * h * a, u)
        c = f(y + 0.5 * h * b, u)
        d = f(y + h * c, u)
        y = unit(y + h / 6.0 * (a + 2.0 * b + 2.0 * c + d))
    return ca.Function("step", [x, u], [y], ["x", "u"], ["x_next"])


def _start(model: Model, tracer: Tracer, lagging: list[int], timed: bool) -> Any:
    """The state of a pose and a velocity."""
    import casadi as ca

    from hydro.export.craft import quaternion

    eta, nu = ca.SX.sym("eta", 6), ca.SX.sym("nu", 6)
    angles = tracer.call(quaternion, eta[3], eta[4], eta[5])
    body = [*ca.vertsplit(eta[:3]), *angles, *ca.vertsplit(nu)]
    inner = tracer.call(beginning, model, body, 0.0)
    x = ca.vertcat(*body, *([0.0] * len(lagging)), *inner, *([0.0] if timed else []))
    return ca.Function("start", [eta, nu], [x], ["eta", "nu"], ["x"])


def _states(vehicle: Vehicle, model: Model) -> list[Any]:
    """The effect's table of every internal state."""
    running = [table for table in vehicle.effect if CATALOGUE[table["name"]].kernel is not None]
    return [table for table, entry in zip(running, model.effects, strict=True) for _ in range(entry[3])]


def held(vehicle: Vehicle) -> Vehicle:
    """The vehicle as the functions have it: thrusters that feel commands at once."""
    still = without_effects(vehicle, delays)
    return msgspec.structs.replace(
        still, thruster=tuple(msgspec.structs.replace(one, delay=0.0) for one in still.thruster)
    )


def delays(effect: Any) -> bool:
    """Whether an effect delays commands."""
    if effect.actuator is None:
        return False
    table = np.zeros((1, COLUMNS))
    effect.actuator(np.ones(1), table)
    return bool(table[0, DELAY])


def lacks(vehicle: Vehicle) -> list[Lack]:
    """Errors of the velocity log, and delays, which no ordinary differential equation has."""
    found = lacking(vehicle, of_sensors)
    if (thruster_table(vehicle)[:, DELAY] > 0.0).any():
        why = "f(x, u) knows no past; append the last commands to the state of the controller"
        found.append(Lack("command delay", why, held(vehicle)))
    return found


def to_casadi(vehicle: Vehicle) -> bytes:
    """f, jacobian, step and start in one file, in this order.

    Raises:
        DataError: An effect or a thruster of the vehicle is at fault.
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
