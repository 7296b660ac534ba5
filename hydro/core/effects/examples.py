"""Examples of effects on the command line, for help that loads nothing heavy."""

from __future__ import annotations

TO_LOOK_UP = "ocean_current"
TO_HIDE = "ocean_current={v_N=0.3, v_E=0.1}"
TO_FIT = "quadratic_damping"
TO_FIT_FROM = "tether={anchor=[0, 0, 5]}"
