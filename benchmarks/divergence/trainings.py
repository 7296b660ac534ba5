"""Trainings of the study: SAC on stage 1, with an equal budget and no examination that ends one early."""

from __future__ import annotations

import time
from dataclasses import replace

from benchmarks.divergence.cells import Cell
from benchmarks.kept_tables import Row
from hydro.core.vehicle.description import Vehicle
from hydro.io.model import Model
from hydro.rl.environment.wrench import WrenchSettings
from hydro.rl.training.build import Builder
from hydro.rl.training.config import RECIPES, SAC, TrainingConfig
from hydro.rl.training.train import Training

STEPS, EVALUATE = 204_800, 25_600
"""Control steps of a training and between evaluations; at the centre stage 1 is passed by then or earlier."""


def config(cell: Cell, condition: str, seed: int, steps: int = STEPS) -> TrainingConfig:
    """Return the settings of a training.

    Args:
        cell: The cell.
        condition: Physics, `R_MLP` or `R_PhysFeat`.
        seed: Seed.
        steps: Budget of control steps.
    """
    recipe = RECIPES[SAC]
    return replace(
        recipe,
        condition=condition,
        conditioning=cell.conditioning,
        wrench=WrenchSettings(lead=cell.lead),
        seed=seed,
        steps=steps,
        evaluate=EVALUATE,
        curriculum=replace(recipe.curriculum, last=1, examine=steps + 1),
    )


def train(chosen: TrainingConfig, vehicle: Vehicle, model: Model) -> Row:
    """Train a policy, and return its row.

    Returns:
        `diverged`, the kind of divergence or an empty text; `numerical`, episodes that diverged numerically;
        `steps`, `updates`; `best` and `last`, the greatest and the last share of arrivals of the evaluations;
        `overspeed`, the share of control steps above 5 m/s; `processor`, the processor time [s].
    """
    started = time.process_time()
    training = Training(chosen, Builder(chosen, vehicle, model))
    while not training.finished:
        training.advance()
    shares = [one["success"] for one in training.evaluations if one["purpose"] == "curve"]
    return {
        "diverged": training.watch.verdict,
        "numerical": training.watch.episodes,
        "steps": training.steps,
        "updates": training.updates,
        "best": max(shares, default=0.0),
        "last": shares[-1] if shares else 0.0,
        "overspeed": training.curves[-1]["overspeed"] / training.steps,
        "processor": round(time.process_time() - started, 1),
    }
