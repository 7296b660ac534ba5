"""Memory of the fluid: forces that depend on past motion (Cummins 1962; Fossen 2011, section 5.4)."""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import jit
from hydro.core.effects.layout import RELATIVE_VELOCITY
from hydro.core.effects.record import Effect, Parameter


@jit
def fluid_memory(p: Array, c: Array, s: Array, x: Array, dx: Array, tau: Array) -> None:
    """Wrench -K (nu_r - a x) with x' = nu_r - a x, for every rate a and axis.

    It equals -int_{-inf}^t K exp(-a (t - t')) nu_r_dot(t') dt': the convolution of Cummins' equation with a
    sum of exponentials, in state-space form.  Steady motion has a x = nu_r and no force, so that damping
    keeps the steady part.  For K >= 0 it is passive, with the storage 1/2 a K x^2.
    """
    rates = p.size // 7
    for k in range(rates):
        rate = p[6 * rates + k]
        for i in range(6):
            change = s[RELATIVE_VELOCITY + i] - rate * x[6 * k + i]
            dx[6 * k + i] = change
            tau[i] -= p[6 * k + i] * change


@jit
def steady_past(p: Array, c: Array, s: Array, x: Array) -> None:
    """x(0) = nu_r/a: as if the present motion had always been."""
    rates = p.size // 7
    for k in range(rates):
        for i in range(6):
            x[6 * k + i] = s[RELATIVE_VELOCITY + i] / p[6 * rates + k]


def states(p: Array) -> int:
    """Six states per rate."""
    return 6 * (p.size // 7)


EFFECTS = (
    Effect(
        name="fluid_memory",
        family="memory",
        kind="wrench",
        definition="-K (nu_r - a x), x' = nu_r - a x, x(0) = nu_r/a",
        source="Cummins (1962); Fossen (2011), section 5.4",
        excitation="accelerations over times both shorter and longer than 1/a",
        lookalikes=("added_mass", "linear_damping", "thruster_lag"),
        parameters=(
            Parameter(
                "K", ("N s/m", "N m s"), "strength, six axes per rate", ("rates", 6), 0.0, required=True
            ),
            Parameter("rates", ("1/s",), "rates of decay a", ("rates",), low=1e-3, required=True),
        ),
        kernel=fluid_memory,
        states=states,
        start=steady_past,
    ),
)
