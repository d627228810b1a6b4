"""A clip taken apart: its plate, lights, textures, and where it shows each body."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.editing.exposure import Exposure, find_exposure
from pipeline.editing.filmed_clip import FilmedClip
from pipeline.editing.light import NO_LIGHTS, Lights, find_lights, ground_lights
from pipeline.editing.plate import Plate, find_plate, grown
from pipeline.editing.registration import register
from pipeline.editing.surface_texture import Textures, find_gloss, find_textures, unturned
from pipeline.editing.view import BodyMotion, View

ROUNDS = 2  # of lights and plate: shadows that hardly move are in the first plate


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
        same_all_around: (N,) which of them look the same however they turn: the texture does not turn with them.
        exposure: How sharp it shows them.
    """

    view: View
    motion: BodyMotion
    corrections: np.ndarray
    registered: np.ndarray
    plate: Plate
    lights: Lights
    textures: Textures
    same_all_around: tuple[bool, ...]
    exposure: Exposure

    @cached_property
    def drawn(self) -> BodyMotion:
        """The motion with which the textures turn."""
        return unturned(self.motion, self.same_all_around)


def take_apart(clip: FilmedClip, motion: BodyMotion, view: View) -> Layers:
    """The layers of a clip whose bodies move as `motion` says, (T, N)."""
    corrections, registered = register(motion, view, clip.masks)
    covered, lights = grown(clip.masks), NO_LIGHTS
    plate = find_plate(clip.frames, covered, np.ones(clip.masks.shape, np.float32))
    for _ in range(ROUNDS):
        lights = find_lights(motion, view, corrections, clip.frames, clip.masks, plate.colour)
        if not len(lights.light):
            break
        plate = find_plate(clip.frames, covered, ground_lights(motion, view, corrections, lights))
    shading, same = find_gloss(motion, view, corrections, clip, lights)
    lights, drawn = replace(lights, shading=shading), unturned(motion, same)
    textures = find_textures(drawn, view, corrections, clip, lights)
    exposure = find_exposure(clip, view, drawn, corrections, plate.colour, textures, lights)
    return Layers(view, motion, corrections, registered, plate, lights, textures, same, exposure)
