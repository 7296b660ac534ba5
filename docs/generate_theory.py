"""Write docs/theory.md from the catalogue of effects; `make docs` runs it and a test compares."""

# ruff: noqa: E501 - a table of the page has one line per row

from __future__ import annotations

import inspect
from pathlib import Path
from types import ModuleType

from hydro.core.effects import Effect, Parameter, describe
from hydro.core.effects.catalogue import FAMILIES

PAGE = Path(__file__).with_name("theory.md")
INTRODUCTION = r"""# Theory

`make docs` generates this page from the catalogue. Do not edit it.

This page contains the equations of motion and every physical effect of a vehicle file. Symbols and signs are those of
Fossen, *Handbook of Marine Craft Hydrodynamics and Motion Control* (2011), and SNAME (1950); all units are SI.

## Frames and symbols

| symbol | meaning |
|---|---|
| $`\eta = (x, y, z, \phi, \theta, \psi)`$ | position of the body origin CO in the world (north, east, down) and ZYX Euler angles |
| $`\nu = (u, v, w, p, q, r) = (v, \omega)`$ | velocity of CO over ground and angular velocity, in the body frame (forward, right, down) |
| $`\tau = (X, Y, Z, K, M, N)`$ | force and moment about CO, in the body frame, **on** the vehicle unless said otherwise |
| $`R`$ | rotation from body to world |
| $`v_c`$ | velocity of the water in the world |
| $`\nu_r = \nu - [R^T v_c;\ 0]`$ | velocity through the water, in equations below written `nu_r = (u_r, v_r, w_r, p, q, r)` |
| $`M_{RB},\ M_A`$ | mass matrix of the dry vehicle and added mass, both about CO |
| $`C(\nu)`$ | Coriolis matrix made from a mass matrix by the skew parametrisation (theorem 3.2): $`\nu^T C(\nu)\,\nu = 0`$ |

CO is the origin of the coordinates in the vehicle file, not the centre of gravity.

## The balance

```math
M_{RB}\,\dot\nu + C_{RB}(\nu)\,\nu = \tau_{prop} + \tau_{restoring}(\eta) + \sum \tau_{effect}
```

Every effect below adds a wrench to the right-hand side or modifies an existing term. Added mass is solved with the rigid body, so the integrated
balance is

```math
M\,\dot\nu_r + C(\nu_r)\,\nu_r = \tau_{prop} + \tau_{restoring} + \sum \tau_{wrench}, \qquad M = M_{RB} + M_A,
\qquad \dot\nu_r = \dot\nu + [\omega \times R^T v_c;\ 0]
```

The rigid-body terms may use $`\nu_r`$ because a steady, uniform current is an inertial frame (property 8.1). The last term appears because a
current that is constant in the world rotates in the body frame.

Restoring: weight $`W`$ down at the centre of gravity, buoyancy $`B`$ up at the centre of buoyancy (equation 4.6).

Thrusters: a command $`u_i \in [-1, 1]`$ is clipped and delayed. It then passes dead band, curve and first-order lag in the order of the
vehicle file. Gain, asymmetry and inflow follow, and $`\tau_{prop} = B f`$ with one column of $`B`$ per thruster. The command of a row acts until
the next row. A curve may be a [table of thrust by command and supply voltage](map.md#thrust-by-supply-voltage): then $`u_i`$ is the effective command, which gives the
thrust of the table with a simple curve. Dead band and power of the curve then act on shares of full thrust.

## The residual

The residual wrench of a recording is

```math
\tau_{res} = \tau_{prop} - M\,\dot\nu + \tau_{restoring} \ \approx\ C(\nu)\,\nu + D(\nu)\,\nu
```

It opposes motion: the force on the vehicle is $`-\tau_{res}`$. `hydro labels` subtracts the added mass of the vehicle file through
$`M`$, and no other wrench. `hydro labels --subtract effects` also subtracts all other effects: damping and other wrenches, $`C_A(\nu_r)\,\nu_r`$,
and the contribution of the current to $`\dot\nu_r`$. With a complete file the residual is $`C_{RB}(\nu)\,\nu`$, because the rigid body is not an effect.

A simulation with a learned residual uses exactly the terms that its labels exclude. It has $`M_A`$ in the mass matrix and omits
$`C_{RB}`$, which the residual contains. With `--subtract effects` all effects, including $`C_A`$, also act. A simulation without a residual
omits nothing.

Velocity and acceleration of a recording without nulls come from one filter per axis with white jerk. For sparse samples, an
error-state Kalman filter and a fixed-interval smoother fuse pose, velocity and rates: $`\dot x = R v`$, $`\dot R = R\,[\omega]_\times`$, with white noise in the
derivatives of $`\dot\nu`$ and $`\ddot\nu`$. A row has a label where attitude, velocity and acceleration are sufficiently determined. The standard deviation
of $`\tau_{res}`$ is that of $`M\,\dot\nu`$ alone.

## Effects

Parameters are increments on the vehicle file: 0 means no effect, and effects of one name add up. Those of inertia and damping
are entries of $`M_A`$ and $`D`$, the negatives of the SNAME derivatives, with rows and columns counted from 0: `M_A[1,5]` $`= -Y_{\dot r}`$,
`D[1,5]` $`= -Y_r`$. The sum of all added mass must be symmetric and positive semi-definite, and so must the symmetric part of the sum of all linear
damping; `hydro check` tests this.

| kind | acts on |
|---|---|
| wrench | the force and moment on the vehicle |
| inertia | the mass matrix, and the Coriolis terms that come with it |
| flow | the velocity of the water |
| actuator | the thruster chain |
| sensor | the readings of the DVL, never the motion |

A value with a `standard_error` (`standard_error = {d = 0.01}`) is a prior in a fit of a new recording. A `known` value (`known = true`, or
`known = ["d"]`) is not re-estimated. A vehicle may have several of `payload`, `tether`, `control_surface`, `offset_drag` and `ocean_waves`: one with a label
(`label = "rudder"`) is named `control_surface:rudder`, others `control_surface:1`, `control_surface:2` in file order. The
name alone selects all of them. *Plausible* ranges do not restrict files or fits; `fit`, `diagnose` and `hydro check` report values outside.

For each effect, *needs* is the motion that a recording must contain to determine its parameters, and *easily taken for* names the effects that explain
similar data. `hydro effects NAME` prints an entry with a table for a vehicle file.
"""

REFERENCES = """## References

- Cummins, W. E. (1962). The impulse response function and ship motions. *Schiffstechnik* 9, 101-109.
- Fossen, T. I. (1994). *Guidance and Control of Ocean Vehicles*. Wiley.
- Fossen, T. I. (2011). *Handbook of Marine Craft Hydrodynamics and Motion Control*. Wiley.
- Hasselmann, K. et al. (1973). Measurements of wind-wave growth and swell decay during the Joint North Sea Wave Project (JONSWAP). *Ergänzungsheft zur Deutschen Hydrographischen Zeitschrift* A8 (12).
- Hoerner, S. F. (1965). *Fluid-Dynamic Drag*. Published by the author.
- Kinsey, J. C. and Whitcomb, L. L. (2007). In situ alignment calibration of attitude and Doppler sensors for precision underwater vehicle navigation: theory and experiment. *IEEE Journal of Oceanic Engineering* 32(2), 286-299.
- Lewis, E. V. (ed.) (1988). *Principles of Naval Architecture*, volume I: Stability and Strength. SNAME.
- Morison, J. R., O'Brien, M. P., Johnson, J. W. and Schaaf, S. A. (1950). The force exerted by surface waves on piles. *Petroleum Transactions, AIME* 189, 149-154.
- Newman, J. N. (1977). *Marine Hydrodynamics*. MIT Press.
- Prestero, T. (2001). *Verification of a six-degree of freedom simulation model for the REMUS autonomous underwater vehicle*. Master's thesis, MIT and WHOI.
- SNAME (1950). *Nomenclature for treating the motion of a submerged body through a fluid*. Technical and Research Bulletin 1-5.
- Yoerger, D. R., Cooke, J. G. and Slotine, J.-J. E. (1990). The influence of thruster dynamics on underwater vehicle behavior and their incorporation into control system design. *IEEE Journal of Oceanic Engineering* 15(3), 167-178.
"""


def page() -> str:
    """Return the whole page: conventions, balance, one section per family and one entry per effect."""
    contents = "\n".join(
        f"- [{_title(family)}](#{_title(family).lower().replace(' ', '-')}): "
        + ", ".join(f"[`{effect.name}`](#{effect.name})" for effect in family.EFFECTS)
        for family in FAMILIES
    )
    sections = [_section(family) for family in FAMILIES]
    return "\n".join([INTRODUCTION, contents, "", *sections, REFERENCES])


def _section(family: ModuleType) -> str:
    """Return the section of a family of effects."""
    entries = "\n".join(_entry(effect) for effect in family.EFFECTS)
    return f"## {_title(family)}\n\n{_paragraphs(inspect.getdoc(family) or '')}\n\n{entries}"


def _entry(effect: Effect) -> str:
    """Return the entry of an effect: description, equation, parameters, and similar effects."""
    rows = "\n".join(_row(effect, parameter) for parameter in effect.parameters)
    alike = ", ".join(f"[`{name}`](#{name})" for name in effect.lookalikes)
    plausible = "; ".join(dict.fromkeys(one.plausible.source for one in effect.parameters if one.plausible))
    return f"""### `{effect.name}`

    {effect.definition}

{_paragraphs(effect.description)}

| parameter | unit | numbers | bounds | plausible | if left out | meaning |
|---|---|---|---|---|---|---|
{rows}

- *Kind*: {effect.kind}
- *Needs*: {effect.excitation}
- *Easily taken for*: {alike}
- *Plausible by*: {plausible}
- *Source*: {effect.source}
"""


def _row(effect: Effect, parameter: Parameter) -> str:
    """Return the table row of a parameter."""
    cells = (
        f"`{parameter.name}`",
        describe.unit(parameter),
        describe.size(parameter),
        describe.bounds(parameter),
        describe.plausible(parameter),
        describe.when_left_out(effect, parameter),
        parameter.meaning,
    )
    return f"| {' | '.join(cells)} |"


def _title(family: ModuleType) -> str:
    """Return the heading of a family: the capitalised name of its file."""
    return family.__name__.rpartition(".")[2].capitalize()


def _paragraphs(text: str) -> str:
    """Return the paragraphs of a docstring, each on one line; indented parts stay equations."""
    parts = [part if part.startswith("    ") else " ".join(part.split()) for part in text.split("\n\n")]
    return "\n\n".join(parts)


if __name__ == "__main__":
    PAGE.write_text(page())
