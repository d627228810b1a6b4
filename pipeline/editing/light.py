"""The lights of a clip, from the shadows that its bodies cast on the ground."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from pipeline.editing.camera_rays import cast_shadow
from pipeline.editing.in_threads import in_threads
from pipeline.editing.plate import grown
from pipeline.editing.view import BodyMotion, View
from pipeline.vision.rendering.shading_tables import DISC

MOST_LIGHTS = 2
AZIMUTHS, ELEVATIONS_DEG = 20, (20, 32, 44, 56, 68, 80)
RADII = (0.0, 0.06, 0.15, 0.35)  # of a light's disc at a distance of 1: sharp to soft shadows
FRAMES = 6  # that are compared
COLUMNS = 120  # of the pixels that are compared
LEAST_GAIN = 0.1  # share of what is left of a squared error that a light, or an open shutter, has to explain
SOFTEN = 0.05  # standard deviation of a blur of shadows, as a share of the picture's width and of the light's radius
LEAST_DARKNESS = 0.04
DARKEST = 0.9
ROUNDS = 3  # of the refinement, which halves its steps each time


@dataclass(frozen=True)
class Lights:
    """Directional lights.

    Attributes:
        light: (L, 8), as in `pipeline.vision.rendering.shading_tables`.
        darkness: (L,) the share of the light on open ground that is each light's: how dark its shadow is.
        shading: How much of that shows on the bodies: 1 for matt ones, 0 for bodies that look the same all around.
    """

    light: np.ndarray
    darkness: np.ndarray
    shading: float = 1.0

    @property
    def on_bodies(self) -> np.ndarray:
        """(L,) `darkness` on the bodies."""
        return self.shading * self.darkness


NO_LIGHTS = Lights(np.zeros((0, 8)), np.zeros(0))


def light_table(azimuth: float, elevation: float, radius: float) -> np.ndarray:
    """(8,) of a directional light. azimuth, elevation: rad. radius: of its disc at a distance of 1."""
    towards = np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)
    return np.array([*towards, 1.0, 1.0, 1.0, radius, 0.0])


def visible_shares(
    motion: BodyMotion, view: View, corrections: np.ndarray, frame: int, light: np.ndarray, step: int
) -> np.ndarray:
    """(L, H / step, W / step) share of each light that the bodies leave on what does not move, in one frame."""
    out = np.ones((len(light), view.height // step, view.width // step))
    for i in np.flatnonzero(motion.shown[frame]):
        body = motion.tables[frame, i : i + 1]
        cast_shadow(body, corrections[frame, i], *view.ray_arguments, light, step, out)
    for visible, softness in zip(out, SOFTEN * light[:, DISC] * out.shape[2], strict=True):
        if softness > 0:  # the few rays towards a disc leave steps
            visible[:] = cv2.GaussianBlur(visible, (0, 0), softness)
    return out


def ground_light(motion: BodyMotion, view: View, corrections: np.ndarray, frame: int, lights: Lights) -> np.ndarray:
    """(H, W) light on what does not move, as a share of that without bodies, in one frame."""
    visible = visible_shares(motion, view, corrections, frame, lights.light, 1)
    return 1 - np.tensordot(lights.darkness, 1 - visible, axes=1)


def ground_lights(motion: BodyMotion, view: View, corrections: np.ndarray, lights: Lights) -> np.ndarray:
    """(T, H, W) float32, `ground_light` of every frame."""

    def one(t: int) -> np.ndarray:
        return ground_light(motion, view, corrections, t, lights).astype(np.float32)

    return np.stack(in_threads(one, range(len(corrections))))


def find_lights(
    motion: BodyMotion, view: View, corrections: np.ndarray, frames: np.ndarray, masks: np.ndarray, plate: np.ndarray
) -> Lights:
    """The lights whose shadows explain where a clip is darker than its plate.

    Args:
        motion: T frames, N bodies.
        view: The camera.
        corrections: (T, N, 5).
        frames: (T, H, W, 3) uint8.
        masks: (T, H, W) uint8.
        plate: (H, W, 3) float32.

    Returns:
        Up to `MOST_LIGHTS`; none where shadows of no light explain enough.
    """
    chosen = np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))
    step = max(1, view.width // COLUMNS)
    height, width = view.height // step, view.width // step
    at = np.ix_((np.arange(height) * step + step // 2), (np.arange(width) * step + step // 2))
    bright = plate.mean(-1)[at]
    missing, weight = [], []
    for t in chosen:
        missing.append(1 - (frames[t].astype(np.float32).mean(-1)[at] + 1) / (bright + 1))
        weight.append(~grown(masks[t : t + 1])[0][at] & (view.inverse_depth[at] > 0) & (bright > 20))
    rest, use = np.stack(missing), np.stack(weight)
    rest = np.where(use, np.clip(rest, -0.5, 1), 0.0)
    found = NO_LIGHTS

    def shadows(parameters: np.ndarray) -> np.ndarray:
        """(L, K, H, W) share of each light that is hidden, of lights (L, 3)."""
        light = np.stack([light_table(*p) for p in parameters])
        hidden = in_threads(lambda t: 1 - visible_shares(motion, view, corrections, t, light, step), chosen)
        return np.stack(hidden, axis=1) * use

    def gains(parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How much of the squared darkening each light explains, and its darkness."""
        hidden = shadows(parameters)
        energy = np.maximum((hidden**2).sum((1, 2, 3)), 1e-9)
        darkness = np.clip((hidden * rest).sum((1, 2, 3)) / energy, 0, DARKEST)
        return (2 * darkness * (hidden * rest).sum((1, 2, 3)) - darkness**2 * energy), darkness

    grid = np.array(
        [(a, np.radians(e), RADII[1]) for a in np.arange(AZIMUTHS) * 2 * np.pi / AZIMUTHS for e in ELEVATIONS_DEG]
    )
    for _ in range(MOST_LIGHTS):
        gain, _ = gains(grid)
        best = grid[gain.argmax()]
        turn = np.array([np.pi / AZIMUTHS, np.radians(6)])
        for _ in range(ROUNDS):
            moves = [(i * turn[0], j * turn[1], 0) for i in (-1, 0, 1) for j in (-1, 0, 1)]
            tried = best + np.array(moves)
            tried[:, 1] = np.clip(tried[:, 1], np.radians(10), np.radians(89))
            best = tried[gains(tried)[0].argmax()]
            turn /= 2
        tried = np.stack([[best[0], best[1], r] for r in RADII])
        gain, darkness = gains(tried)
        k = int(gain.argmax())
        if gain[k] <= LEAST_GAIN * (np.maximum(rest, 0) ** 2).sum() or darkness[k] < LEAST_DARKNESS:
            break
        room = DARKEST - found.darkness.sum()
        dark = min(float(darkness[k]), room)
        rest = rest - dark * shadows(tried[k : k + 1])[0]
        light = np.concatenate([found.light, light_table(*tried[k])[None]])
        found = Lights(light, np.append(found.darkness, dark))
        if room - dark < LEAST_DARKNESS:
            break
    return found
