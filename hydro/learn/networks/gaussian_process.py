"""The mean of a Gaussian process of a hull's wrench, in the mirrors of the hull: for minutes of data.

What it is and what its weights mean stands in `core.residual.mirrors`; how they are found from labels, without
any descent, in `learn.gaussian_process`. Accelerations are no input.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn

from hydro.core.distillation.features import names
from hydro.core.residual.mirrors import EPSILON, MIRRORS, PORT, POWERS, PRODUCTS, SUMS, WIDE
from hydro.learn.networks.residual import AXES, Residual


class GaussianProcess(Residual):
    """Sums over points of the sphere of motions, and over products of velocities.

    Tensors `centre` (3,) [m], `scale` (6,), `top` (1,), `linear` (6, 6), `library` (3, 57, 6), `points`
    (k, 6), and `weights` (k, 4, 3, 6), whose wrenches are in N and N m.
    """

    def __init__(self, *, features: str, points: int) -> None:
        if features != "raw" or points < 1:
            raise ValueError(f"{points} points of features {features}: there must be some, of features raw")
        super().__init__(inputs=len(names(features)), features=features)
        self.centre = nn.Parameter(torch.zeros(3))
        self.scale = nn.Parameter(torch.ones(AXES))
        self.top = nn.Parameter(torch.full((1,), 2.0))
        self.linear = nn.Parameter(torch.randn(AXES, AXES))
        self.library = nn.Parameter(torch.randn(POWERS, PRODUCTS, AXES))
        self.points = nn.Parameter(nn.functional.normalize(torch.randn(points, AXES), dim=1))
        self.weights = nn.Parameter(torch.randn(points, SUMS, POWERS, AXES))
        self.register_buffer("mirrors", torch.from_numpy(MIRRORS), persistent=False)

    def standardised(self, inputs: Tensor) -> Tensor:
        """The wrench of `forward` in units of its scales, from standardised features."""
        return (self.forward(self.input_mean + self.input_scale * inputs) - self.output_mean) / self.output_scale

    def forward(self, features: Tensor) -> Tensor:
        """Map features (N, 12) to tau_res (N, 6) [N and N m], body FRD, order X Y Z K M N."""
        nu = features[:, :AXES].double()  # weights of points side by side nearly cancel
        centre = self.centre.double().expand(len(nu), 3)
        v = nu[:, :3] + torch.linalg.cross(nu[:, 3:], centre)
        z = torch.cat([v, nu[:, 3:]], dim=1) * self.scale
        beyond = (_size(z) / self.top).clamp(min=1.0)
        z = z / beyond
        m = _size(z)
        tau = z @ self.linear.double().T
        for power, grown in enumerate(self._grown(z / m)):
            tau = tau + m ** (power + 1) * grown
        tau = beyond.square() * tau
        moment = tau[:, 3:] + torch.linalg.cross(centre, tau[:, :3])
        return torch.cat([tau[:, :3], moment], dim=1).to(features.dtype)

    def _grown(self, d: Tensor) -> list[Tensor]:
        """What grows with each power of the speed, (N, 6) each, of directions (N, 6)."""
        mirrors = self.mirrors.double()
        first, second = torch.triu_indices(AXES, AXES).unbind()
        signed = (d.abs()[:, :, None] * d[:, None, :]).flatten(1)
        products = torch.cat([signed, d[:, first] * d[:, second]], dim=1)
        points = self.points.double()
        far = d.square().sum(dim=1, keepdim=True) + points.square().sum(dim=1)
        images = [torch.exp(((d * g) @ points.T - 0.5 * far) / WIDE**2) for g in mirrors]
        found = [products @ library for library in self.library.double()]
        weights = self.weights.double()
        for axis in range(AXES):
            pairs = list(zip(mirrors[:, axis], images, strict=True))
            sums = torch.stack([
                torch.stack([sign * image**4 for sign, image in pairs]).sum(dim=0) / 8.0,
                torch.stack([sign * image for sign, image in pairs]).sum(dim=0) / 8.0,
                0.5 * (images[0] + mirrors[PORT, axis] * images[PORT]),
                images[0],
            ])
            of_axis = torch.einsum("snk,ksp->pn", sums, weights[..., axis])
            for power in range(POWERS):
                column = torch.zeros_like(found[power])
                column[:, axis] = of_axis[power]
                found[power] = found[power] + column
        return found


def _size(z: Tensor) -> Tensor:
    """m of motions (N, 6), (N, 1)."""
    return (z.square().sum(dim=1, keepdim=True) + EPSILON**2).sqrt()
