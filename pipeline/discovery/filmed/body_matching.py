"""Which body of each clip is which object of the known scene: by name, by apparent size, or by order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.discovery.filmed.recorded_clip import RecordedClip, way_px, with_one_body
from pipeline.errors import MeasurementError
from pipeline.scene.scene import SceneObject, half_extents

SAME_SIZE = 0.12  # difference of the logarithms of two sizes below which an outline does not tell them apart
ROUND = 1.2  # ratio of an outline's axes from which it is not that of a ball
NOT_ROUND = 0.5  # what such an outline costs, in units of the logarithm of a size
LEAST_WAY = 0.5  # radii that a body must move to count as moving
LEAST_WAY_ALONE = 0.15  # the same where the scene has one object: no other body has to be told from it


@dataclass(frozen=True)
class Matching:
    """clips: with the masks of what was matched; tracks: for each clip, by name of the object; how: a sentence."""

    clips: tuple[RecordedClip, ...]
    tracks: tuple[Mapping[str, ImageTrack], ...]
    how: str


def match_bodies(clips: Sequence[RecordedClip], objects: Sequence[SceneObject]) -> Matching:
    """Match the bodies of clips to the objects of a scene.

    Args:
        clips: Of one camera.
        objects: Of the known scene.

    Of one object, clips in which nothing moves are left out.

    Raises:
        MeasurementError: A clip has fewer bodies than its match needs, or bodies that nothing tells apart.
    """
    names = [o.name for o in objects]
    if all(clip.names and set(clip.names) <= set(names) for clip in clips):
        tracks = tuple({clip.names[t.body - 1]: t for t in clip.tracks if t.body <= len(clip.names)} for clip in clips)
        return Matching(tuple(clips), tracks, "bodies were matched by their names")
    least_way = LEAST_WAY_ALONE if len(objects) == 1 else LEAST_WAY
    still = [clip.name for clip in clips if not _moving(clip, least_way)]
    if still and (len(objects) > 1 or len(still) == len(clips)):
        raise MeasurementError(f"clip {still[0]}: no body moves")
    clips = [clip for clip in clips if clip.name not in still]
    moving = [_moving(clip, least_way) for clip in clips]
    if len(objects) == 1:
        extra = sum(len(found) > 1 for found in moving)
        note = f"; in {extra} of {len(clips)} clips something else moves, too, and is left out" if extra else ""
        note += f"; clips in which no body moves are left out: {', '.join(still)}" if still else ""
        clips = with_one_body(clips)
        tracks = tuple({names[0]: max(clip.tracks, key=len)} for clip in clips)
        return Matching(tuple(clips), tracks, f"the scene has one object: it is the body of the usual size{note}")
    for clip, found in zip(clips, moving, strict=True):
        if len(found) < len(objects):
            raise MeasurementError(
                f"clip {clip.name}: {len(found)} moving bodies for the {len(objects)} objects of the scene "
                f"({', '.join(names)}); valid: clips that show all of them"
            )
    sizes = np.log([apparent_radius(o) for o in objects])
    shapes = [o.shape for o in objects]
    alike = any(
        abs(sizes[i] - sizes[j]) < SAME_SIZE and shapes[i] == shapes[j] for i, j in combinations(range(len(objects)), 2)
    )
    if alike:
        for clip, found in zip(clips, moving, strict=True):
            if len(found) > len(objects):
                raise MeasurementError(
                    f"clip {clip.name}: {len(found)} moving bodies for {len(objects)} objects, some of one size: "
                    "nothing tells which is which; valid: as many bodies as objects, or objects of different sizes"
                )
        tracks = tuple(dict(zip(names, found, strict=True)) for found in moving)
        return Matching(
            tuple(clips), tracks, "objects of one size: bodies were matched in the order of their appearance"
        )
    return Matching(
        tuple(clips),
        tuple(_by_size(found, objects, sizes) for found in moving),
        "bodies were matched by shape and size",
    )


def _moving(clip: RecordedClip, least_way: float) -> list[ImageTrack]:
    """The bodies that move by more than so many of their radii."""
    return [t for t in clip.tracks if way_px(t) > least_way * t.radius]


def _by_size(found: Sequence[ImageTrack], objects: Sequence[SceneObject], sizes: np.ndarray) -> dict[str, ImageTrack]:
    """The assignment of the least cost, whatever the picture's scale."""
    seen = np.log([t.radius for t in found])
    elongated = [float(np.median(t.axes[:, 0] / np.maximum(t.axes[:, 1], 1e-6))) > ROUND for t in found]
    wrong = NOT_ROUND * np.array([[o.shape == "sphere" and e for e in elongated] for o in objects])
    best: tuple[float, np.ndarray] | None = None
    for scale in (s - o for s in seen for o in sizes):
        cost = np.abs(seen[None] - sizes[:, None] - scale) + wrong
        rows, columns = linear_sum_assignment(cost)
        total = float(cost[rows, columns].sum())
        if best is None or total < best[0]:
            best = total, columns
    assert best is not None
    return {o.name: found[int(j)] for o, j in zip(objects, best[1], strict=True)}


def apparent_radius(obj: SceneObject) -> float:
    """m: radius of the disc whose area is the mean of the body's outlines over all directions (Cauchy's formula)."""
    a, b, c = half_extents(obj)
    if obj.shape == "sphere":
        return float(a)
    if obj.shape == "cylinder":
        return float(np.sqrt((2 * a * a + 4 * a * c) / 4))
    return float(np.sqrt(8 * (a * b + b * c + c * a) / 4 / np.pi))
