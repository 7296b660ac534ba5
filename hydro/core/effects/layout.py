"""Calling convention of the functions of effects, and the layout of their vectors.

All of them work in place: they return nothing and write to their last argument, so that a time step allocates
no memory and several effects add up.  Arguments are contiguous float64 arrays in SI units.

* wrench kernel `f(p, c, s, x, dx, tau)`: adds the effect's wrench to `tau`, and sets `dx`;
* start `f(p, c, s, x)`: sets `x` to its value in steady motion;
* inertia `f(p, matrix)`: adds to the mass matrix (6, 6) about CO;
* flow `f(p, flow)`: adds to the velocity of the water (7,), see `catalogue.current`;
* actuator `f(p, table)`: changes the thruster table (thrusters, columns), see `vehicle.thrusters`;
* sensor `f(p, log)`: changes the row of DVL errors, see `core.effects.sensor`.

The arguments are:

* `p`: the effect's parameters in the order of its record, matrices row by row;
* `c`: constants of the vehicle (CONSTANTS,), with the indices below;
* `s`: the state of motion (MOTION,), with the indices below;
* `x`, `dx`: the effect's internal states and their time derivatives (states,);
* `tau`: wrench on the vehicle about CO, body frame FRD: X Y Z [N], K M N [N m] (6,).
"""

from __future__ import annotations

# Constants of the vehicle, SI units, body frame FRD about CO.
DENSITY = 0  # rho [kg/m^3]
GRAVITY = 1  # g [m/s^2]
MASS = 2  # dry mass [kg]
BUOYANCY = 3  # B of the vehicle file [N]
BALANCE = 4  # weight and buoyancy as `rigid_body.balance` gives them, 4
CENTER_OF_GRAVITY = 8  # 3 [m]
CENTER_OF_BUOYANCY = 11  # 3 [m], with every `buoyancy_offset` applied
HULL = 14  # length, width, height [m]
HULL_CENTER = 17  # 3 [m]
CURRENT = 20  # v_c at z = 0, 3 [m/s], NED
CURRENT_GRADIENT = 23  # gradient of v_N and v_E with depth, 2 [1/s]
CURRENT_TREND = 25  # rate of v_N and v_E with time, 2 [m/s^2]
FLOW = slice(CURRENT, CURRENT_TREND + 2)  # all three, from `catalogue.current`
ADDED_MASS = 27  # M_A of the water alone, 36, row by row
INERTIA = 63  # contribution of the effects to M_RB: M_A and rigid payloads, 36
MASS_MATRIX = 99  # M = M_RB + INERTIA, 36
INVERSE_MASS_MATRIX = 135  # 36
CONSTANTS = 171  # length of c

# State of motion.
RELATIVE_VELOCITY = 0  # nu_r = nu - [R^T v_c(z, t); 0], 6, waves among v_c
VELOCITY = 6  # nu over ground, 6
ROTATION = 12  # R, body FRD -> NED, 9, row by row
POSITION = 21  # x y z of CO, NED, 3
TIME = 24  # t of the session [s]
WATER_RATE = 25  # rate of the water's velocity in waves at a fixed place, 3 [m/s^2], NED; 0 without
WATER_GROWTH = 28  # its gradient with depth, 3 [1/s]
COMMANDS = 31  # as given in this row, before any delay, of the first MOST_COMMANDS thrusters
MOST_COMMANDS = 16
COMMAND_NAMES = tuple(f"c{i + 1}" for i in range(MOST_COMMANDS))  # names in a vehicle file
MOTION = COMMANDS + MOST_COMMANDS  # length of s
