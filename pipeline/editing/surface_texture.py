"""What the surface of each body looks like, collected over the frames of a clip as a cube map.

A texel's place is a direction from the body's centre, in units of the half extents; so a box has its six faces. What
was never seen is taken from where the shape's symmetry puts it, and else filled in from around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial import cKDTree

from pipeline.compiled import kernel
from pipeline.editing.camera_rays import gather
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.light import Lights
from pipeline.editing.view import BodyMotion, View
from pipeline.scene.scene import SceneObject, half_extents
from pipeline.vision.rendering.appearance import object_colour
from pipeline.vision.rendering.surface import KINDS, intersect

MEASURED, MIRRORED, INVENTED = range(3)
SIZE = 64  # texels along the side of a face
LEAST_WEIGHT = 1e-3
NEIGHBOURS = 8  # from which a texel is filled in
ERODED_PX = 1  # of a mask, whose rim is mixed with the background
SHADINGS = (0.0, 0.5, 1.0)  # that are tried
MOST_FRAMES = 60  # whose texels are kept
TRIED_SIZE, TRIED_FRAMES = 24, 10  # texels and frames that they are tried with
STILL_BETTER = 0.7  # of the spread of a body that turns: at most so much has one that looks the same all around
#: Reflections along the body's axes, in the order in which they are tried.
MIRRORS = ((-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, -1))


def cube_directions(size: int) -> np.ndarray:
    """(6, S, S, 3) on the cube [-1, 1]³: faces +x, -x, +y, -y, +z, -z; as `camera_rays` finds texels."""
    centres = (np.arange(size) + 0.5) / size * 2 - 1
    out = np.empty((6, size, size, 3))
    for face in range(6):
        axis = face // 2
        col, row = (k for k in range(3) if k != axis)
        out[face, :, :, axis] = 1 - 2 * (face % 2)
        out[face, :, :, col] = centres[None, :]
        out[face, :, :, row] = centres[:, None]
    return out


@kernel
def _on_surface(kind: int, half: np.ndarray, direction: np.ndarray, out: np.ndarray) -> None:
    for m in range(direction.shape[0]):
        x, y, z = direction[m, 0] * half[0], direction[m, 1] * half[1], direction[m, 2] * half[2]
        t = intersect(kind, half[0], half[1], half[2], 0.0, 0.0, 0.0, x, y, z)
        out[m, 0], out[m, 1], out[m, 2] = t * x, t * y, t * z


def surface_points(obj: SceneObject, size: int) -> np.ndarray:
    """(6, S, S, 3) m, the texels of an object in its body frame."""
    directions = cube_directions(size).reshape(-1, 3)
    out = np.empty_like(directions)
    _on_surface(KINDS[obj.shape], half_extents(obj), directions, out)
    return out.reshape(6, size, size, 3)


@dataclass(frozen=True)
class SeenTexels:
    """What K frames show of one body's M texels.

    Attributes:
        frames: (K,), which they are.
        colour: (K, M, 3) float32, in the light of open ground.
        weight: (K, M) float32, the fourth power of the facing cosine; 0 where a texel is not seen.
    """

    frames: np.ndarray
    colour: np.ndarray
    weight: np.ndarray

    def mean(self) -> np.ndarray:
        """(M, 3), the weighted mean of each texel."""
        total = np.einsum("km,kmc->mc", self.weight, self.colour)
        return np.asarray(total / np.maximum(self.weight.sum(0), LEAST_WEIGHT)[:, None])

    def spread(self) -> float:
        """Squared deviation from the means, as a share of their squares: how much the frames contradict each other."""
        squares = float(np.einsum("km,kmc->", self.weight, self.colour**2))
        explained = float((self.mean() ** 2).sum(1) @ self.weight.sum(0))
        return (squares - explained) / max(explained, 1e-9)


@dataclass(frozen=True)
class Textures:
    """The surfaces of N bodies.

    Attributes:
        colour: (N, 6, S, S, 3) float32, 0 to 255, in the light of open ground.
        kind: (N, 6, S, S) uint8: MEASURED, MIRRORED or INVENTED.
        seen: (N,) what single frames show of them.
    """

    colour: np.ndarray
    kind: np.ndarray
    seen: tuple[SeenTexels, ...] = ()


def seen_texels(
    motion: BodyMotion,
    i: int,
    view: View,
    corrections: np.ndarray,
    clip: FilmedClip,
    lights: Lights,
    size: int = SIZE,
    most: int = MOST_FRAMES,
) -> SeenTexels:
    """Collect the texels of body i.

    Args:
        motion: T frames, N bodies.
        i: Which body.
        view: The camera.
        corrections: (T, N, 5).
        clip: T frames.
        lights: By which shading is taken off.
        size: Texels along the side of a face.
        most: So many frames are used, evenly spaced over those in which the body is seen.
    """
    eye, rotation, focal, _ = view.ray_arguments
    square = np.ones((2 * ERODED_PX + 1,) * 2, np.uint8)
    points = surface_points(motion.objects[i], size).reshape(-1, 3)
    seen = np.flatnonzero(motion.shown[:, i] & (clip.masks == i + 1).any((1, 2)))
    frames = seen[np.unique(np.linspace(0, len(seen) - 1, min(most, len(seen))).astype(int))]
    colour = np.zeros((len(frames), len(points), 3), np.float32)
    weight = np.zeros((len(frames), len(points)), np.float32)
    for k, t in enumerate(frames):
        clear = cv2.erode((clip.masks[t] == i + 1).astype(np.uint8), square) > 0
        pose = motion.tables[t], i, points, corrections[t, i]
        light = lights.light, lights.on_bodies
        gather(*pose, eye, rotation, focal, clip.frames[t], clear, *light, colour[k], weight[k])
    return SeenTexels(frames, colour, weight)


def find_textures(
    motion: BodyMotion, view: View, corrections: np.ndarray, clip: FilmedClip, lights: Lights
) -> Textures:
    """The textures of a clip's bodies, of which `motion` has N."""
    count = len(motion.objects)
    colour = np.empty((count, 6, SIZE, SIZE, 3), np.float32)
    kind = np.empty((count, 6, SIZE, SIZE), np.uint8)
    texels = tuple(seen_texels(motion, i, view, corrections, clip, lights) for i in range(count))
    for i, found in enumerate(texels):
        seen = (found.weight.sum(0) > LEAST_WEIGHT).reshape(6, SIZE, SIZE)
        mean = found.mean().reshape(6, SIZE, SIZE, 3)
        colour[i], kind[i] = completed(mean, seen) if seen.any() else plain_texture(object_colour(i))
    return Textures(colour, kind, texels)


def find_gloss(
    motion: BodyMotion, view: View, corrections: np.ndarray, clip: FilmedClip, lights: Lights
) -> tuple[float, tuple[bool, ...]]:
    """How strongly the lights shade the bodies, and which of them look the same however they turn.

    A plain or shiny sphere shows highlights that stay where they are while it turns. Both answers are those with which
    the frames of the clip contradict each other least.
    """
    spreads = np.full((len(SHADINGS), len(motion.objects), 2), np.inf)
    still = unturned(motion, tuple(o.shape == "sphere" for o in motion.objects))
    for s, shading in enumerate(SHADINGS):
        shaded = replace(lights, shading=shading)
        for i, obj in enumerate(motion.objects):
            for k, tried in enumerate((motion, still) if obj.shape == "sphere" else (motion,)):
                found = seen_texels(tried, i, view, corrections, clip, shaded, TRIED_SIZE, TRIED_FRAMES)
                spreads[s, i, k] = found.spread()
    spreads[..., 1] /= STILL_BETTER
    best = int(spreads.min(-1).sum(-1).argmin()) if len(lights.light) else 0
    return SHADINGS[best], tuple(bool(k) for k in spreads[best].argmin(-1))


def unturned(motion: BodyMotion, same: Sequence[bool]) -> BodyMotion:
    """A motion in which the bodies that look the same however they turn do not turn."""
    quaternion = motion.quaternion.copy()
    quaternion[:, np.flatnonzero(same)] = (1.0, 0.0, 0.0, 0.0)
    return replace(motion, quaternion=quaternion)


def completed(colour: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A texture whose texels are all there: mirrored from what was seen, else a smooth mean of what is nearest.

    Args:
        colour: (6, S, S, 3).
        seen: (6, S, S) bool, at least one of them.

    Returns:
        Colours (6, S, S, 3) float32 and kinds (6, S, S) uint8.
    """
    out, known = colour.copy(), seen.copy()
    kind = np.where(seen, MEASURED, INVENTED).astype(np.uint8)
    for signs in MIRRORS:
        source = tuple(_mirrored(values, signs) for values in (colour, seen))
        use = source[1] & ~known
        out[use], kind[use], known[use] = source[0][use], MIRRORED, True
    if not known.all():
        directions = cube_directions(seen.shape[1])
        directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
        apart, nearest = cKDTree(directions[known]).query(directions[~known], k=min(NEIGHBOURS, int(known.sum())))
        apart, nearest = apart.reshape(len(apart), -1), nearest.reshape(len(nearest), -1)
        weight = 1 / (apart + 1e-3) ** 2
        out[~known] = (out[known][nearest] * weight[..., None]).sum(1) / weight.sum(1)[:, None]
    return out.astype(np.float32), kind


def plain_texture(colour: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
    """The texture of a body that was never seen: invented, of one colour (3,), RGB from 0 to 255."""
    everywhere = np.broadcast_to(np.array(colour, np.float32), (6, SIZE, SIZE, 3))
    return everywhere.copy(), np.full((6, SIZE, SIZE), INVENTED, np.uint8)


def _mirrored(values: np.ndarray, signs: tuple[int, ...]) -> np.ndarray:
    """A cube map (6, S, S, ...) reflected along the axes with sign -1."""
    out = np.empty_like(values)
    for face in range(6):
        axis = face // 2
        col, row = (k for k in range(3) if k != axis)
        source = values[face if signs[axis] > 0 else face ^ 1]
        out[face] = source[:: signs[row], :: signs[col]]
    return out
