"""A wrench beside the effects that is held over a control step: a residual network's.

The state of motion `s` of a vehicle that has one is longer than `effects.layout.MOTION`.  What stands behind
it adds to the right-hand side of the balance

    C_K(nu) nu - D nu - h

with the wrench h, which stands on the left as a label does, the inertia K whose Coriolis and centripetal
forces the network brings itself or has no use for, and the damping D of a passive network, which goes on with
the present velocity.  nu is the velocity that the network is asked about, over ground or through the water.
"""

from __future__ import annotations

from hydro.core.columns import Array
from hydro.core.compiled import kernel
from hydro.core.effects.layout import MOTION
from hydro.core.vehicle.rigid_body import coriolis_kernel

FELT = MOTION  # where in `s` the velocity nu begins: RELATIVE_VELOCITY or VELOCITY
WRENCH = MOTION + 1  # h, 6 [N, N m]
CANCELLED = MOTION + 7  # K, 36
DAMPING = MOTION + 43  # D, 36
WITH_HELD = MOTION + 79
"""Length of a state of motion with a held wrench."""


@kernel
def exert_held(s: Array, tau: Array) -> None:
    """Add the held wrench at the present velocity to `tau` (6,), body frame about CO [N, N m]."""
    at = int(s[FELT])
    nu = s[at : at + 6]
    coriolis_kernel(s[CANCELLED : CANCELLED + 36], nu, tau)
    for i in range(6):
        tau[i] -= s[WRENCH + i]
        for j in range(6):
            tau[i] -= s[DAMPING + 6 * i + j] * nu[j]
