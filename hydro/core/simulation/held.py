"""Wrench of a residual network, held over a control step.

The state of motion `s` of a vehicle with a network is longer than `effects.layout.MOTION`.  The additional
components add to the right-hand side of the equation of motion

    C_K(nu) nu - D nu - h

h is the wrench of the network; like a label, it is defined on the left-hand side, so its sign is negative
here.  K is the inertia whose Coriolis and centripetal forces C_K(nu) nu the network already contains or does
not need.  D is the damping of a passive network; it acts on the present velocity.  nu is the input velocity
of the network, over ground or through the water.
"""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.layout import MOTION
from hydro.core.vehicle.rigid_body import coriolis_kernel

FELT = MOTION  # index in `s` of the velocity nu: RELATIVE_VELOCITY or VELOCITY
WRENCH = MOTION + 1  # h, 6 [N, N m]
CANCELLED = MOTION + 7  # K, 36
DAMPING = MOTION + 43  # D, 36
WITH_HELD = MOTION + 79
"""Length of a state of motion that includes a held wrench."""


@kernel
def exert_held(s: Array, tau: Array) -> None:
    """Add to `tau` the part of a residual network's wrench that changes within a control step.

    The sum is C_K(nu) nu - D nu - h, with the velocity nu, the wrench h that the network gave at the start of
    the step, the damping matrix D, and the Coriolis matrix C_K of the mass matrix K; both are in `s`.

    Args:
        s: State of motion of length WITH_HELD; nu is the present velocity.
        tau: Wrench about CO in body axes, (6,) [N, N m], added to.
    """
    at = int(s[FELT])
    nu = s[at : at + 6]
    coriolis_kernel(s[CANCELLED : CANCELLED + 36], nu, tau)
    for i in range(6):
        tau[i] -= s[WRENCH + i]
        for j in range(6):
            tau[i] -= s[DAMPING + 6 * i + j] * nu[j]
