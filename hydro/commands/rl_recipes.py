"""Option `--recipe` of trainings, with its names in earlier versions."""

from __future__ import annotations

from typing import Annotated, Literal

import typer

Recipe = Annotated[
    Literal["paper", "sac", "imitation", "demos"],
    typer.Option(help="SAC as in the paper, fast SAC, or imitation; demos is the old name of imitation."),
]


def current_recipe(name: str) -> str:
    """Return the present name of a recipe, the settings of a training.

    For a name of an earlier version, a line is printed on stderr.

    Args:
        name: Present or earlier name.
    """
    from hydro.rl.training.config import RENAMED_RECIPES

    if name not in RENAMED_RECIPES:
        return name
    present = RENAMED_RECIPES[name]
    typer.echo(f"hydro: --recipe {name} is called {present} now; the next version will not know it", err=True)
    return present
