"""RAFT, recurrent all-pairs field transforms for optical flow (Teed & Deng, ECCV 2020, arXiv:2003.12039).

Two sizes, `small` and `large`, with the parameter names of the authors' release (princeton-vl/RAFT), so that the
published checkpoints load by path. Our own weights add to `small` the learned convex upsampling of `large`
(section 3.3 of the paper): at 240x160 an object is two or three cells of the 1/8 grid wide, and bilinear
upsampling would smear its edge over all of it.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pipeline.errors import ModelError
from pipeline.vision.flow.dis import DIS, check_frames

CELL = 8  # px of the image to a cell of the feature grid
LEVELS = 4  # of the correlation pyramid
SMALLEST = CELL * 2 ** (LEVELS - 1)  # px; the last level then has one cell
SIZES = ("small", "large")
WEIGHTS = "model.safetensors"
CONFIG = "config.json"


class Block(nn.Module):
    """A residual unit of the encoders: two 3x3 convolutions, or 1x1, 3x3, 1x1 where `bottleneck`."""

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
    """Correlation and flow of each cell to motion features, the flow itself appended."""

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
    """The same with a 1x5 and then a 5x1 unit."""

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
    """One iteration: correlation and flow to the next hidden state and the change of the flow."""

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
    """The all-pairs correlation pyramid (section 3.2): level l holds <a_ij, mean of b over 2^l x 2^l cells>.

    features_a, features_b: (B, D, h, w).
    """

    def __init__(self, features_a: Tensor, features_b: Tensor, radius: int) -> None:
        b, d, h, w = features_a.shape
        volume = torch.matmul(features_a.flatten(2).transpose(1, 2), features_b.flatten(2)) / math.sqrt(d)
        self.radius = radius
        self.pyramid = [volume.view(b * h * w, 1, h, w)]
        for _ in range(LEVELS - 1):
            self.pyramid.append(F.avg_pool2d(self.pyramid[-1], 2, stride=2))
        steps = torch.arange(-radius, radius + 1, device=volume.device, dtype=volume.dtype)
        # The release lets x vary along the window's first axis; its weights expect that order.
        self.window = torch.stack(torch.meshgrid(steps, steps, indexing="ij"), dim=-1)  # (2r+1, 2r+1, 2) x, y

    def lookup(self, position: Tensor) -> Tensor:
        """Bilinear samples around `position` (B, 2, h, w), in cells of b; zero outside: (B, 4 (2r+1)^2, h, w)."""
        b, _, h, w = position.shape
        centre = position.permute(0, 2, 3, 1).reshape(b * h * w, 1, 1, 2)
        samples = []
        for level, volume in enumerate(self.pyramid):
            size = torch.tensor([volume.shape[3], volume.shape[2]], device=position.device, dtype=position.dtype)
            grid = (2 * (centre / 2**level + self.window) + 1) / size - 1
            samples.append(F.grid_sample(volume, grid, align_corners=False).view(b, h, w, -1))
        return torch.cat(samples, dim=-1).permute(0, 3, 1, 2).contiguous()


class RAFT(nn.Module):
    """Flow from image a to image b, in px of a. `size` is one of SIZES; `large` always upsamples convexly.

    warm_start: a preset of DIS whose flow is refined, instead of none (the release's `flow_init`).
    """

    def __init__(self, size: str = "small", convex_upsampling: bool = False, warm_start: str | None = None) -> None:
        super().__init__()
        assert size in SIZES, size
        small = size == "small"
        self.size = size
        self.warm_start = warm_start
        self.convex_upsampling = convex_upsampling or not small
        self.hidden = 96 if small else 128
        self.radius = 3 if small else 4
        context = 64 if small else 128
        planes = (32, 64, 96) if small else (64, 96, 128)
        self.fnet = Encoder(128 if small else 256, "instance", planes, bottleneck=small)
        self.cnet = Encoder(self.hidden + context, "none" if small else "batch", planes, bottleneck=small)
        self.update_block = UpdateBlock(small, self.hidden, context, self.radius, self.convex_upsampling)

    def correlate(self, a: Tensor, b: Tensor) -> Correlation:
        """The correlation pyramid of two images (B, 3, H, W) in 0 to 255."""
        features_a, features_b = self.fnet(torch.cat([a, b]) / 127.5 - 1).chunk(2)
        return Correlation(features_a, features_b, self.radius)

    def forward(
        self,
        a: Tensor,
        b: Tensor,
        iterations: int = 12,
        every: bool = True,
        draft: bool = False,
        correlation: Correlation | None = None,
        start: Tensor | None = None,
    ) -> list[Tensor]:
        """Flow (B, 2, H, W) in px after each iteration, or the last alone where not `every`.

        a, b: (B, 3, H, W) in 0 to 255; H and W multiples of 8 and at least 64. draft: all but the last are upsampled
        bilinearly, which saves a quarter of a training step. correlation: `correlate(a, b)`, where it is at hand.
        start: flow (B, 2, H, W), px, to begin with instead of none (the paper's warm start).
        """
        correlation = correlation or self.correlate(a, b)
        state = self.cnet(a / 127.5 - 1)
        h, context = torch.tanh(state[:, : self.hidden]), F.relu(state[:, self.hidden :])
        grid = cell_grid(h)
        position = grid if start is None else grid + F.avg_pool2d(start, CELL) / CELL
        flows = []
        for i in range(iterations):
            position = position.detach()
            h, change = self.update_block(h, context, correlation.lookup(position), position - grid)
            position = position + change
            if i == iterations - 1 or (every and not draft):
                flows.append(self.upsample(position - grid, h))
            elif every:
                flows.append(CELL * F.interpolate(position - grid, scale_factor=CELL, mode="bilinear"))
        return flows

    def upsample(self, flow: Tensor, h: Tensor) -> Tensor:
        """(B, 2, h, w) in cells to (B, 2, 8h, 8w) in px."""
        if self.update_block.mask is None:
            return CELL * F.interpolate(flow, scale_factor=CELL, mode="bilinear", align_corners=True)
        return convex_upsample(flow, 0.25 * self.update_block.mask(h))

    @torch.inference_mode()
    def flow(
        self,
        frames_a: np.ndarray,
        frames_b: np.ndarray,
        iterations: int = 12,
        size: tuple[int, int] | None = None,
        batch: int = 8,
    ) -> np.ndarray:
        """Flow of each pair, (B, H, W, 2) float32, px of the frames given, x right and y down.

        frames_a, frames_b: (B, H, W, 3) uint8 RGB. size: (width, height) in px at which RAFT works; None: the
        frames' own. Frames are padded (edges repeated) by a cell on each side and to multiples of 8.
        """
        count, height, width = check_frames(frames_a, frames_b)
        self.eval()
        device = next(self.parameters()).device
        out = np.empty((count, height, width, 2), np.float32)
        working = (height, width) if size is None else (size[1], size[0])
        for i in range(0, count, batch):
            a, b = (
                torch.from_numpy(np.ascontiguousarray(f[i : i + batch])).to(device).permute(0, 3, 1, 2).float()
                for f in (frames_a, frames_b)
            )
            start = None
            if self.warm_start is not None:
                rough = DIS(self.warm_start).flow(frames_a[i : i + batch], frames_b[i : i + batch])
                start = resize_flow(torch.from_numpy(rough).to(device).permute(0, 3, 1, 2), working)
            flow = self.padded(resize(a, working), resize(b, working), iterations, start)
            flow = resize_flow(flow, (height, width))
            out[i : i + batch] = flow.permute(0, 2, 3, 1).cpu().numpy()
        return out

    def padded(self, a: Tensor, b: Tensor, iterations: int, start: Tensor | None) -> Tensor:
        """The last flow alone, of frames with a margin of a cell or more: beside its border convex upsampling has zeros
        to choose from, which stand for no motion."""
        height, width = a.shape[-2:]
        down, right = (max(SMALLEST, -(-n // CELL) * CELL + 2 * CELL) - n for n in (height, width))
        left, top = right // 2, down // 2
        padding = (left, right - left, top, down - top)
        a, b = (F.pad(x, padding, mode="replicate") for x in (a, b))
        start = None if start is None else F.pad(start, padding, mode="replicate")
        return self(a, b, iterations, every=False, start=start)[-1][..., top : top + height, left : left + width]

    def save(self, folder: Path | str) -> None:
        """Write `model.safetensors` and `config.json` (each to a temporary name, then renamed)."""
        from safetensors.torch import save_file

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        weights = {k: v.detach().cpu().contiguous() for k, v in self.state_dict().items()}
        save_file(weights, folder / (WEIGHTS + ".part"), metadata={"format": "pt"})
        (folder / (WEIGHTS + ".part")).chmod(0o644)  # safetensors writes for its owner alone
        (folder / (WEIGHTS + ".part")).replace(folder / WEIGHTS)
        config = {
            "model_type": "raft",
            "size": self.size,
            "convex_upsampling": self.convex_upsampling,
            "warm_start": self.warm_start,
        }
        (folder / (CONFIG + ".part")).write_text(json.dumps(config, indent=2) + "\n")
        (folder / (CONFIG + ".part")).replace(folder / CONFIG)


def cell_grid(state: Tensor) -> Tensor:
    """(B, 2, h, w): each cell's own x and y."""
    b, _, h, w = state.shape
    y, x = torch.meshgrid(torch.arange(h, device=state.device), torch.arange(w, device=state.device), indexing="ij")
    return torch.stack([x, y]).to(state.dtype).expand(b, 2, h, w)


def convex_upsample(flow: Tensor, mask: Tensor) -> Tensor:
    """Each fine px is a convex combination of the 3x3 coarse cells around it: (B, 2, h, w) to (B, 2, 8h, 8w) px.

    mask: (B, 9 * 64, h, w), logits.
    """
    b, _, h, w = flow.shape
    weights = torch.softmax(mask.view(b, 1, 9, CELL, CELL, h, w), dim=2)
    cells = F.unfold(CELL * flow, (3, 3), padding=1).view(b, 2, 9, 1, 1, h, w)
    return (weights * cells).sum(dim=2).permute(0, 1, 4, 2, 5, 3).reshape(b, 2, CELL * h, CELL * w)


def sequence_loss(flows: list[Tensor], truth: Tensor, weight: Tensor, gamma: float = 0.8) -> Tensor:
    """Weighted mean of the L1 distance to `truth` (B, 2, H, W) px, iteration i of N counting gamma^(N-i) (eq. 7).

    weight: (B, H, W), zero where the truth is not known.
    """
    total = weight.sum().clamp(min=1e-6)
    last = len(flows) - 1
    terms = [gamma ** (last - i) * ((f - truth).abs().sum(1) * weight).sum() / total for i, f in enumerate(flows)]
    return torch.stack(terms).sum()


def resize(images: Tensor, size: tuple[int, int]) -> Tensor:
    """(B, C, H, W) to (B, C, *size), smoothed where it shrinks."""
    if images.shape[-2:] == size:
        return images
    return F.interpolate(images, size=size, mode="bilinear", align_corners=False, antialias=True)


def resize_flow(flow: Tensor, size: tuple[int, int]) -> Tensor:
    """Flow (B, 2, H, W) at another size, its values scaled to that size's px."""
    scale = torch.tensor([size[1] / flow.shape[-1], size[0] / flow.shape[-2]], device=flow.device, dtype=flow.dtype)
    return resize(flow, size) * scale.view(1, 2, 1, 1)


def load_raft(path: Path | str) -> RAFT:
    """RAFT from our folder (model.safetensors, config.json) or a published checkpoint (.pth), ready to infer."""
    path = Path(path)
    if not path.exists():
        raise ModelError(
            f"no RAFT weights at {path}: give a folder with {WEIGHTS} (models/raft-small ships with the project) or a "
            "checkpoint of princeton-vl/RAFT (its download_models.sh fetches raft-small.pth, raft-things.pth, ...)"
        )
    state = read_folder(path) if path.is_dir() else read_checkpoint(path)
    size = "small" if "update_block.gru.convz.weight" in state else "large"
    warm_start = read_config(path / CONFIG).get("warm_start") if path.is_dir() else None
    model = RAFT(size, convex_upsampling="update_block.mask.0.weight" in state, warm_start=warm_start)
    try:
        model.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in state.items()})
    except RuntimeError as error:
        raise ModelError(f"{path} does not hold RAFT {model.size}: {str(error).splitlines()[1].strip()}") from error
    return model.eval()


def read_folder(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    if not (path / WEIGHTS).is_file():
        raise ModelError(f"{path} has no {WEIGHTS}: it is not a folder of RAFT weights")
    try:
        return load_file(path / WEIGHTS)
    except (SafetensorError, OSError) as error:
        raise ModelError(f"{path / WEIGHTS} cannot be read: {error}") from error


def read_config(path: Path) -> dict[str, Any]:
    try:
        return dict(json.loads(path.read_text()))
    except (OSError, ValueError, TypeError) as error:
        raise ModelError(f"{path} is missing or broken: it belongs to the weights beside it") from error


def read_checkpoint(path: Path) -> dict[str, Tensor]:
    """A published state dict, without its `module.` prefix and the second names of the blocks' last norms."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise ModelError(f"{path} is not a PyTorch checkpoint of weights alone: {error}") from error
    if not isinstance(state, dict) or not all(isinstance(v, Tensor) for v in state.values()):
        raise ModelError(f"{path} is not a state dict: save `model.state_dict()`")
    state = {k.removeprefix("module."): v for k, v in state.items()}
    # In the release a downsampling block's norm3 (norm4 in bottlenecks) is also downsample.1; we keep the latter.
    return {k: v for k, v in state.items() if not is_second_name(k, state)}


def is_second_name(key: str, state: dict[str, Tensor]) -> bool:
    block, _, rest = key.partition(".norm")
    if not rest or rest[0] not in "34":
        return False
    return f"{block}.downsample.1.{rest[2:]}" in state and (rest[0] == "4" or f"{block}.conv3.weight" not in state)
