"""Is what a model leaves unexplained a force?  A steady wrench in each shot, that no effect needs to name.

Errors of a model show as forces that last: over two seconds a wrench of the shot's own takes up most of
what a current that comes and goes, a wall or a swell does.  White noise of the sensors it takes up by six
numbers' worth a shot, and no more.
"""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from hydro.core.columns import Array
from hydro.core.identification.normal_equations import Normal
from hydro.core.vehicle.description import Vehicle

FAR = 1e4
"""Distance of an anchor whose pull is as good as steady [m]."""
LITTLE = 0.01  # of the vehicle's weight
WRENCH = 6


def pulled(vehicle: Vehicle) -> Iterator[Vehicle]:
    """The vehicle under a small steady pull: three at CO along north, east and down, three off CO."""
    pull = LITTLE * vehicle.rigid_body.mass * vehicle.environment.gravity / FAR
    lever = 0.5 * vehicle.hull.length
    for arm in (0.0, lever):
        for way in range(3):
            anchor, attachment = FAR * np.eye(3)[way], arm * np.eye(3)[(way + 1) % 3]
            cable = {"k": pull, "slack": 0.0, "attachment": attachment.tolist(), "anchor": anchor.tolist()}
            yield msgspec.structs.replace(vehicle, effect=(*vehicle.effect, {"name": "tether"} | cable))


def share(normal: Normal) -> float:
    """How much of the residual steady wrenches explain beyond chance, in units of the noise's square.

    Args:
        normal: The problem whose columns are the six pulls.

    Returns:
        0 where nothing but white noise is left, of whatever size.
    """
    kept = np.isfinite(normal.gram[:, -1, -1])
    matrix, score, cost = normal.matrix[kept], normal.score[kept], normal.gram[kept, -1, -1]
    size = np.sqrt(np.einsum("sii->si", matrix)) + 1e-300
    unit = matrix / size[:, :, None] / size[:, None, :] + 1e-9 * np.eye(WRENCH)
    scaled: Array = score / size
    gain = np.einsum("si,si->s", scaled, np.linalg.solve(unit, scaled[..., None])[..., 0])
    noise = float((cost - gain).sum()) / (len(cost) * (normal.freedom - WRENCH))
    return float(gain.sum() / noise - WRENCH * len(cost)) / (normal.freedom * len(cost))
