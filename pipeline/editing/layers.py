"""A clip taken apart: its plate, lights, textures, and where it shows each body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.light import NO_LIGHTS, Lights, find_lights, ground_light
from pipeline.editing.plate import Plate, find_plate, grown
from pipeline.editing.registration import register
from pipeline.editing.surface_texture import Textures, find_textures
from pipeline.editing.view import BodyMotion, View


@dataclass(frozen=True)
class Layers:
    """What a clip of T frames and N bodies is made of.

    Attributes:
        view: Its camera.
        motion: Its bodies, as the scene says.
        corrections: (T, N, 5), where the clip shows them against that.
        registered: (T, N) bool, where that was measured.
        plate: Its background.
        lights: Its lights.
        textures: Its bodies' surfaces.
    """

    view: View
    motion: BodyMotion
    corrections: np.ndarray
    registered: np.ndarray
    plate: Plate
    lights: Lights
    textures: Textures


def take_apart(clip: FilmedClip, motion: BodyMotion, view: View) -> Layers:
    """The layers of a clip whose bodies move as `motion` says, (T, N)."""
    corrections, registered = register(motion, view, clip.masks)
    covered = grown(clip.masks)
    open_ground = np.ones(clip.masks.shape, np.float32)
    plate = find_plate(clip.frames, covered, open_ground)
    lights = find_lights(motion, view, corrections, clip.frames, clip.masks, plate.colour)
    if lights is not NO_LIGHTS:
        ratio = [ground_light(motion, view, corrections, t, lights) for t in range(len(clip.frames))]
        plate = find_plate(clip.frames, covered, np.stack(ratio).astype(np.float32))
    textures = find_textures(motion, view, corrections, clip.frames, clip.masks, lights)
    return Layers(view, motion, corrections, registered, plate, lights, textures)
