"""RAFT, recurrent all-pairs field transforms for optical flow (Teed & Deng, ECCV 2020, arXiv:2003.12039).

There are two sizes, `small` and `large`. Parameter names are those of the authors' release (princeton-vl/RAFT), so
published checkpoints load by path. The weights that ship are `small` with the learned convex upsampling of `large`
(section 3.3 of the paper): at 240x160 an object is two or three cells of the 1/8 grid wide, and bilinear upsampling
would blur its edges over all of it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from pipeline.errors import ModelError
from pipeline.untrusted import read_json
from pipeline.vision.flow.dis import DIS, check_frames
from pipeline.vision.flow.raft_layers import CELL, LEVELS, Correlation, Encoder, UpdateBlock

SMALLEST_SIDE = CELL * 2 ** (LEVELS - 1)  # px; the last level of the pyramid then has one cell
SIZES = ("small", "large")
WEIGHTS = "model.safetensors"
CONFIG = "config.json"


class RAFT(nn.Module):
    """The network. It estimates the flow from image a to image b, in px.

    size: one of `SIZES`. convex_upsampling: always on for `large`. warm_start: a preset of DIS whose flow is the
    initial flow (`flow_init` of the release); None: zero flow.
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
        """The correlation pyramid of images (B, 3, H, W) in 0 to 255."""
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
        """Estimate the flow.

        Args:
            a: First images (B, 3, H, W) in 0 to 255; H and W are multiples of 8 and at least 64.
            b: Second images, like a.
            iterations: Number of updates.
            every: Return the flow after each iteration; else only the last.
            draft: Upsample all but the last flow bilinearly, which saves a quarter of a training step.
            correlation: `correlate(a, b)`, if the caller has it.
            start: Initial flow (B, 2, H, W), px; None: zero.

        Returns:
            Flows (B, 2, H, W), px.
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
        """Flow (B, 2, h, w) in cells to (B, 2, 8h, 8w) in px. h: the hidden state."""
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
        """Flow from each frame of `frames_a` to that of `frames_b`.

        Frames are padded by edge replication, by a cell on each side and to multiples of 8.

        Args:
            frames_a: (B, H, W, 3) uint8 RGB.
            frames_b: (B, H, W, 3) uint8 RGB.
            iterations: Number of updates.
            size: Working size (width, height), px; None: that of the frames.
            batch: Pairs that are computed together.

        Returns:
            (B, H, W, 2) float32, px of the given frames, x right and y down.
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
                initial = DIS(self.warm_start).flow(frames_a[i : i + batch], frames_b[i : i + batch])
                start = resize_flow(torch.from_numpy(initial).to(device).permute(0, 3, 1, 2), working)
            flow = self.flow_of_padded(resize(a, working), resize(b, working), iterations, start)
            flow = resize_flow(flow, (height, width))
            out[i : i + batch] = flow.permute(0, 2, 3, 1).cpu().numpy()
        return out

    def flow_of_padded(self, a: Tensor, b: Tensor, iterations: int, start: Tensor | None) -> Tensor:
        """The flow (B, 2, H, W) of images that are padded by at least one cell on each side.

        Without the margin, convex upsampling would mix in the zeros beyond the border.
        """
        height, width = a.shape[-2:]
        down, right = (max(SMALLEST_SIDE, -(-n // CELL) * CELL + 2 * CELL) - n for n in (height, width))
        left, top = right // 2, down // 2
        padding = (left, right - left, top, down - top)
        a, b = (F.pad(x, padding, mode="replicate") for x in (a, b))
        start = None if start is None else F.pad(start, padding, mode="replicate")
        return self(a, b, iterations, every=False, start=start)[-1][..., top : top + height, left : left + width]

    def save(self, folder: Path | str) -> None:
        """Write `model.safetensors` and `config.json`, each under a temporary name that is then replaced."""
        from safetensors.torch import save_file

        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        weights = {k: v.detach().cpu().contiguous() for k, v in self.state_dict().items()}
        save_file(weights, folder / (WEIGHTS + ".part"), metadata={"format": "pt"})
        (folder / (WEIGHTS + ".part")).chmod(0o644)  # safetensors makes it readable for its owner only
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
    """Coordinates x, y of each cell, (B, 2, h, w)."""
    b, _, h, w = state.shape
    y, x = torch.meshgrid(torch.arange(h, device=state.device), torch.arange(w, device=state.device), indexing="ij")
    return torch.stack([x, y]).to(state.dtype).expand(b, 2, h, w)


def convex_upsample(flow: Tensor, mask: Tensor) -> Tensor:
    """Upsample flow (B, 2, h, w) in cells to (B, 2, 8h, 8w) px: each pixel is a convex combination of 3x3 cells.

    mask: logits of the weights, (B, 9 * 64, h, w).
    """
    b, _, h, w = flow.shape
    weights = torch.softmax(mask.view(b, 1, 9, CELL, CELL, h, w), dim=2)
    cells = F.unfold(CELL * flow, (3, 3), padding=1).view(b, 2, 9, 1, 1, h, w)
    return (weights * cells).sum(dim=2).permute(0, 1, 4, 2, 5, 3).reshape(b, 2, CELL * h, CELL * w)


def sequence_loss(flows: list[Tensor], truth: Tensor, weight: Tensor, gamma: float = 0.8) -> Tensor:
    """The loss of equation 7: the weighted mean L1 distance to the truth, with gamma^(N-i) for iteration i of N.

    Args:
        flows: N flows (B, 2, H, W), px.
        truth: (B, 2, H, W), px.
        weight: (B, H, W), zero where the truth is not known.
        gamma: Base of the iterations' weights.
    """
    total = weight.sum().clamp(min=1e-6)
    last = len(flows) - 1
    terms = [gamma ** (last - i) * ((f - truth).abs().sum(1) * weight).sum() / total for i, f in enumerate(flows)]
    return torch.stack(terms).sum()


def resize(images: Tensor, size: tuple[int, int]) -> Tensor:
    """Images (B, C, H, W) to (B, C, *size), with anti-aliasing."""
    if images.shape[-2:] == size:
        return images
    return F.interpolate(images, size=size, mode="bilinear", align_corners=False, antialias=True)


def resize_flow(flow: Tensor, size: tuple[int, int]) -> Tensor:
    """Flow (B, 2, H, W) px resized to (height, width), with its values in px of that size."""
    scale = torch.tensor([size[1] / flow.shape[-1], size[0] / flow.shape[-2]], device=flow.device, dtype=flow.dtype)
    return resize(flow, size) * scale.view(1, 2, 1, 1)


def load_raft(path: Path | str) -> RAFT:
    """RAFT in evaluation mode, from a folder with model.safetensors and config.json or a published checkpoint (.pth).

    Raises ModelError where the weights are missing, damaged, or not of RAFT.
    """
    path = Path(path)
    if not path.exists():
        raise ModelError(
            f"no RAFT weights at {path}; valid: a folder with {WEIGHTS} (models/raft-small ships with the project) or "
            "a checkpoint of princeton-vl/RAFT (its download_models.sh fetches raft-small.pth, raft-things.pth, ...)"
        )
    state = read_folder(path) if path.is_dir() else read_checkpoint(path)
    size = "small" if "update_block.gru.convz.weight" in state else "large"
    warm_start = read_config(path / CONFIG).get("warm_start") if path.is_dir() else None
    model = RAFT(size, convex_upsampling="update_block.mask.0.weight" in state, warm_start=warm_start)
    try:
        model.load_state_dict({k: v.float() if v.is_floating_point() else v for k, v in state.items()})
    except RuntimeError as error:
        raise ModelError(
            f"{path} does not contain the weights of RAFT {model.size}: {str(error).splitlines()[1].strip()}"
        ) from error
    return model.eval()


def read_folder(path: Path) -> dict[str, Tensor]:
    from safetensors import SafetensorError
    from safetensors.torch import load_file

    if not (path / WEIGHTS).is_file():
        raise ModelError(f"{path} has no {WEIGHTS}, so it is not a folder of RAFT weights")
    try:
        return load_file(path / WEIGHTS)
    except (SafetensorError, OSError) as error:
        raise ModelError(f"{path / WEIGHTS} cannot be read: {error}") from error


def read_config(path: Path) -> dict[str, Any]:
    try:
        return read_json(path, ModelError)
    except ModelError as error:
        raise ModelError(f"{path} is missing or damaged; the weights beside it need it") from error


def read_checkpoint(path: Path) -> dict[str, Tensor]:
    """A published state dict without its `module.` prefix and without duplicate names of normalisation layers."""
    try:
        state = torch.load(path, map_location="cpu", weights_only=True)
    except Exception as error:
        raise ModelError(f"{path} is not a PyTorch checkpoint with only weights: {error}") from error
    if not isinstance(state, dict) or not all(isinstance(v, Tensor) for v in state.values()):
        raise ModelError(f"{path} is not a state dict: save `model.state_dict()`")
    state = {k.removeprefix("module."): v for k, v in state.items()}
    # In the release, norm3 of a downsampling block (norm4 in bottlenecks) is also downsample.1; the latter is kept.
    return {k: v for k, v in state.items() if not is_duplicate(k, state)}


def is_duplicate(key: str, state: dict[str, Tensor]) -> bool:
    block, _, rest = key.partition(".norm")
    if not rest or rest[0] not in "34":
        return False
    return f"{block}.downsample.1.{rest[2:]}" in state and (rest[0] == "4" or f"{block}.conv3.weight" not in state)
