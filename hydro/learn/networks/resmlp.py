"""ResMLP network: projection, residual blocks with layer norms, output layer (Wu et al., ResMLP-12x6)."""

from __future__ import annotations

from collections.abc import Callable

from torch import Tensor, nn

from hydro.core.distillation.features import names
from hydro.learn.networks.residual import AXES, Residual, function


class Block(nn.Module):
    """Residual block x + down(activation(up(norm(x)))), with a hidden layer narrower than x.

    `up` maps the width to the hidden layer, `down` maps back.
    """

    def __init__(self, width: int, hidden: int, activation: Callable[[Tensor], Tensor]) -> None:
        super().__init__()
        self.norm = nn.LayerNorm(width)
        self.up = nn.Linear(width, hidden)
        self.down = nn.Linear(hidden, width)
        self.activation = activation

    def forward(self, x: Tensor) -> Tensor:
        """Return the output of the block (N, width) for its input (N, width)."""
        added: Tensor = self.down(self.activation(self.up(self.norm(x))))
        return x + added


class ResMLP(Residual):
    """Network of pre-norm residual blocks, with a layer norm after the last.

    Tensors `project.*`, `blocks.<i>.{norm,up,down}.*`, `norm.*` and `out.*`.
    """

    def __init__(self, *, features: str, width: int, hidden: int, blocks: int, activation: str) -> None:
        super().__init__(inputs=len(names(features)), features=features)
        self.project = nn.Linear(self.inputs, width)
        self.blocks = nn.ModuleList(Block(width, hidden, function(activation)) for _ in range(blocks))
        self.norm = nn.LayerNorm(width)
        self.out = nn.Linear(width, AXES)

    def standardised(self, inputs: Tensor) -> Tensor:
        """Return the standardised wrench (N, 6) for standardised features (N, k)."""
        x = self.project(inputs)
        for block in self.blocks:
            x = block(x)
        wrench: Tensor = self.out(self.norm(x))
        return wrench
