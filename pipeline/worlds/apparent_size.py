"""Sizes with which bodies cover as much of the picture as their masks do.

A body's outline is wider than its section in the plane of motion: its near side is larger, and away from the middle of
the picture one of its sides shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.worlds.plane import Plane

FRAMES = 6  # looked at
LEAST_FACTOR = 0.75  # a smaller one is not explained by perspective
SAME = 0.005


def with_apparent_sizes(
    scene: Scene, tracks: Sequence[ImageTrack], flat: Sequence[ImageTrack], plane: Plane, which: Sequence[bool]
) -> Scene:
    """The scene with sizes of bodies times factors, so that their areas are those of their tracks.

    Args:
        scene: Object i is the body of track i.
        tracks: In the picture of the scene's camera.
        flat: In the picture of the plane.
        plane: In which bodies move.
        which: Of each body, whether its size may change.
    """
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    objects = list(scene.objects)
    for i, (track, straight) in enumerate(zip(tracks, flat, strict=True)):
        whole = np.flatnonzero(track.whole)
        if not which[i] or not len(whole):
            continue
        some = whole[np.linspace(0, len(whole) - 1, min(len(whole), FRAMES)).round().astype(int)]
        body = objects[i]
        off = float(plane.height_of(np.array(body.position)))
        place = plane.in_space(plane.to_world(straight.centre[some]), off)
        turn = np.repeat(np.array(body.orientation)[None, None], len(some), axis=0)
        shown = rasterise((body,), place[:, None], turn, camera, plane.width, plane.height, None, ())
        areas = (shown.mask > 0).sum((1, 2))
        factor = float(np.median(np.sqrt(track.area[some] / np.maximum(areas, 1))))
        if LEAST_FACTOR < factor < 1 / LEAST_FACTOR and abs(factor - 1) > SAME:
            size, position = tuple(factor * s for s in body.size), np.array(body.position)
            if plane.level:
                position[2] *= factor
            objects[i] = replace(body, size=size, position=tuple(position))
    return replace(scene, objects=tuple(objects))
