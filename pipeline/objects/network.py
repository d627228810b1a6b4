"""The network that reads objects.

A crop and numbers of each body in each frame make a token. Blocks of attention over a body's frames come first, then
blocks over all bodies and frames, then the numbers of the scene and of each body.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from pipeline.language.completion import MAX_OBJECTS
from pipeline.objects.fields import FREE, NOTHING, OBJECT_FIELDS, SCENE_FIELDS, on_scale
from pipeline.objects.instances import CHANNELS, FULL, HEIGHT, PLACES, SIDE, WIDTH
from pipeline.objects.number_chain import Draw, NumberChain

WAVES = 5
#: A camera in the middle of the training's range. Places on its ground are features, so that the network need not learn
#: what perspective is.
CAMERA_HEIGHT, CAMERA_PITCH, CAMERA_FOV = 0.95, math.radians(-22.4), 37.0
MOTION = 9  # numbers of a body's motion in a frame, learned beside the scene


@dataclass(frozen=True)
class ObjectsSize:
    """Of the network.

    Attributes:
        width: Features of a token.
        heads: Of attention.
        own_blocks: Of attention over one body's frames.
        blocks: Of attention over everything.
        channels: Of the three convolutions.
        frames: Of a clip.
    """

    width: int = 192
    heads: int = 6
    own_blocks: int = 2
    blocks: int = 3
    channels: tuple[int, int, int] = (16, 32, 64)
    frames: int = 10


class Block(nn.Module):
    """Attention of all tokens to all, and a layer per token."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.norm_attention, self.norm_layer = nn.LayerNorm(width), nn.LayerNorm(width)
        self.qkv, self.out = nn.Linear(width, 3 * width), nn.Linear(width, width)
        self.up, self.down = nn.Linear(width, 4 * width), nn.Linear(4 * width, width)

    def forward(self, x: Tensor) -> Tensor:
        """(B, L, width) to the same."""
        b, length, d = x.shape
        q, k, v = (
            self.qkv(self.norm_attention(x)).view(b, length, 3, self.heads, d // self.heads).permute(2, 0, 3, 1, 4)
        )
        seen = functional.scaled_dot_product_attention(q, k, v).transpose(1, 2).reshape(b, length, d)
        x = x + self.out(seen)
        return x + self.down(functional.gelu(self.up(self.norm_layer(x)), approximate="tanh"))


@dataclass(frozen=True)
class Read:
    """What the network has read: bodies (B, N, width), scene (B, width), frames (B, N, T, width)."""

    bodies: Tensor
    scene: Tensor
    frames: Tensor


class ObjectsNetwork(nn.Module):
    """From instances to distributions over the numbers of a scene."""

    free: Tensor

    def __init__(self, size: ObjectsSize) -> None:
        super().__init__()
        self.size = size
        width, (a, b, c) = size.width, size.channels
        self.crop = nn.Sequential(
            nn.Conv2d(len(CHANNELS), a, 4, 2, 1),
            nn.GELU(),
            nn.Conv2d(a, b, 3, 2, 1),
            nn.GELU(),
            nn.Conv2d(b, c, 3, 2, 1),
            nn.GELU(),
            nn.Flatten(),
            nn.Linear(c * (SIDE // 8) ** 2, width),
        )
        known = place_features(torch.zeros(1, size.frames, len(PLACES))).shape[-1]
        self.place = nn.Sequential(nn.Linear(known, width), nn.GELU(), nn.Linear(width, width))
        self.time = nn.Parameter(torch.randn(size.frames, width) * 0.02)
        self.unseen = nn.Parameter(torch.randn(width) * 0.02)
        self.slot = nn.Parameter(torch.randn(MAX_OBJECTS, width) * 0.5)  # which body a token belongs to
        self.query = nn.Parameter(torch.randn(2, width) * 0.02)  # of a body, of the scene
        self.own_blocks = nn.ModuleList(Block(width, size.heads) for _ in range(size.own_blocks))
        self.blocks = nn.ModuleList(Block(width, size.heads) for _ in range(size.blocks))
        self.norm = nn.LayerNorm(width)
        self.scene = NumberChain(SCENE_FIELDS, width)
        self.bodies = NumberChain(OBJECT_FIELDS, width, choices=NOTHING + 1)
        self.from_scene = nn.Linear(width, width)
        self.scene_numbers = nn.Parameter(torch.randn(len(SCENE_FIELDS), 1 + 2 * WAVES, width) * 0.1)
        self.frame_labels = nn.Sequential(nn.LayerNorm(width), nn.Linear(width, NOTHING + 1 + MOTION))
        self.register_buffer("free", torch.from_numpy(FREE), persistent=False)

    def read(self, crops: Tensor, places: Tensor, slots: Tensor | None = None) -> Read:
        """Read clips of equally many bodies.

        Args:
            crops: (B, N, T, 4, SIDE, SIDE) int8.
            places: (B, N, T, 14).
            slots: (B, N) int, the bodies' marks, which differ within a clip; None: their order.
        """
        b, n, t = places.shape[:3]
        here = places[..., 0] > 0
        looks = self.crop(crops[here].float() / FULL)
        x = self.place(place_features(places.flatten(0, 1))).view(b, n, t, -1).float()
        x = torch.where(here[..., None], x, self.unseen)
        x = x.masked_scatter(here[..., None], x[here] + looks.float()) + self.time
        x = torch.cat([x.mean(2, keepdim=True) + self.query[0], x], 2).flatten(0, 1)
        for block in self.own_blocks:
            x = block(x)
        x = x.view(b, n, t + 1, -1)
        frames = x[:, :, 1:]
        marks = self.slot[:n].expand(b, n, -1) if slots is None else self.slot[slots]
        x = (x + marks[:, :, None]).flatten(1, 2)
        x = torch.cat([self.query[1] + x.mean(1, keepdim=True), x], 1)
        for block in self.blocks:
            x = block(x)
        x = self.norm(x)
        return Read(x[:, 1 :: t + 1], x[:, 0], frames)

    def known(self, read: Read, numbers: Tensor) -> Tensor:
        """(B, N, width) what is known of each body, with the scene's numbers (B, 4) on their scales."""
        scene = torch.einsum("bkf,kfd->bd", self.scene.waves(numbers), self.scene_numbers)
        return read.bodies + (self.from_scene(read.scene) + scene)[:, None]

    @torch.no_grad()
    def write_scene(self, read: Read, draw: Draw) -> tuple[Tensor, Tensor]:
        """Numbers (B, 4) of the scene, on their scales, and their log-probabilities (B,)."""
        return self.scene.write(read.scene, draw)

    @torch.no_grad()
    def write_bodies(self, known: Tensor, shapes: Tensor, draw: Draw) -> tuple[Tensor, Tensor]:
        """Numbers (M, 19) of bodies of basic shapes (M,), on their scales, and their log-probabilities (M,).

        known: (M, width) rows of `known`.
        """
        return self.bodies.write(known, draw, shapes, self.free[shapes])

    def losses(
        self, crops: Tensor, places: Tensor, scene: Tensor, shapes: Tensor, values: Tensor, slots: Tensor
    ) -> tuple[Tensor, Tensor, Tensor, Read]:
        """Losses, nats: (B, 4) of the scene's numbers, (B * N,) of shapes, (B * N, 19) of the bodies' numbers.

        Args:
            crops: (B, N, T, 4, SIDE, SIDE) int8.
            places: (B, N, T, 14).
            scene: (B, 4).
            shapes: (B, N) int64.
            values: (B, N, 19).
            slots: (B, N).
        """
        read = self.read(crops, places, slots)
        scene, values, shapes = (
            on_scale(scene, SCENE_FIELDS),
            on_scale(values.flatten(0, 1), OBJECT_FIELDS),
            shapes.flatten(),
        )
        of_scene, _ = self.scene.losses(read.scene, scene)
        each, of_shape = self.bodies.losses(self.known(read, scene).flatten(0, 1), values, shapes)
        assert of_shape is not None
        real = shapes != NOTHING
        free = self.free[shapes.clamp(max=NOTHING - 1)] & real[:, None]
        return of_scene, of_shape, each * free, read


def place_features(places: Tensor) -> Tensor:
    """(M, T, F) of places (M, T, 14); 0 where the body is not seen."""
    seen = places[..., :1]
    left, right, top, bottom, x, y, area = (places[..., k] for k in range(1, 8))
    across, down = torch.stack([left, right, x], -1) / WIDTH, torch.stack([top, bottom, y], -1) / HEIGHT
    spots = 2 * torch.cat([across, down], -1) - 1
    waves = spots[..., None] * (math.pi * 2.0 ** torch.arange(WAVES, device=places.device))
    wide, high, area = (right - left).clamp(min=1), (bottom - top).clamp(min=1), area.clamp(min=1)
    sizes = [
        wide.log() - 3.3,
        high.log() - 3.3,
        0.5 * area.log() - 3,
        2 * area / (wide * high) - 1.5,
        (wide / high).log(),
    ]
    ground, depth = _ground((left + right) / 2, bottom)
    focal = HEIGHT / (2 * math.tan(math.radians(CAMERA_FOV) / 2))
    metres = torch.stack([wide, high], -1) * depth[..., None] / focal * 4
    both = (places[:, :-1, 0] * places[:, 1:, 0])[..., None]
    steps = torch.cat(
        [
            torch.stack([x[:, 1:] - x[:, :-1], y[:, 1:] - y[:, :-1]], -1) / 10,
            5 * (ground[:, 1:, :2] - ground[:, :-1, :2]).clamp(-1, 1),
            2 * (area[:, 1:] / area[:, :-1]).log().clamp(-1, 1)[..., None],
        ],
        -1,
    )
    steps = functional.pad(steps * both, (0, 0, 0, 1))
    parts = [
        spots,
        waves.sin().flatten(-2),
        waves.cos().flatten(-2),
        torch.stack(sizes, -1),
        torch.asinh(2 * places[..., 8:10]),
        ground,
        metres,
        steps,
        places[..., 10:14],
        torch.ones_like(seen),
    ]
    return torch.cat(parts, -1) * seen


def _ground(column: Tensor, row: Tensor) -> tuple[Tensor, Tensor]:
    """Where the middle camera sees the ground at a pixel: (…, 3) features of the place, (…) depth, m."""
    focal = HEIGHT / (2 * math.tan(math.radians(CAMERA_FOV) / 2))
    up = (HEIGHT / 2 - row) / focal
    rise = math.cos(CAMERA_PITCH) * up + math.sin(CAMERA_PITCH)
    ahead = math.cos(CAMERA_PITCH) - math.sin(CAMERA_PITCH) * up
    depth = (CAMERA_HEIGHT / (-rise).clamp(min=0.05)).clamp(max=6)
    return torch.stack([depth * (column - WIDTH / 2) / focal, depth * ahead - 2, depth - 2], -1), depth
