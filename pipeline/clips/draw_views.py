"""Draw scenes of the kinds of `pipeline.scene.sample_views` until each clip has one that passes the filters.

A clip's random numbers come from its seed, suite and index alone; its kind from its index.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.clips.draw import Drawn, Filters, in_view, initial_area_px, left_to_right
from pipeline.clips.schedule import Schedule
from pipeline.errors import DynamicsError
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.physics.overlap import penetration
from pipeline.scene.sample_views import VIEWS, draw_view_scene
from pipeline.scene.scene import Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.camera import pinhole, project

#: Bodies are smaller here than in the other suites: a ball in flight has 1 % of the picture.
VIEW_FILTERS = Filters(overlap_m=0.0, area_px=1200.0, visible_px=150.0, out_of_view=1, tries=500)
LEAST_SHARE = 0.35  # of the frames in which each object is in view
LEAST_MOTION = 0.15  # of the picture's height, of the object that moves most while it is in view


def view_kind(index: int) -> str:
    """The kind of the clip with this index."""
    kinds = list(VIEWS)
    return kinds[index % len(kinds)]


def draw_view_clips(
    seed: int, suite: str, indices: Sequence[int], schedule: Schedule, filters: Filters = VIEW_FILTERS
) -> Drawn:
    """One accepted scene per clip index, its objects listed from left to right where they first appear.

    Args:
        seed: Of all random numbers.
        suite: Name of the suite, from which random numbers depend too.
        indices: Of the clips; the kinds of views alternate.
        schedule: The frames of a clip.
        filters: Which candidates are accepted.

    Raises:
        DynamicsError: A clip uses up its tries.
    """
    drawn = Drawn([])
    for index in indices:
        rng, kind = clip_rng(seed, suite, index, "sample"), view_kind(index)
        for _ in range(filters.tries):
            drawn.outcome["candidates"] += 1
            scene = draw_view_scene(rng, kind)
            refusal = "too small" if initial_area_px(scene) < filters.area_px else None
            if refusal is None and penetration(scene) > filters.overlap_m:
                refusal = "overlap"
            accepted = None
            if refusal is None:
                accepted, refusal = _simulated(scene, schedule, filters)
            drawn.outcome[refusal or "accepted"] += 1
            if accepted is not None:
                drawn.scenes.append(accepted)
                break
        else:
            raise DynamicsError(f"{suite}/{index} ({kind}): none of {filters.tries} candidates passes the filters")
    return drawn


def _simulated(scene: Scene, schedule: Schedule, filters: Filters) -> tuple[Scene | None, str | None]:
    """The accepted scene, or None and why its motion is refused."""
    assert scene.camera is not None
    batch = stack_scenes([scene])
    simulator = BatchSimulator(batch.shapes, batch.has_ground, 1, 1, batch.fixed_kinds)
    states = simulator.run(batch, schedule.frame_steps)
    if not states.valid[0]:
        return None, "bad numbers"
    position = states.position[0]
    visible = in_view(scene, position, states.quaternion[0], filters.visible_px)  # (F, N)
    if (visible.mean(0) < LEAST_SHARE).any():
        return None, "out of view"
    image, _ = project(position, pinhole(scene.camera), 1, 1)  # in units of the height
    moved = [np.ptp(image[visible[:, i], i], axis=0).max() for i in range(visible.shape[1])]
    if max(moved) < LEAST_MOTION:
        return None, "still"
    return left_to_right(scene, position, visible.argmax(0)), None
