"""Where things stand in the flat vectors that every wrench kernel reads.

A kernel is called as `kernel(p, c, s, x, dx, tau)` with contiguous float64 vectors:

* `p`: the effect's own parameters, packed in the order in which its record names them, matrices row by row;
* `c`: constants of the vehicle (below);
* `s`: the state of motion (below);
* `x`, `dx`: the effect's internal states and, to be written, their time derivatives;
* `tau`: the wrench X Y Z K M N on the vehicle about CO, body frame; a kernel adds to it.
"""

from __future__ import annotations

# Constants of the vehicle, SI units, body frame FRD about CO.
DENSITY = 0  # rho [kg/m^3]
GRAVITY = 1  # g [m/s^2]
MASS = 2  # dry mass of the vehicle file [kg]
WEIGHT = 3  # W = m g [N]
BUOYANCY = 4  # B of the vehicle file [N]
CENTER_OF_GRAVITY = 5  # 3 [m]
CENTER_OF_BUOYANCY = 8  # 3 [m], with every `buoyancy_offset` applied
FILE_CENTER_OF_BUOYANCY = 11  # 3 [m], as `[buoyancy]` gives it, for the restoring forces
HULL = 14  # length, width, height [m]
HULL_CENTER = 17  # 3 [m]
CURRENT = 20  # v_c, 3 [m/s], NED
ADDED_MASS = 23  # M_A of the fluid, 36, row by row
RIGID_BODY_MASS = 59  # M_RB, 36
MASS_MATRIX = 95  # M = M_RB + M_A + rigid payloads, 36
INVERSE_MASS_MATRIX = 131  # 36
CONSTANTS = 167  # length of c

# State of motion.
RELATIVE_VELOCITY = 0  # nu_r = nu - [R^T v_c; 0], 6
VELOCITY = 6  # nu over ground, 6
ROTATION = 12  # R, body FRD -> NED, 9, row by row
POSITION = 21  # x y z of CO, NED, 3
MOTION = 24  # length of s
