"""What the viewer shows of a clip: motions of scenes, pictures and notes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pipeline.clips.events import Event
from pipeline.model.language.completion import event_phrase
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene


@dataclass(frozen=True)
class MotionLayer:
    """A scene and its motion, one layer of the viewer.

    Attributes:
        name: Its name in the viewer, such as `replay` or `original`.
        scene: The scene.
        trace: Its simulation.
        solid: Whether bodies are drawn solid; else as wire frames.
        events: Its events.
    """

    name: str
    scene: Scene
    trace: Trace
    solid: bool = True
    events: tuple[Event, ...] = ()


@dataclass(frozen=True)
class Pictures:
    """Pictures from one camera, all of one size.

    Attributes:
        rgb: (F, H, W, 3) uint8, of every frame.
        masks: (F, H, W) uint8, 0 for the background, of every frame.
        depth: (P, H, W) m, inf for the background.
        flow: (P, H, W, 2) px per frame interval.
        frames: (P,) the frames of `depth` and `flow`.
    """

    rgb: np.ndarray | None = None
    masks: np.ndarray | None = None
    depth: np.ndarray | None = None
    flow: np.ndarray | None = None
    frames: np.ndarray = field(default_factory=lambda: np.zeros(0, int))

    @property
    def size(self) -> tuple[int, int] | None:
        """(width, height) px; None without pictures."""
        there = [a for a in (self.rgb, self.masks, self.depth, self.flow) if a is not None]
        sizes = {(a.shape[2], a.shape[1]) for a in there}
        assert len(sizes) <= 1, f"pictures of one camera must have one size, not {sizes}"
        return sizes.pop() if sizes else None


@dataclass(frozen=True)
class Footage:
    """Everything that the viewer shows of a clip.

    Attributes:
        name: Name of the clip, and id of the recording.
        notes: Markdown.
        motions: Layers of the 3D view. The first has the camera.
        seen: Pictures of the clip.
        replayed: Pictures of the replay, if there is one.
        times: (F,) s, of the clip's frames.
        titles: Titles of the two groups of pictures.
    """

    name: str
    notes: str
    motions: tuple[MotionLayer, ...]
    seen: Pictures = field(default_factory=Pictures)
    replayed: Pictures = field(default_factory=Pictures)
    times: np.ndarray = field(kw_only=True)
    titles: tuple[str, str] = ("clip", "replay")


def event_text(event: Event, scene: Scene) -> str:
    """An event in words, with the names of the objects: `sphere_0 hits box_1`."""
    names = [o.name for o in scene.objects]
    if event.kind == "hits_object":
        assert event.second is not None
        return f"{names[event.first]} hits {names[event.second]}"
    return f"{names[event.first]}{event_phrase(event, scene)}"
