"""Physics conditions of a training: which water forces act; three of Wu et al. (section V-C), three more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from hydro.core.distillation.features import OUTPUTS, names
from hydro.core.errors import DataError, UsageError
from hydro.core.residual.lowering import TrainedModel
from hydro.core.residual.network import Network
from hydro.core.vehicle.description import Vehicle
from hydro.io.model import Model
from hydro.io.vehicle import vehicle_hash
from hydro.rl.environment.wrench import WrenchSettings
from hydro.rl.world.config import Settings
from hydro.sim.bridge.water import Water, dry, residual, wet
from hydro.sim.kernel_plant import KernelPlant
from hydro.sim.plant import Plant, StudentPlant
from hydro.sim.residual.beside import beside
from hydro.sim.residual.control import Control

NO_WATER, ZERO, EFFECTS, IDENTIFIED = "R_0", "R_0+M_A", "R_effects", "R_identified"  # see `Condition`
MODELS = {"R_MLP": "mlp", "R_PhysFeat": "physfeat", "R_structured": "structured"}
"""Kind of residual model by condition."""
OF_THE_FILE = (EFFECTS, IDENTIFIED)
"""Conditions in which the effects of the vehicle file act."""
CONDITIONS = (NO_WATER, ZERO, *MODELS, *OF_THE_FILE)


@dataclass(frozen=True)
class Condition:
    """Physics of a training: which water forces act on the vehicle.

    Attributes:
        name: `R_0`: no water forces, only thrusters, weight, buoyancy and MuJoCo's own C_RB. `R_0+M_A`: as
            with a residual model, with the same added mass and conditioning, but the model's output is zero.
            This is R_0 of Wu et al. if only the network differs between conditions. `R_MLP`, `R_PhysFeat` or
            `R_structured`: a residual model. `R_effects`: all effects of the vehicle file. `R_identified`:
            the same, for a file that was identified from data.
        model: Residual model (a network that predicts a wrench), for the conditions that have one.
        conditioning: Preset of `sim.residual.conditioning`, the filter and limits of the model's wrench.
        wrench: Other settings of that wrench.
    """

    name: str = EFFECTS
    model: TrainedModel | None = None
    conditioning: str = "paper"
    wrench: WrenchSettings = field(default_factory=WrenchSettings)

    def __post_init__(self) -> None:
        """Check that the name exists and that the residual model suits it.

        Raises:
            UsageError: The condition is unknown, or its model is missing, of another kind, or superfluous.
        """
        if self.name not in CONDITIONS:
            raise UsageError(f"there is no condition {self.name!r}; choose one of {', '.join(CONDITIONS)}")
        wanted, model = MODELS.get(self.name), self.model
        if wanted is None and model is not None:
            raise UsageError(f"{self.name} has no residual model, but {model.name} is given; leave it out")
        if wanted is not None and (model is None or model.architecture.get("model") != wanted):
            given = "none is given" if model is None else f"{model.name} is given"
            raise UsageError(f"{self.name} needs a residual model of kind {wanted}, but {given}; train one")


def water(condition: Condition, vehicle: Vehicle, *, period: float = 0.04, file: str = "") -> Water:
    """Return the water forces on a vehicle under a physics condition.

    Args:
        condition: The condition.
        vehicle: The vehicle of the file, or a changed copy.
        period: Control step [s].
        file: Hash of the vehicle file; by default the hash of `vehicle`.

    Raises:
        DataError: The residual model cannot be combined with the effects of the file.
    """
    model = zero_model() if condition.name == ZERO else condition.model
    if model is None:
        return wet(vehicle) if condition.name in OF_THE_FILE else dry(vehicle)
    settings = condition.wrench
    control = Control(
        Network.of(model),
        period,
        design=settings.design(period),
        conditioning=settings.conditioning(condition.conditioning, vehicle),
        lead=settings.lead,
    )
    whole = model.subtract == "effects"
    if (
        whole
        and model.labelled is not None
        and vehicle_hash(model.labelled) != (file or vehicle_hash(vehicle))
    ):
        raise DataError(
            f"{model.name}: its labels subtract the effects of another vehicle file than {vehicle.name}; "
            "use the file of the labels"
        )
    return residual(vehicle, control, effects=whole, beside=() if whole else beside(vehicle, model.labelled))


def zero_model() -> Model:
    """Return a residual model whose wrench is zero at every state."""
    states, axes = len(names("raw")), len(OUTPUTS)
    scalers = {
        f"{side}_{what}": np.full(size, value)
        for side, size in (("input", states), ("output", axes))
        for what, value in (("mean", 0.0), ("scale", 1.0))
    }
    return Model(
        name="zero",
        architecture={"model": "mlp", "features": "raw", "layers": [states, axes], "activation": "relu"},
        tensors={
            "layers.0.weight": np.zeros((axes, states), np.float32),
            "layers.0.bias": np.zeros(axes, np.float32),
        },
        features="raw",
        scalers=scalers,
        inputs=names("raw"),
        outputs=OUTPUTS,
        units={},
    )


def waters(condition: Condition, vehicle: Vehicle, period: float) -> Callable[[Vehicle], Water]:
    """Return a function that takes a changed copy of a vehicle and returns its water forces.

    Args:
        condition: The condition, which selects the water forces.
        vehicle: The vehicle of the file; its hash identifies the file for all copies.
        period: Control step [s].
    """
    known = vehicle_hash(vehicle)
    return lambda one: water(condition, one, period=period, file=known)


def plant(
    condition: Condition,
    vehicle: Vehicle,
    settings: Settings,
    count: int,
    *,
    threads: int = 1,
    folder: Path | None = None,
) -> Plant:
    """Return the simulator of `count` vehicles under a physics condition.

    Args:
        condition: The condition, which selects the water forces; see `water`.
        vehicle: The vehicle file.
        settings: Engine, its integration step, and control step.
        count: Number of vehicles.
        threads: Number of threads.
        folder: Folder of the vehicle file, for hull meshes of MuJoCo.
    """
    water = waters(condition, vehicle, settings.period)
    if settings.engine == "kernels":
        return KernelPlant(
            vehicle, water, count=count, period=settings.period, timestep=settings.step, threads=threads
        )
    return StudentPlant(
        vehicle,
        water,
        count=count,
        physics=settings.physics,
        period=settings.period,
        threads=threads,
        folder=folder,
    )
