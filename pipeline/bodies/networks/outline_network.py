"""A small U-Net that sees one body at its own scale: where exactly its outline is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from torch import Tensor, nn

from pipeline.bodies.networks.network import Conv, Residual, larger, read_weights, write_weights

WEIGHTS, CONFIG = "outlines.safetensors", "outlines.json"
SIDE = 64  # px of the square that it sees
#: Of its input: the frame and the background (RGB each), their difference, where the background is known, the mask
#: that was found, other bodies' masks.
INPUTS = 12


class OutlineNetwork(nn.Module):
    """Logit of a pixel that it shows the body.

    channels: of the levels at 1, 1/2, 1/4 and 1/8 of SIDE.
    """

    def __init__(self, channels: tuple[int, int, int, int] = (16, 24, 40, 48)) -> None:
        super().__init__()
        self.channels = tuple(channels)
        a, b, c, d = channels
        self.stem = nn.Sequential(Conv(INPUTS, a), Conv(a, a))
        self.down1 = nn.Sequential(Conv(a, b, 2), Residual(b))
        self.down2 = nn.Sequential(Conv(b, c, 2), Residual(c))
        self.down3 = nn.Sequential(Conv(c, d, 2), Residual(d), Residual(d, 2))
        self.lateral2, self.up2 = Conv(d, c, kernel=1), Residual(c)
        self.lateral1, self.up1 = Conv(c, b, kernel=1), Residual(b)
        self.lateral0, self.up0 = Conv(b, a, kernel=1), Residual(a)
        self.logit = nn.Conv2d(a, 1, 1)

    def forward(self, squares: Tensor) -> Tensor:
        """squares (B, INPUTS, SIDE, SIDE) of `outlines.network_input` to logits (B, SIDE, SIDE)."""
        x0 = self.stem(squares)
        x1 = self.down1(x0)
        x2 = self.down2(x1)
        x = self.down3(x2)
        x = self.up2(larger(self.lateral2(x)) + x2)
        x = self.up1(larger(self.lateral1(x)) + x1)
        x = self.up0(larger(self.lateral0(x)) + x0)
        return self.logit(x)[:, 0]


def save_outline_network(network: OutlineNetwork, folder: Path, config: dict[str, Any]) -> None:
    """Write outlines.safetensors (float16) and outlines.json, `config` with the channels, to a folder."""
    write_weights(network, folder, WEIGHTS, CONFIG, {"channels": list(network.channels), **config})


def load_outline_network(folder: Path | str) -> OutlineNetwork:
    """The network of a folder that `save_outline_network` wrote, ready to infer. Raises ModelError."""
    network, _ = read_weights(folder, WEIGHTS, CONFIG, OutlineNetwork)
    return network
