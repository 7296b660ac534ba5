"""Mean of a Gaussian process of a hull's wrench with mirror symmetry; for minutes of data.

`core.residual.mirrors` defines the function and its weights; `learn.gaussian_process` fits the weights to
labels without gradient descent.  Accelerations are not an input.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hydro.core.distillation.features import names
from hydro.core.residual.mirrors import (
    EPSILON,
    MIRRORS,
    PORT,
    POWERS,
    PRODUCTS,
    SIGNED,
    STAGES,
    SUMS,
    TINY,
    WIDTH,
)
from hydro.learn.networks.residual import AXES, Residual


class GaussianProcess(Residual):
    """Network with the mean of a Gaussian process: radial functions of the motion's direction, and products.

    Its k points are the motion directions in which the radial functions have their centres.  Tensors `centre`
    (3,) [m], `scale` (6,), `top` (1,), `steering` (6, 3), and by stage `linear` (2, 6, 6), `library` (2, 3,
    57, 6), `points` (k, 6), and `weights` (k, 2, 3, 3, 6), whose wrenches are in N and N m.  Their meaning is
    in `core.residual.mirrors`.
    """

    mirrors: Tensor

    def __init__(self, *, features: str, points: int) -> None:
        if features != "raw" or points < 1:
            raise ValueError(
                f"{points} points of features {features}: give at least one point, and features raw"
            )
        super().__init__(inputs=len(names(features)), features=features)
        self.centre = nn.Parameter(torch.zeros(3))
        self.scale = nn.Parameter(torch.ones(AXES))
        self.top = nn.Parameter(torch.full((1,), 2.0))
        self.steering = nn.Parameter(torch.randn(AXES, 3))
        self.linear = nn.Parameter(torch.randn(STAGES, AXES, AXES))
        self.library = nn.Parameter(torch.randn(STAGES, POWERS, PRODUCTS, AXES))
        self.points = nn.Parameter(nn.functional.normalize(torch.randn(points, AXES), dim=1))
        self.weights = nn.Parameter(torch.randn(points, STAGES, SUMS, POWERS, AXES))
        self.register_buffer("mirrors", torch.from_numpy(MIRRORS), persistent=False)

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6) for standardised features (N, 12)."""
        wrench = self.forward(self.input_mean + self.input_scale * inputs)
        return (wrench - self.output_mean) / self.output_scale

    def forward(self, features: Tensor) -> Tensor:
        """Return tau_res (N, 6) [N, N m], body FRD, order X Y Z K M N, for features (N, 12)."""
        nu = features[:, :AXES].double()  # weights of neighbouring points nearly cancel
        centre = self.centre.double()[None]
        v = nu[:, :3] + torch.linalg.cross(nu[:, 3:], centre)
        z = torch.cat([v, nu[:, 3:]], dim=1) * self.scale.double()
        beyond = (_size(z) / self.top.double()).clamp(min=1.0)
        z = z / beyond
        m = _size(z)
        d = z / m
        products, images = _products(d), self._images(d)
        library, weights = self.library.double(), self.weights.double()
        stages = []
        for stage in range(STAGES):
            tau = z @ self.linear[stage].double().T
            for power in range(POWERS):
                radial = self._radial(images, weights[:, stage, :, power])
                tau = tau + m ** (power + 1) * (products @ library[stage, power] + radial)
            stages.append(tau)
        drag = stages[0] - m.square() * (products[:, SIGNED:] @ library[0, 1, SIGNED:])
        tau = beyond.square() * (stages[1] + _modulate(drag, self.steering.double()))
        moment = tau[:, 3:] + torch.linalg.cross(centre, tau[:, :3])
        return torch.cat([tau[:, :3], moment], dim=1).to(features.dtype)

    def _images(self, d: Tensor) -> Tensor:
        """Return the radial functions R(g d, d_k) between mirrored directions and the points, (8, N, k).

        Args:
            d: Directions (N, 6), mirrored by each of the 8 reflections g of `MIRRORS`.
        """
        points, mirrors = self.points.double(), self.mirrors.double()
        far = d.square().sum(dim=1, keepdim=True) + points.square().sum(dim=1)
        apart = torch.stack([far - 2.0 * (d * signs) @ points.T for signs in mirrors])
        r = (3.0 * apart.clamp(min=0.0)).sqrt() / WIDTH
        return (1.0 + r) * torch.exp(-r)

    def _radial(self, images: Tensor, weights: Tensor) -> Tensor:
        """Return the weighted radial functions of all points and sums S_0, S_1, S_2, (N, 6).

        Args:
            images: Radial functions (8, N, k) of `_images`.
            weights: Weights by point, sum and axis (k, 3, 6).
        """
        mirrors = self.mirrors.double()
        eight = torch.stack([image @ weights[:, 0] for image in images])
        two, one = images[PORT] @ weights[:, 1], images[0] @ (0.5 * weights[:, 1] + weights[:, 2])
        return (mirrors[:, None] * eight).sum(dim=0) / 8.0 + 0.5 * mirrors[PORT] * two + one


def _size(z: Tensor) -> Tensor:
    """Return the size m (N, 1) of motions z (N, 6), near rest EPSILON."""
    return (z.square().sum(dim=1, keepdim=True) + EPSILON**2).sqrt()


def _products(d: Tensor) -> Tensor:
    """Return the 57 products |d_i| d_j and d_i d_j (N, 57) of directions d (N, 6)."""
    first, second = torch.triu_indices(AXES, AXES).unbind()
    signed = (d.abs()[:, :, None] * d[:, None, :]).flatten(1)
    return torch.cat([signed, d[:, first] * d[:, second]], dim=1)


def _modulate(drag: Tensor, steering: Tensor) -> Tensor:
    """Return the sum over j of T_ij F_i |F_j| / |F| (N, 6), separately for forces and for moments.

    Args:
        drag: Drag F (N, 6) [N, N m].
        steering: Coefficients T (6, 3).
    """
    halves = []
    for half in (slice(0, 3), slice(3, 6)):
        part = drag[:, half]
        size = part.square().sum(dim=1, keepdim=True).clamp(min=TINY**2).sqrt()
        halves.append(part * (part.abs() @ steering[half].T) / size)
    return torch.cat(halves, dim=1)
