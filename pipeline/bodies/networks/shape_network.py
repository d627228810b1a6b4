"""A small network that sees one body in one frame, and says which basic shape it has."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from torch import Tensor, nn

from pipeline.bodies.networks.network import Conv, Residual, read_weights, write_weights
from pipeline.scene.scene import BASIC_SHAPES

WEIGHTS, CONFIG = "shapes.safetensors", "shapes.json"
#: Of its input: the frame (RGB), the body's mask, other bodies' masks.
INPUTS = 5


class ShapeNetwork(nn.Module):
    """Logits of `BASIC_SHAPES`.

    channels: of the levels at 1/2, 1/4, 1/8 and 1/16 of the square's side.
    """

    def __init__(self, channels: tuple[int, int, int, int] = (24, 40, 64, 96)) -> None:
        super().__init__()
        self.channels = tuple(channels)
        self.config: dict[str, Any] = {}
        a, b, c, d = channels
        self.levels = nn.Sequential(
            Conv(INPUTS, a, 2),
            Residual(a),
            Conv(a, b, 2),
            Residual(b),
            Conv(b, c, 2),
            Residual(c),
            Conv(c, d, 2),
            Residual(d),
        )
        self.logits = nn.Linear(2 * d, len(BASIC_SHAPES))

    def forward(self, squares: Tensor) -> Tensor:
        """squares (B, INPUTS, SIDE, SIDE) of `shape_of_body.input_of` to logits (B, 3)."""
        x = self.levels(squares)
        return self.logits(torch.cat([x.mean((2, 3)), x.amax((2, 3))], 1))


def save_shape_network(network: ShapeNetwork, folder: Path, config: dict[str, Any]) -> None:
    """Write shapes.safetensors (float16) and shapes.json, `config` with the channels, to a folder."""
    write_weights(network, folder, WEIGHTS, CONFIG, {"channels": list(network.channels), **config})


def load_shape_network(folder: Path | str) -> ShapeNetwork:
    """The network of a folder that `save_shape_network` wrote, ready to infer. Raises ModelError."""
    network, config = read_weights(folder, WEIGHTS, CONFIG, ShapeNetwork)
    network.config = config
    return network
