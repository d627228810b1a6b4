"""A scene's replay: the scene is run, and its camera looks at it.

What is costly (masks, depth, flow, events, pictures) is computed when it is first asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.clips.events import DEFAULT_THRESHOLDS, Event, find_events
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import HEIGHT, WIDTH, View, event_areas, pair_view, rendering_of
from pipeline.errors import SimulationError
from pipeline.physics.batch import BatchSimulator, States, stack_scenes
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import frame_steps
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import Rendering
from pipeline.vision.rendering.render import render_rgb


@dataclass(frozen=True)
class Replay:
    """A scene's motion at the frames of a clip, and what the scene's camera sees of it. The scene has a camera.

    Attributes:
        scene: What was run.
        schedule: Which moments are frames, and which of them the model sees.
        position: (F, N, 3), m, of the objects in every frame.
        quaternion: (F, N, 4), w x y z.
        trace: Every step and contact; None after `replay_poses`.
        width: Of masks, depth and flow, px.
        height: Of masks, depth and flow, px.
    """

    scene: Scene
    schedule: Schedule
    position: np.ndarray
    quaternion: np.ndarray
    trace: Trace | None = None
    width: int = WIDTH
    height: int = HEIGHT

    @property
    def masks(self) -> np.ndarray:
        """(F, H, W) uint8 of every frame: 0 background, i + 1 object i."""
        return self._rendering.mask

    @property
    def depth(self) -> np.ndarray:
        """(P, H, W) float32, m, of the frames that the model sees."""
        return self._pairs.depth

    @property
    def flow(self) -> np.ndarray:
        """(P, H, W, 2) float32, px per interval, from each of the frames that the model sees."""
        return self._pairs.flow * self.schedule.pair_scale.astype(np.float32)[:, None, None, None]

    @cached_property
    def frame_flow(self) -> np.ndarray:
        """(F - 1, H, W, 2) float32, px, from every frame to the next."""
        assert self.scene.camera is not None
        return exact_flow(
            self.scene.objects,
            self.position,
            self.quaternion,
            pinhole(self.scene.camera),
            self.width,
            self.height,
            self.scene.ground,
            rendering=self._rendering,
        )

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """What happens, with the default thresholds. Needs the trace."""
        assert self.trace is not None, "contacts are in the trace"
        areas = event_areas(self.scene, self.trace, self.schedule, self.width / self.height)
        steps = self.schedule.frame_steps
        return tuple(find_events(self.trace, self.scene.shapes, areas, steps, DEFAULT_THRESHOLDS))

    def pictures(
        self, backend: str, frames: np.ndarray | None = None, width: int | None = None, height: int | None = None
    ) -> np.ndarray:
        """RGB (F, H, W, 3) uint8 in the plain appearance, whose colours are the same in every output.

        Args:
            backend: "mujoco" or "raycast" (`pipeline.vision.rendering.render_backend.choose_backend`).
            frames: (K,) Which frames; None for all.
            width: px; None for the replay's own.
            height: px; None for the replay's own.

        Raises:
            SceneError: For a mesh that the ray caster cannot show.
        """
        chosen = slice(None) if frames is None else frames
        appearance = plain_appearance(len(self.scene.objects), len(self.scene.fixed))
        return render_rgb(
            self.scene,
            self.position[chosen],
            self.quaternion[chosen],
            appearance,
            width or self.width,
            height or self.height,
            backend,
        )

    @cached_property
    def _rendering(self) -> Rendering:
        return rendering_of(self.scene, self.position, self.quaternion, self.width, self.height)

    @cached_property
    def _pairs(self) -> View:
        pairs = self.schedule.pairs
        return pair_view(self.scene, self.position[pairs], self.quaternion[pairs], self.width, self.height)


def replay(scene: Scene, schedule: Schedule, width: int = WIDTH, height: int = HEIGHT) -> Replay:
    """Run a scene with its effects and keep every step and contact. Raises SimulationError if it becomes unstable."""
    return replay_trace(scene, simulate(scene, schedule.seconds), schedule, width, height)


def replay_trace(scene: Scene, trace: Trace, schedule: Schedule, width: int = WIDTH, height: int = HEIGHT) -> Replay:
    """The replay of a scene that has been run."""
    steps = schedule.frame_steps
    return Replay(
        scene=scene,
        schedule=schedule,
        position=trace.position[steps],
        quaternion=trace.quaternion[steps],
        trace=trace,
        width=width,
        height=height,
    )


def replay_poses(scene: Scene, schedule: Schedule, width: int = WIDTH, height: int = HEIGHT) -> Replay:
    """Run a scene as a search does: by `BatchSimulator`, without effects and contacts; several times as fast.

    MuJoCo gets the numbers of the model directly, not through MJCF, so poses differ from those of `replay` by rounding
    (by up to 1e-6 m after a second of contacts). The scores in reports use this function.

    Raises:
        SimulationError: Where the simulation becomes unstable.
    """
    states = states_at(scene, schedule.frame_steps)
    return Replay(
        scene=scene,
        schedule=schedule,
        position=states.position[0],
        quaternion=states.quaternion[0],
        trace=None,
        width=width,
        height=height,
    )


def masks_at(scene: Scene, times: np.ndarray, width: int, height: int) -> np.ndarray:
    """Masks (T, height, width) uint8 of a scene at times (T,), s, that increase from 0 or later.

    Raises:
        SimulationError: Where the simulation becomes unstable.
    """
    states = states_at(scene, frame_steps(times))
    return rendering_of(scene, states.position[0], states.quaternion[0], width, height).mask


def states_at(scene: Scene, steps: np.ndarray) -> States:
    """The states of a scene without effects, a batch of one, at increasing steps (T,) of 1/240 s.

    Raises:
        SimulationError: Where the simulation becomes unstable.
    """
    batch = stack_scenes([scene])
    simulator = BatchSimulator(scene.shapes, batch.has_ground, 1, 1, batch.fixed_kinds)
    states = simulator.run(batch, steps)
    if not states.valid[0]:
        raise SimulationError("the simulation became unstable in the replay (non-finite state, or a reset by MuJoCo)")
    return states
