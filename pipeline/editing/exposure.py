"""How sharp a clip shows its bodies: the blur of all edges, and that of moving bodies while the shutter is open.

Textures come from the clip, so they have its blur already. Only edges are blurred anew, and bodies that are made faster
than they were filmed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.editing.drawing import Drawn, draw
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.in_threads import in_threads
from pipeline.editing.light import LEAST_GAIN, Lights, ground_light
from pipeline.editing.plate import grown
from pipeline.editing.surface_texture import Textures
from pipeline.editing.view import BodyMotion, View

BLURS = (0.0, 0.35, 0.5, 0.7, 0.9, 1.2, 1.6)  # px, standard deviations that are tried
SHUTTERS = (0.0, 0.25, 0.5, 0.75, 1.0)  # shares of the time between two frames that are tried
FRAMES = 4  # that they are tried in
LEAST_PATH_PX = 4.0  # from one frame to the next: of the bodies that show whether there is a shutter
PATH_PX = 16  # the same, of the frames that are taken first
RIM_PX = 2  # about the bodies' edges, where pictures are compared
STEP_PX, MOST_PLACES = 2.0, 9  # between the places at which a body is drawn while the shutter is open; how many
FASTER_PX = 1.0  # a body whose path while the shutter is open is that much longer than the filmed one is blurred inside


@dataclass(frozen=True)
class Exposure:
    """How sharp bodies are.

    Attributes:
        blur: Of edges, px: the standard deviation of a Gaussian.
        shutter: For how much of the time between two frames the shutter is open, 0 to 1; 0 where nothing moves fast
            enough to tell.
    """

    blur: float
    shutter: float


def paths_px(corrections: np.ndarray) -> np.ndarray:
    """(T, N, 2) px by which bodies move in the picture from frame to frame, of their corrections (T, N, 5).

    It is the shorter of the ways before and after a frame: an edit may put a body elsewhere.
    """
    ways = np.diff(corrections[..., :2] + corrections[..., 2:4], axis=0)
    before, after = np.concatenate([ways[:1], ways]), np.concatenate([ways, ways[-1:]])
    shorter = np.linalg.norm(before, axis=-1) < np.linalg.norm(after, axis=-1)
    return np.where(shorter[..., None], before, after)


def made_faster(paths: np.ndarray, filmed: np.ndarray, origin: Sequence[int | None]) -> np.ndarray:
    """(T, M) bool: bodies whose paths (T, M, 2) px are longer than those that were filmed, and that show in textures.

    filmed: (T, N, 2) px. origin: (M,) which body of the clip each is; None for a new one.
    """
    longer = np.linalg.norm(paths, axis=-1)
    for m, o in enumerate(origin):
        if o is not None:
            longer[:, m] -= np.linalg.norm(filmed[:, o], axis=-1)
    return np.asarray(longer > FASTER_PX)


def draw_exposed(
    draw_at: Callable[[np.ndarray], Drawn],
    corrections: np.ndarray,
    shown: np.ndarray,
    *,
    paths: np.ndarray,
    faster: np.ndarray,
) -> Drawn:
    """Draw M bodies while the shutter is open: the mean of their pictures along their paths.

    Args:
        draw_at: Draws the bodies with other corrections (M, 5).
        corrections: (M, 5), in the middle of the exposure.
        shown: (M,) bool.
        paths: (M, 2) px, along which they move in the picture while the shutter is open.
        faster: (M,) bool, those whose textures are blurred along the path, too, and not only their edges.
    """
    longest = float(np.linalg.norm(paths[shown], axis=-1).max(initial=0.0))
    count = min(2 * math.ceil(longest / 2 / STEP_PX) + 1, MOST_PLACES) if longest >= 1 else 1
    places = []
    for at in (np.arange(count) + 0.5) / count - 0.5:
        moved = corrections.copy()
        moved[:, 2:4] += at * paths
        places.append(draw_at(moved))
    return _mean(places, faster)


def _mean(places: Sequence[Drawn], faster: np.ndarray) -> Drawn:
    """The mean of pictures of bodies at an odd number of places along their paths; `faster` as in `draw_exposed`."""
    middle = places[len(places) // 2]
    if len(places) == 1:
        return middle
    alpha = np.mean([one.alpha for one in places], axis=0)
    colour = np.mean([one.colour for one in places], axis=0)
    sharp = (middle.alpha > 0) & ~np.append(faster, True)[np.minimum(middle.front, len(faster))]
    inside = middle.colour / np.maximum(middle.alpha, 1e-6)[..., None] * alpha[..., None]
    cover = np.any([one.cover for one in places], axis=0)
    return replace(middle, colour=np.where(sharp[..., None], inside, colour), alpha=alpha, cover=cover)


def blurred(drawn: Drawn, sigma: float) -> tuple[np.ndarray, np.ndarray]:
    """Colour (H, W, 3) and alpha (H, W) with edges blurred by `sigma` px."""
    alpha, colour = drawn.alpha, drawn.colour / np.maximum(drawn.alpha, 1e-6)[..., None]
    if sigma == 0:
        return colour, alpha
    soft = cv2.GaussianBlur(alpha, (0, 0), sigma)
    spread = cv2.GaussianBlur(drawn.colour, (0, 0), sigma) / np.maximum(soft, 1e-6)[..., None]
    return np.where(alpha[..., None] > 0, colour, spread), soft


def find_exposure(
    clip: FilmedClip,
    view: View,
    motion: BodyMotion,
    corrections: np.ndarray,
    plate: np.ndarray,
    textures: Textures,
    lights: Lights,
) -> Exposure:
    """The exposure with which a clip that is drawn anew is nearest to what was filmed, at the bodies' edges.

    The shutter is found first, with frames in which bodies move fast, and at the edges of these bodies only.

    Args:
        clip: T frames.
        view: The camera.
        motion: Its N bodies.
        corrections: (T, N, 5).
        plate: (H, W, 3) float32.
        textures: Of the bodies.
        lights: The lights.
    """
    rectangles, paths, count = motion.rectangles(view), paths_px(corrections), len(motion.objects)
    seen = motion.shown & np.stack([(clip.masks == i + 1).any((1, 2)) for i in range(count)], axis=1)
    lengths = np.where(seen, np.linalg.norm(paths, axis=-1), 0.0)

    def errors(t: int, rims: np.ndarray, shutters: Sequence[float]) -> np.ndarray:
        """(S, B) squared error of one frame at the rims of some bodies, (N,) bool, with each shutter and blur."""
        behind = plate * ground_light(motion, view, corrections, t, lights).astype(np.float32)[..., None]
        reach = RIM_PX + min(math.ceil(lengths[t][rims].max(initial=0.0) / 2), PATH_PX)
        body = np.isin(clip.masks[t], np.flatnonzero(rims) + 1)[None]
        rim = (grown(body, reach) & grown(~body, reach))[0]
        out = np.zeros((len(shutters), len(BLURS)))
        if not rim.any():
            return out
        box = tuple(slice(int(k.min()), int(k.max()) + 1) for k in np.nonzero(rim))
        true, where = clip.frames[t][box].astype(np.float32), rim[box]
        shown, still = motion.shown[t], np.zeros(count, bool)

        def draw_at(moved: np.ndarray) -> Drawn:
            return draw(view, motion.tables[t], moved, rectangles[t], shown, textures, lights)

        for j, shutter in enumerate(shutters):
            drawn = draw_exposed(draw_at, corrections[t], shown, paths=shutter * paths[t], faster=still)
            cut = replace(drawn, colour=drawn.colour[box], alpha=drawn.alpha[box])
            for k, sigma in enumerate(BLURS):
                colour, alpha = blurred(cut, sigma)
                made = behind[box] + alpha[..., None] * (colour - behind[box])
                out[j, k] = float(((made - true)[where] ** 2).sum())
        return out

    def total(frames: Sequence[int], rims: np.ndarray, shutters: Sequence[float]) -> np.ndarray:
        """(S, B), the sum of `errors` over some frames. rims: (T, N) bool."""
        return np.asarray(np.sum(in_threads(lambda t: errors(t, rims[t], shutters), frames), axis=0))

    shutter = 0.0
    longest = lengths.max(1, initial=0.0)
    moving = [int(t) for t in np.argsort(np.abs(longest - PATH_PX), kind="stable") if longest[t] >= LEAST_PATH_PX]
    if moving:
        tried = total(moving[:FRAMES], lengths >= LEAST_PATH_PX, SHUTTERS).min(-1)
        best = int(tried.argmin())
        shutter = SHUTTERS[best] if tried[best] < (1 - LEAST_GAIN) * tried[0] else 0.0
    evenly = [int(t) for t in np.unique(np.linspace(0, len(clip.frames) - 1, FRAMES))]
    blur = total(evenly, np.ones_like(seen), [shutter])[0].argmin()
    return Exposure(BLURS[int(blur)], shutter)
