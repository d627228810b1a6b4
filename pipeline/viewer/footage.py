"""What there is to see of a clip: motions of scenes, and pictures that were taken of them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.language.events import Event
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class Motion:
    """A scene and how it moved. name: its place in the viewer (`replay`, `original`). solid: drawn as solid bodies,
    else as wires. events: what happened in it."""

    name: str
    scene: Scene
    trace: Trace
    solid: bool = True
    events: tuple[Event, ...] = ()


@dataclass(frozen=True)
class Pictures:
    """What a camera saw, all of one size. rgb (F, H, W, 3) uint8 and masks (F, H, W) uint8, 0 for the background, of
    every frame; depth (P, H, W), m, inf where there is nothing, and flow (P, H, W, 2), px to the next frame, of the
    frames `depth_frames` and `flow_frames` (P,)."""

    rgb: np.ndarray | None = None
    masks: np.ndarray | None = None
    depth: np.ndarray | None = None
    depth_frames: np.ndarray = field(default_factory=lambda: np.zeros(0, int))
    flow: np.ndarray | None = None
    flow_frames: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) px; None where there are no pictures."""
        there = [a for a in (self.rgb, self.masks, self.depth, self.flow) if a is not None]
        sizes = {(a.shape[2], a.shape[1]) for a in there}
        assert len(sizes) <= 1, f"pictures of one camera have one size, not {sizes}"
        return sizes.pop() if sizes else None


@dataclass(frozen=True)
class Footage:
    """A clip: what the camera saw and, where there is one, what the replay's pictures look like; the motions, of which
    the first has the camera; notes in Markdown.

    name: of the clip; it becomes the recording's id. fps: frames a second. titles: of what was seen and replayed.
    """

    name: str
    notes: str
    motions: tuple[Motion, ...]
    seen: Pictures = field(default_factory=Pictures)
    replayed: Pictures = field(default_factory=Pictures)
    fps: float = 30.0
    titles: tuple[str, str] = ("clip", "replay")
