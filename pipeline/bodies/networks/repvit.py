"""RepViT (Wang et al., CVPR 2024, arXiv:2307.09283), the backbone of EdgeTAM, as four feature maps.

transformers takes it from timm, which needs torchvision. Modules have the names of timm's (`features_only`, in the form
before its branches are fused), so the published weights load. `use_repvit` changes a configuration to this one.
"""

from __future__ import annotations

from typing import Any

import torch
from torch import Tensor, nn
from transformers import AutoConfig, AutoModel, PreTrainedConfig, PreTrainedModel
from transformers.modeling_outputs import BaseModelOutput

from pipeline.errors import ModelError

ARCHITECTURE = "repvit_m1"
WIDTHS, DEPTHS = (48, 96, 192, 384), (2, 2, 14, 2)  # of repvit_m1
MIXER = 3  # kernel size
EXPANSION = 2  # of the channel mixer
SQUEEZE, SQUEEZE_MULTIPLE = 4, 8


class RepVitConfig(PreTrainedConfig):
    """widths: channels of the four feature maps, at 1/4 to 1/32 of the picture. depths: blocks before each."""

    model_type = "repvit_features"
    widths: list[int] | tuple[int, ...] = WIDTHS
    depths: list[int] | tuple[int, ...] = DEPTHS


class ConvNorm(nn.Sequential):
    """A convolution `c` without bias and a batch norm `bn`."""

    def __init__(self, inputs: int, outputs: int, kernel: int = 1, stride: int = 1, groups: int = 1) -> None:
        super().__init__()
        self.add_module("c", nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False))
        self.add_module("bn", nn.BatchNorm2d(outputs))


class TokenMixer(nn.Module):
    """Depthwise convolutions of two sizes and the input, added."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv = ConvNorm(width, width, MIXER, groups=width)
        self.conv1 = ConvNorm(width, width, groups=width)

    def forward(self, x: Tensor) -> Tensor:
        return self.conv(x) + self.conv1(x) + x


class ChannelMixer(nn.Module):
    """Two pointwise convolutions, added to the input."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv1, self.act = ConvNorm(width, EXPANSION * width), nn.GELU()
        self.conv2 = ConvNorm(EXPANSION * width, width)

    def forward(self, x: Tensor) -> Tensor:
        return x + self.conv2(self.act(self.conv1(x)))


class SqueezeExcite(nn.Module):
    """Channels weighted by what their means say."""

    def __init__(self, width: int) -> None:
        super().__init__()
        squeezed = width / SQUEEZE + SQUEEZE_MULTIPLE / 2
        inner = max(SQUEEZE_MULTIPLE, int(squeezed // SQUEEZE_MULTIPLE) * SQUEEZE_MULTIPLE)
        self.fc1, self.fc2 = nn.Conv2d(width, inner, 1), nn.Conv2d(inner, width, 1)

    def forward(self, x: Tensor) -> Tensor:
        return x * torch.sigmoid(self.fc2(torch.relu(self.fc1(x.mean((2, 3), keepdim=True)))))


class Block(nn.Module):
    def __init__(self, width: int, squeeze: bool) -> None:
        super().__init__()
        self.token_mixer = TokenMixer(width)
        self.se = SqueezeExcite(width) if squeeze else nn.Identity()
        self.channel_mixer = ChannelMixer(width)

    def forward(self, x: Tensor) -> Tensor:
        return self.channel_mixer(self.se(self.token_mixer(x)))


class Downsample(nn.Module):
    """Half the size and another width."""

    def __init__(self, inputs: int, outputs: int) -> None:
        super().__init__()
        self.pre_block = Block(inputs, squeeze=False)
        self.spatial_downsample = ConvNorm(inputs, inputs, MIXER, 2, groups=inputs)
        self.channel_downsample = ConvNorm(inputs, outputs)
        self.ffn = ChannelMixer(outputs)

    def forward(self, x: Tensor) -> Tensor:
        return self.ffn(self.channel_downsample(self.spatial_downsample(self.pre_block(x))))


class Stage(nn.Module):
    """Blocks, of which every second has a squeeze and excitation."""

    def __init__(self, inputs: int, outputs: int, depth: int) -> None:
        super().__init__()
        self.downsample = Downsample(inputs, outputs) if inputs != outputs else nn.Identity()
        self.blocks = nn.Sequential(*(Block(outputs, squeeze=k % 2 == 0) for k in range(depth)))

    def forward(self, x: Tensor) -> Tensor:
        return self.blocks(self.downsample(x))


class Stem(nn.Module):
    """A quarter of the size."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.conv1, self.act1 = ConvNorm(3, width // 2, 3, 2), nn.GELU()
        self.conv2 = ConvNorm(width // 2, width, 3, 2)

    def forward(self, x: Tensor) -> Tensor:
        return self.conv2(self.act1(self.conv1(x)))


class RepVitFeatures(PreTrainedModel):
    """The feature maps after each of the four stages, finest first, as `last_hidden_state`."""

    config_class = RepVitConfig
    main_input_name = "pixel_values"

    def __init__(self, config: RepVitConfig) -> None:
        super().__init__(config)
        widths = list(config.widths)
        stages = [
            Stage(before, width, depth)
            for before, width, depth in zip([widths[0], *widths], widths, config.depths, strict=False)
        ]
        named = {"stem": Stem(widths[0])} | {f"stages_{k}": stage for k, stage in enumerate(stages)}
        self.timm_model = nn.ModuleDict(named)
        self.post_init()

    def forward(self, pixel_values: Tensor, **given: Any) -> BaseModelOutput:
        maps, x = [], pixel_values
        for name, module in self.timm_model.items():
            x = module(x)
            if name != "stem":
                maps.append(x)
        return BaseModelOutput(last_hidden_state=maps)  # type: ignore[arg-type]  # a list, as of timm in transformers


def use_repvit(config: dict[str, Any]) -> dict[str, Any]:
    """The content of EdgeTAM's config.json with this module in place of timm's.

    Raises ModelError where the backbone is another one.
    """
    AutoConfig.register(RepVitConfig.model_type, RepVitConfig, exist_ok=True)
    AutoModel.register(RepVitConfig, RepVitFeatures, exist_ok=True)
    vision = config.get("vision_config") or {}
    backbone = vision.get("backbone_config") or {}
    architecture = str(backbone.get("architecture", ARCHITECTURE)).partition(".")[0]
    if backbone.get("model_type", "timm_wrapper") != "timm_wrapper" or architecture != ARCHITECTURE:
        raise ModelError(f"the backbone is {backbone.get('architecture')!r}; valid for EdgeTAM: {ARCHITECTURE!r}")
    given = backbone.get("model_args") or {}
    own = {
        "model_type": RepVitConfig.model_type,
        "widths": list(given.get("embed_dim", WIDTHS)),
        "depths": list(given.get("depth", DEPTHS)),
    }
    return {**config, "vision_config": {**vision, "backbone_config": own}}
