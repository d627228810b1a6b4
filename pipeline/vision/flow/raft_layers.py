"""The layers of RAFT: encoders, recurrent update block and correlation pyramid (Teed & Deng, ECCV 2020).

Parameter names are those of the authors' release.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as F

CELL = 8  # px of the image per cell of the feature grid
LEVELS = 4  # of the correlation pyramid


class Block(nn.Module):
    """A residual unit of the encoders: two 3x3 convolutions; a bottleneck has 1x1, 3x3 and 1x1."""

    def __init__(self, inputs: int, planes: int, norm: str, stride: int, bottleneck: bool) -> None:
        super().__init__()
        inner = planes // 4 if bottleneck else planes
        if bottleneck:
            self.conv1 = nn.Conv2d(inputs, inner, 1)
            self.conv2 = nn.Conv2d(inner, inner, 3, padding=1, stride=stride)
            self.conv3: nn.Module | None = nn.Conv2d(inner, planes, 1)
            self.norm3: nn.Module | None = normalisation(norm, planes)
        else:
            self.conv1 = nn.Conv2d(inputs, inner, 3, padding=1, stride=stride)
            self.conv2 = nn.Conv2d(inner, inner, 3, padding=1)
            self.conv3 = self.norm3 = None
        self.norm1 = normalisation(norm, inner)
        self.norm2 = normalisation(norm, inner)
        self.downsample: nn.Module | None = None
        if stride != 1:
            self.downsample = nn.Sequential(nn.Conv2d(inputs, planes, 1, stride=stride), normalisation(norm, planes))

    def forward(self, x: Tensor) -> Tensor:
        y = F.relu(self.norm1(self.conv1(x)))
        y = F.relu(self.norm2(self.conv2(y)))
        if self.conv3 is not None and self.norm3 is not None:
            y = F.relu(self.norm3(self.conv3(y)))
        return F.relu(y + (x if self.downsample is None else self.downsample(x)))


def normalisation(name: str, planes: int) -> nn.Module:
    if name == "instance":
        return nn.InstanceNorm2d(planes)
    if name == "batch":
        return nn.BatchNorm2d(planes)
    assert name == "none", name
    return nn.Sequential()


class Encoder(nn.Module):
    """Images (B, 3, H, W) to features (B, outputs, H/8, W/8)."""

    def __init__(self, outputs: int, norm: str, planes: tuple[int, int, int], bottleneck: bool) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(3, planes[0], 7, stride=2, padding=3)
        self.norm1 = normalisation(norm, planes[0])

        def layer(inputs: int, outputs: int, stride: int) -> nn.Sequential:
            return nn.Sequential(
                Block(inputs, outputs, norm, stride, bottleneck), Block(outputs, outputs, norm, 1, bottleneck)
            )

        self.layer1 = layer(planes[0], planes[0], 1)
        self.layer2 = layer(planes[0], planes[1], 2)
        self.layer3 = layer(planes[1], planes[2], 2)
        self.conv2 = nn.Conv2d(planes[2], outputs, 1)
        for module in self.modules():
            if isinstance(module, nn.Conv2d):
                nn.init.kaiming_normal_(module.weight, mode="fan_out", nonlinearity="relu")

    def forward(self, x: Tensor) -> Tensor:
        x = F.relu(self.norm1(self.conv1(x)))
        return self.conv2(self.layer3(self.layer2(self.layer1(x))))


class MotionEncoder(nn.Module):
    """Motion features of each cell from its correlation and flow; the flow itself is appended."""

    def __init__(self, small: bool, radius: int) -> None:
        super().__init__()
        planes = LEVELS * (2 * radius + 1) ** 2
        self.convc1 = nn.Conv2d(planes, 96 if small else 256, 1)
        self.convc2: nn.Module | None = None if small else nn.Conv2d(256, 192, 3, padding=1)
        self.convf1 = nn.Conv2d(2, 64 if small else 128, 7, padding=3)
        self.convf2 = nn.Conv2d(64 if small else 128, 32 if small else 64, 3, padding=1)
        self.conv = nn.Conv2d(128 if small else 256, 80 if small else 126, 3, padding=1)

    def forward(self, flow: Tensor, correlation: Tensor) -> Tensor:
        c = F.relu(self.convc1(correlation))
        if self.convc2 is not None:
            c = F.relu(self.convc2(c))
        f = F.relu(self.convf2(F.relu(self.convf1(flow))))
        return torch.cat([F.relu(self.conv(torch.cat([c, f], dim=1))), flow], dim=1)


class ConvGRU(nn.Module):
    """The gated recurrent unit with 3x3 convolutions (eq. 3 to 6 of the paper)."""

    def __init__(self, hidden: int, inputs: int) -> None:
        super().__init__()
        self.convz = nn.Conv2d(hidden + inputs, hidden, 3, padding=1)
        self.convr = nn.Conv2d(hidden + inputs, hidden, 3, padding=1)
        self.convq = nn.Conv2d(hidden + inputs, hidden, 3, padding=1)

    def forward(self, h: Tensor, x: Tensor) -> Tensor:
        return gru_step(h, x, self.convz, self.convr, self.convq)


class SepConvGRU(nn.Module):
    """A gated recurrent unit with 1x5 convolutions, followed by one with 5x1 convolutions."""

    def __init__(self, hidden: int, inputs: int) -> None:
        super().__init__()

        def gate(kernel: tuple[int, int]) -> nn.Conv2d:
            return nn.Conv2d(hidden + inputs, hidden, kernel, padding=(kernel[0] // 2, kernel[1] // 2))

        self.convz1, self.convr1, self.convq1 = gate((1, 5)), gate((1, 5)), gate((1, 5))
        self.convz2, self.convr2, self.convq2 = gate((5, 1)), gate((5, 1)), gate((5, 1))

    def forward(self, h: Tensor, x: Tensor) -> Tensor:
        h = gru_step(h, x, self.convz1, self.convr1, self.convq1)
        return gru_step(h, x, self.convz2, self.convr2, self.convq2)


def gru_step(h: Tensor, x: Tensor, update: nn.Module, reset: nn.Module, candidate: nn.Module) -> Tensor:
    hx = torch.cat([h, x], dim=1)
    z = torch.sigmoid(update(hx))
    r = torch.sigmoid(reset(hx))
    q = torch.tanh(candidate(torch.cat([r * h, x], dim=1)))
    return h + z * (q - h)


class FlowHead(nn.Module):
    def __init__(self, inputs: int, hidden: int) -> None:
        super().__init__()
        self.conv1 = nn.Conv2d(inputs, hidden, 3, padding=1)
        self.conv2 = nn.Conv2d(hidden, 2, 3, padding=1)

    def forward(self, x: Tensor) -> Tensor:
        return self.conv2(F.relu(self.conv1(x)))


class UpdateBlock(nn.Module):
    """One iteration: the next hidden state and the change of the flow."""

    def __init__(self, small: bool, hidden: int, context: int, radius: int, convex: bool) -> None:
        super().__init__()
        self.encoder = MotionEncoder(small, radius)
        motion = 82 if small else 128
        self.gru: nn.Module = (ConvGRU if small else SepConvGRU)(hidden, context + motion)
        self.flow_head = FlowHead(hidden, 128 if small else 256)
        self.mask: nn.Module | None = None
        if convex:
            planes = 128 if small else 256
            self.mask = nn.Sequential(
                nn.Conv2d(hidden, planes, 3, padding=1), nn.ReLU(), nn.Conv2d(planes, CELL * CELL * 9, 1)
            )

    def forward(self, h: Tensor, context: Tensor, correlation: Tensor, flow: Tensor) -> tuple[Tensor, Tensor]:
        h = self.gru(h, torch.cat([context, self.encoder(flow, correlation)], dim=1))
        return h, self.flow_head(h)


class Correlation:
    """The all-pairs correlation pyramid (section 3.2) of features (B, D, h, w).

    Level l contains the products of a_ij with the mean of b over 2^l x 2^l cells.
    """

    def __init__(self, features_a: Tensor, features_b: Tensor, radius: int) -> None:
        b, d, h, w = features_a.shape
        volume = torch.matmul(features_a.flatten(2).transpose(1, 2), features_b.flatten(2)) / math.sqrt(d)
        self.radius = radius
        self.pyramid = [volume.view(b * h * w, 1, h, w)]
        for _ in range(LEVELS - 1):
            self.pyramid.append(F.avg_pool2d(self.pyramid[-1], 2, stride=2))
        steps = torch.arange(-radius, radius + 1, device=volume.device, dtype=volume.dtype)
        # In the release x varies along the first axis of the window; the weights expect that order.
        self.window = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)  # (2r+1, 2r+1, 2) x, y

    def lookup(self, position: Tensor) -> Tensor:
        """Bilinear samples (B, 4 (2r+1)^2, h, w) around positions (B, 2, h, w) in cells of b; zero outside of b."""
        b, _, h, w = position.shape
        centre = position.permute(0, 2, 3, 1).reshape(b * h * w, 1, 1, 2)
        samples = []
        for level, volume in enumerate(self.pyramid):
            size = torch.tensor([volume.shape[3], volume.shape[2]], device=position.device, dtype=position.dtype)
            grid = (2 * (centre / 2**level + self.window) + 1) / size - 1
            samples.append(F.grid_sample(volume, grid, align_corners=False).view(b, h, w, -1))
        return torch.cat(samples, dim=-1).permute(0, 3, 1, 2).contiguous()
