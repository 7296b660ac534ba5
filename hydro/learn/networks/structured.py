"""Structured model: a wrench that cannot add energy to the vehicle, for any weights.

    tau_res = C(nu) nu + D(nu) nu,      D = (1 + |nu|) A(nu) A(nu)^T

C comes from a learned symmetric inertia by the skew-symmetric parametrisation (Fossen, theorem 3.2), so
nu^T C nu = 0.  D is positive semi-definite by construction.  The force on the vehicle is -D nu, so it loses
the power (1 + |nu|) |A^T nu|^2, which is never negative.

A network computes A from the direction of motion and from 1 / (1 + |nu|), which separates skin friction from
form drag.  |nu| is the root mean square of the standardised velocities.  These inputs are bounded, so beyond
the training data drag grows as the square of the speed, as it does in water.

The wrench has no other term, in particular no mean: at rest it is 0.  Acceleration is not an input, because a
force that depends on a filtered acceleration can do work.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from hydro.core.distillation.features import names
from hydro.learn.networks.residual import AXES, Residual, chain

CONTEXT = 7  # inputs of the network of A
INERTIA_TIME = 10.0  # physical inertia per unit of the parameter `inertia`, in units of the scales [s]
SLOW = 0.1  # speed below which the direction of motion fades, in units of the training data's speed
TINY = 1e-12  # keeps the derivative of a square root finite


class Structured(Residual):
    """Network whose wrench C(nu) nu + D(nu) nu cannot add energy: learned inertia, D = (1 + |nu|) A A^T.

    Tensors: `layers.<i>.*` map `context` to the 36 entries of A, row by row, with SiLU between; `inertia` (6,
    6) enters with its symmetric part.  Both are in units of the scalers.  With o the scales of the wrench, v
    those of nu, and r = sqrt(o / v), the physical A is r[i] A[i, j].  The physical inertia is r[i] inertia[i,
    j] r[j] x 10 s; the factor lets the small steps of the optimiser move it far enough.
    """

    def __init__(self, *, features: str, layers: Sequence[int]) -> None:
        if features != "raw" or layers[0] != CONTEXT or layers[-1] != AXES * AXES:
            raise ValueError(
                f"layers {list(layers)} must lead from {CONTEXT} numbers, of features raw, to 36"
            )
        super().__init__(inputs=len(names(features)), features=features)
        self.layers = chain(layers)
        self.inertia = nn.Parameter(torch.eye(AXES) / INERTIA_TIME)
        with torch.no_grad():  # start with the drag and inertia that the scales suggest
            last = self.get_parameter(f"layers.{len(self.layers) - 1}.bias")
            last.copy_(0.5 * torch.eye(AXES).flatten())

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6) for standardised features (N, 12)."""
        return (self.wrench(inputs) - self.output_mean) / self.output_scale

    def forward(self, features: Tensor) -> Tensor:
        """Return tau_res (N, 6) [N, N m], body FRD, order X Y Z K M N, for features (N, 12)."""
        return self.wrench((features - self.input_mean) / self.input_scale)

    def wrench(self, inputs: Tensor) -> Tensor:
        """Return the wrench (N, 6) [N and N m] of standardised features (N, 12)."""
        nu = self.input_mean[:AXES] + self.input_scale[:AXES] * inputs[:, :AXES]
        return self.coriolis(nu) + self.dissipation(nu)

    def coriolis(self, nu: Tensor) -> Tensor:
        """Return the wrench C(nu) nu (N, 6) [N, N m] of the learned inertia for velocities nu (N, 6).

        It is orthogonal to nu.
        """
        root = self.root()
        momentum = nu @ (root[:, None] * (0.5 * INERTIA_TIME) * (self.inertia + self.inertia.T) * root)
        linear, angular = momentum[:, :3], momentum[:, 3:]
        v, omega = nu[:, :3], nu[:, 3:]
        force = torch.linalg.cross(omega, linear)
        moment = torch.linalg.cross(v, linear) + torch.linalg.cross(omega, angular)
        return torch.cat([force, moment], dim=1)

    def dissipation(self, nu: Tensor) -> Tensor:
        """Return the damping wrench D(nu) nu (N, 6) [N, N m] for velocities nu (N, 6)."""
        *hidden_layers, last = self.layers
        scaled = nu / self.input_scale[:AXES]
        speed = (scaled.square().mean(dim=1, keepdim=True) + TINY).sqrt()
        x = context(scaled, speed)
        for layer in hidden_layers:
            x = nn.functional.silu(layer(x))
        A: Tensor = last(x).reshape(-1, AXES, AXES)
        root = self.root()
        projected = (A * (root * nu).unsqueeze(2)).sum(dim=1, keepdim=True)
        drag: Tensor = (1.0 + speed) * root * (A * projected).sum(dim=2)
        return drag

    def root(self) -> Tensor:
        """Return sqrt(o / v) per axis (6,), for the scales o of the wrench and v of nu.

        Units are sqrt(N s/m) for forces and sqrt(N m s/rad) for moments.
        """
        return (self.output_scale / self.input_scale[:AXES]).sqrt()


def context(scaled: Tensor, speed: Tensor) -> Tensor:
    """Return the 7 inputs (N, 7) of the layers that compute A: direction of motion, and 1 / (1 + |nu|).

    Args:
        scaled: Standardised velocities (N, 6).
        speed: |nu|, their root mean square (N, 1); the direction fades below SLOW.
    """
    return torch.cat([scaled / (SLOW + speed), 1.0 / (1.0 + speed)], dim=1)
