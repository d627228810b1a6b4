"""Draw scenes until each clip has one that passes the filters.

A clip's random numbers come from its seed, suite and index alone, so that clip 17 of a suite is the
same whatever the shard size, the number of workers or the order of work.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import areas_px, rendering_of
from pipeline.errors import DynamicsError
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.physics.overlap import penetration
from pipeline.scene.sample import Distribution, draw_composition, draw_scene
from pipeline.scene.scene import Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.camera import pinhole, project

_WIDTH, _HEIGHT = 120, 80  # the filters look at small masks: areas are stated for 480x320, 16 times as many pixels


@dataclass(frozen=True)
class Filters:
    """overlap_m: largest overlap in the initial state. area_px: least area of all objects together in the first
    frame, px of 480x320. visible_px: an object smaller than this is out of view. out_of_view: how many objects may
    be out of view for the whole clip. tries: candidates a clip may use up."""

    overlap_m: float
    area_px: float
    visible_px: float
    out_of_view: int
    tries: int


@dataclass
class Drawn:
    """Accepted scenes, in the order of the indices asked for; how many candidates there were and what became of
    them, by filter; and the names of candidates whose simulation became unstable."""

    scenes: list[Scene]
    outcome: Counter[str] = field(default_factory=Counter)
    bad: list[str] = field(default_factory=list)


def draw_clips(
    seed: int,
    suite: str,
    indices: Sequence[int],
    distribution: Distribution,
    filters: Filters,
    schedule: Schedule,
    counts: Mapping[int, float],
    only: Sequence[str] = (),
    without: Sequence[str] = (),
) -> Drawn:
    """One accepted scene per clip index, its objects listed from left to right where they first appear.

    counts, only, without: as `draw_composition`. Raises `DynamicsError` where a clip uses up its tries.
    """
    rngs = {i: clip_rng(seed, suite, i, "sample") for i in indices}
    shapes = {i: draw_composition(rngs[i], counts, only, without) for i in indices}
    tries: Counter[int] = Counter()
    drawn = Drawn([])
    accepted: dict[int, Scene] = {}
    pending = list(indices)
    while pending:
        groups: dict[tuple[str, ...], list[tuple[int, Scene]]] = {}
        for index in pending:
            scene = _draw_still(rngs[index], shapes[index], distribution, filters, drawn.outcome, tries, index, suite)
            groups.setdefault(shapes[index], []).append((index, scene))
        for group, members in groups.items():
            batch = stack_scenes([scene for _, scene in members])
            states = BatchSimulator(group, True, len(members), 1).run(batch, schedule.frame_steps[schedule.pairs[:, 0]])
            for row, (index, scene) in enumerate(members):
                if not states.valid[row]:
                    drawn.outcome["bad numbers"] += 1
                    drawn.bad.append(f"{suite}/{index} candidate {tries[index]}")
                    continue
                seen = first_seen(scene, states.position[row], states.quaternion[row], filters)
                if np.count_nonzero(seen < 0) > filters.out_of_view:
                    drawn.outcome["out of view"] += 1
                    continue
                drawn.outcome["accepted"] += 1
                accepted[index] = left_to_right(scene, states.position[row], seen)
        pending = [i for i in pending if i not in accepted]
    drawn.scenes = [accepted[i] for i in indices]
    return drawn


def _draw_still(
    rng: np.random.Generator,
    shapes: tuple[str, ...],
    distribution: Distribution,
    filters: Filters,
    outcome: Counter[str],
    tries: Counter[int],
    index: int,
    suite: str,
) -> Scene:
    """The next candidate that passes the filters on its initial state."""
    while tries[index] < filters.tries:
        tries[index] += 1
        outcome["candidates"] += 1
        scene = draw_scene(rng, shapes, distribution)
        if initial_area_px(scene) < filters.area_px:
            outcome["too small"] += 1
        elif penetration(scene) > filters.overlap_m:
            outcome["overlap"] += 1
        else:
            return scene
    raise DynamicsError(
        f"{suite}/{index} ({'+'.join(shapes)}): none of {filters.tries} candidates passes the filters "
        f"(so far: {dict(outcome)}); widen sample.distribution or loosen sample.filters"
    )


def initial_area_px(scene: Scene) -> float:
    """Area of all objects together in the initial state, px of 480x320."""
    position = np.array([[o.position for o in scene.objects]])
    quaternion = np.array([[o.orientation for o in scene.objects]])
    return float(areas_px(rendering_of(scene, position, quaternion, _WIDTH, _HEIGHT).mask, len(scene.objects)).sum())


def first_seen(scene: Scene, position: np.ndarray, quaternion: np.ndarray, filters: Filters) -> np.ndarray:
    """(N,) the first of the frames in which each object is in view, -1 for never."""
    visible = in_view(scene, position, quaternion, filters.visible_px)
    return np.where(visible.any(0), visible.argmax(0), -1)


def in_view(scene: Scene, position: np.ndarray, quaternion: np.ndarray, visible_px: float) -> np.ndarray:
    """(F, N) whether each object is in view, from poses (F, N, 3) m and (F, N, 4) in F frames.

    visible_px: area from which an object is in view, px of 480x320.
    """
    return areas_px(rendering_of(scene, position, quaternion, _WIDTH, _HEIGHT).mask, len(scene.objects)) >= visible_px


def left_to_right(scene: Scene, position: np.ndarray, seen: np.ndarray) -> Scene:
    """The scene with its objects in the order of their image x where they first appear; unseen ones last."""
    assert scene.camera is not None
    centre = np.array([position[max(f, 0), i] for i, f in enumerate(seen)])
    x = project(centre, pinhole(scene.camera), _WIDTH, _HEIGHT)[0][:, 0]
    order = np.lexsort([x, seen < 0])
    return replace(scene, objects=tuple(replace(scene.objects[i], name="") for i in order))
