"""A scene, run and seen: its trace at the frames of a clip, its events, masks and pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.areas import areas_px
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks, pair_view, trace_pairs
from pipeline.errors import SceneError
from pipeline.language.events import Event, Thresholds, find_events
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.viewer.footage import event_text
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_rgb

SIZE = (480, 320)  # px, width and height


@dataclass(frozen=True)
class Replay:
    """A scene with its trace, and the masks (F, H, W) and flow (P, H, W, 2) that its camera sees."""

    scene: Scene
    trace: Trace
    events: tuple[Event, ...]
    masks: np.ndarray
    depth: np.ndarray
    flow: np.ndarray

    @property
    def event_texts(self) -> list[str]:
        return [f"t={e.time:.2f}s: {event_text(e, self.scene)}" for e in self.events]


def run_schedule(seconds: float) -> Schedule:
    """The frames of a run of any length. Raises SceneError where there are fewer than two."""
    usual = Schedule()
    frames = round(seconds * usual.fps)
    if frames < 2:
        raise SceneError(f"{seconds:g} s are less than two frames; valid: at least {2 / usual.fps:.3f} s")
    return Schedule(seconds=seconds, model_frames=min(usual.model_frames, frames - 1))


def run_scene(scene: Scene, schedule: Schedule) -> Trace:
    """The scene's trace over the clip. Raises SimulationError."""
    return simulate(scene, schedule.seconds)


def replay(scene: Scene, trace: Trace, schedule: Schedule) -> Replay:
    """What the scene's camera sees of its trace, without light and colour. The scene has a camera."""
    masks = frame_masks(scene, trace, schedule, *SIZE)
    view = pair_view(scene, *trace_pairs(trace, schedule), *SIZE)
    areas = areas_px(masks, len(scene.objects))
    events = find_events(trace, scene.shapes, areas, schedule.frame_steps, Thresholds())
    return Replay(scene, trace, tuple(events), masks, view.depth, view.flow)


def pictures(scene: Scene, trace: Trace, schedule: Schedule, backend: str) -> np.ndarray:
    """RGB frames (F, H, W, 3) in the plain appearance, whose colours are the same in every output."""
    steps = schedule.frame_steps
    look = plain_appearance(len(scene.objects))
    return render_rgb(scene, trace.position[steps], trace.quaternion[steps], look, *SIZE, backend)
