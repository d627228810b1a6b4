"""A small U-Net: one frame, with what the clip's other frames say of its pixels, to bodies and votes."""

from __future__ import annotations

import copy
import itertools
import json
from pathlib import Path
from typing import Any, TypeVar

import torch
import torch.nn.functional as F
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from pipeline.bodies.networks.inputs import FULL_CHANNELS, HALF_CHANNELS
from pipeline.errors import ModelError
from pipeline.untrusted import read_json

N = TypeVar("N", bound=nn.Module)

WEIGHTS, CONFIG = "model.safetensors", "config.json"
#: Logits of a pixel: it shows a body that moves in the clip; a body, which may rest; something that moves and is no
#: body (a hand, cloth, a mirror image).
MOVING, BODY, OTHER = 0, 1, 2
VOTE_SCALE_PX = 16.0
STRIDE = 16  # heights and widths must be multiples of it


class Conv(nn.Sequential):
    """Convolution, batch norm, ReLU."""

    def __init__(self, inputs: int, outputs: int, stride: int = 1, kernel: int = 3) -> None:
        super().__init__(
            nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False),
            nn.BatchNorm2d(outputs),
            nn.ReLU(inplace=True),
        )


class Residual(nn.Module):
    """Two convolutions and a shortcut."""

    def __init__(self, channels: int, dilation: int = 1) -> None:
        super().__init__()
        self.first = Conv(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, dilation, dilation, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, x: Tensor) -> Tensor:
        return F.relu(x + self.second(self.first(x)))


class SegmentationNetwork(nn.Module):
    """Logits of MOVING, BODY and OTHER at full size; votes at half size.

    channels: of the levels at 1/2, 1/4, 1/8 and 1/16 of the picture's size.
    """

    def __init__(self, channels: tuple[int, int, int, int] = (24, 48, 96, 160)) -> None:
        super().__init__()
        self.channels = tuple(channels)
        self.config: dict[str, Any] = {}
        a, b, c, d = channels
        self.stem = nn.Sequential(Conv(4 * FULL_CHANNELS + HALF_CHANNELS, a), Conv(a, a))
        self.down1 = nn.Sequential(Conv(a, b, 2), Residual(b))
        self.down2 = nn.Sequential(Conv(b, c, 2), Residual(c))
        self.down3 = nn.Sequential(Conv(c, d, 2), Residual(d), Residual(d, 2))
        self.context = nn.Linear(2 * d, d)
        self.lateral2, self.up2 = Conv(d, c, kernel=1), Residual(c)
        self.lateral1, self.up1 = Conv(c, b, kernel=1), Residual(b)
        self.lateral0, self.up0 = Conv(b, a, kernel=1), Residual(a)
        self.vote = nn.Sequential(Conv(a, 16), nn.Conv2d(16, 3, 1))
        self.fine = Conv(FULL_CHANNELS, 8)
        self.coarse = nn.Conv2d(a, 40, 1)
        last = nn.Conv2d(12, 3, 1)
        nn.init.constant_(last.bias, -2.0)  # type: ignore[arg-type]
        self.logits = nn.Sequential(Conv(18, 12), last)

    def forward(self, full: Tensor, half: Tensor) -> tuple[Tensor, Tensor]:
        """full (B, FULL_CHANNELS, H, W), half (B, HALF_CHANNELS, H / 2, W / 2) of `inputs.network_input` to logits
        (B, 3, H, W) and votes (B, 3, H / 2, W / 2): offset to the body's centre, in VOTE_SCALE_PX, and log of its
        radius in px."""
        x0 = self.stem(torch.cat([F.pixel_unshuffle(full, 2), half], 1))
        x1 = self.down1(x0)
        x2 = self.down2(x1)
        x3 = self.down3(x2)
        x3 = x3 + self.context(torch.cat([x3.mean((2, 3)), x3.amax((2, 3))], 1))[..., None, None]
        x = self.up2(larger(self.lateral2(x3)) + x2)
        x = self.up1(larger(self.lateral1(x)) + x1)
        x = self.up0(larger(self.lateral0(x)) + x0)
        coarse = F.pixel_shuffle(F.relu(self.coarse(x)), 2)
        return self.logits(torch.cat([coarse, self.fine(full)], 1)), self.vote(x)


def larger(x: Tensor) -> Tensor:
    return F.interpolate(x, scale_factor=2, mode="bilinear", align_corners=False)


def without_norms(network: SegmentationNetwork) -> SegmentationNetwork:
    """A copy that only infers: each batch norm is part of the convolution before it, channels come last in memory."""
    assert not network.training, "a norm that still learns cannot be part of a convolution"
    ready = copy.deepcopy(network)
    for part in ready.modules():
        children = list(part.named_children()) if isinstance(part, nn.Sequential) else []
        for (name, convolution), (norm_name, norm) in itertools.pairwise(children):
            if isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                setattr(part, name, fuse_conv_bn_eval(convolution, norm))
                setattr(part, norm_name, nn.Identity())
    return ready.to(memory_format=torch.channels_last)  # type: ignore[call-overload,no-any-return]


def save_network(network: SegmentationNetwork, folder: Path, config: dict[str, Any]) -> None:
    """Write model.safetensors (float16) and config.json, `config` with the channels, to a folder."""
    write_weights(network, folder, WEIGHTS, CONFIG, {"channels": list(network.channels), **config})


def load_network(folder: Path | str) -> SegmentationNetwork:
    """The network of a folder that `save_network` wrote, ready to infer; its `config` is the file's.

    Raises ModelError.
    """
    network, config = read_weights(folder, WEIGHTS, CONFIG, SegmentationNetwork)
    network.config = config
    return network


def write_weights(network: nn.Module, folder: Path, weights: str, config: str, values: dict[str, Any]) -> None:
    """Write a network's weights (float16) and what is to be known of them into files of these names in a folder."""
    from safetensors.torch import save_file

    folder.mkdir(parents=True, exist_ok=True)
    state = {
        k: (v.half() if v.is_floating_point() else v).contiguous()
        for k, v in network.state_dict().items()
        if not k.endswith("num_batches_tracked")
    }
    save_file(state, str(folder / (weights + ".part")))
    (folder / (weights + ".part")).replace(folder / weights)
    (folder / (config + ".part")).write_text(json.dumps(values, indent=2) + "\n")
    (folder / (config + ".part")).replace(folder / config)


def read_weights(folder: Path | str, weights: str, config: str, kind: type[N]) -> tuple[N, dict[str, Any]]:
    """A network of a kind, ready to infer, and its configuration, from files of these names. Raises ModelError."""
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    folder = Path(folder)
    if not (folder / weights).is_file():
        raise ModelError(f"{folder} has no {weights}: a folder of segmentation weights is needed, as models/masks")
    try:
        values = read_json(folder / config, ModelError)
        network = kind(tuple(values["channels"]))
        state = {k: v.float() for k, v in load_file(folder / weights).items()}
        missing, unexpected = network.load_state_dict(state, strict=False)
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise ModelError(f"{folder} does not hold segmentation weights: {str(error).splitlines()[0]}") from error
    if unexpected or any(not k.endswith("num_batches_tracked") for k in missing):
        raise ModelError(f"{folder} does not hold segmentation weights of {values['channels']} channels")
    return network.eval(), values
