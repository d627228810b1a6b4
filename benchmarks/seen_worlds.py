"""Filmed worlds with the masks that the pipeline finds in them, kept in files, so that a changed discovery can be
measured again without rendering and without the network for masks."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.bodies.found_bodies import find_in_clip
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import mask_networks
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.errors import VideoError
from pipeline.hidden.filmed_world import FPS, NOTHING, SCENARIOS, SIZE, FilmedClip, FilmedWorld, make_filmed_world
from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.video import Clip

SHOWN_IN = {
    "drag": {"bounce": "air_drag", "puck": "linear_drag"},
    "tilted_gravity": {"roll": "tilted_gravity", "puck": "tilted_gravity"},
    "moving_ground": {"puck": "moving_ground"},
    "rolling_resistance": {"roll": "rolling_resistance"},
    "restitution": {"bounce": "restitution"},
    NOTHING: dict.fromkeys(SCENARIOS, NOTHING),
}
"""Where a camera can see an effect: for each scenario of a filmed world the effect by its own name."""
VISIBLE_EFFECTS = tuple(name for name in SHOWN_IN if name != NOTHING)


@dataclass(frozen=True)
class SeenWorld:
    """What a discovery from video gets, and the truth.

    Attributes:
        clips: Of one camera, with masks.
        known: Content of the scene file.
        truth: Of the world; only the judge may see it.
        position: (C, T, 3) m, the true path of the body in each clip; only for looking at errors.
    """

    clips: tuple[RecordedClip, ...]
    known: dict[str, Any]
    truth: dict[str, Any]
    position: np.ndarray


def drawn_world(name: str, strength: float, clips: int, rng: np.random.Generator) -> FilmedWorld:
    """A world of an effect of SHOWN_IN, in one of its scenarios; other arguments as of `make_filmed_world`."""
    shown_in = SHOWN_IN[name]
    scenario = str(rng.choice(list(shown_in)))
    return make_filmed_world(shown_in[scenario], scenario, strength, clips, rng)


def see_world(name: str, strength: float, clips: int, rng: np.random.Generator) -> SeenWorld:
    """Film the world of an effect and find its bodies; clips in which none is found are left out, as users would.

    Args:
        name: Of the effect, of SHOWN_IN.
        strength: In detection limits.
        clips: How many.
        rng: Draws everything.

    Raises:
        VideoError: If no body is found in any clip.
    """
    world = drawn_world(name, strength, clips, rng)
    filmed = world.clips(rng, "raycast")
    seen, faults = [], []
    for number, clip in enumerate(filmed):
        try:
            seen.append((number, _with_masks(clip)))
        except VideoError as error:
            faults.append(f"{clip.name}: {error}")
    if not seen:
        raise VideoError("; ".join(faults))
    truth = np.array([filmed[number].truth[0].position for number, _ in seen])
    return SeenWorld(tuple(clip for _, clip in seen), world.known, world.truth, truth)


def kept_world(path: Path, name: str, strength: float, clips: int, seed: list[int]) -> SeenWorld:
    """The world in a file, which is written first if it is missing; arguments as for `see_world`, with the seed."""
    if not path.exists():
        _write(path, see_world(name, strength, clips, np.random.default_rng(seed)))
    with np.load(path) as kept:
        told = json.loads(str(kept["told"]))
        shown = zip(told["names"], kept["frames"], kept["masks"], kept["times"], strict=True)
        seen = tuple(RecordedClip(*clip) for clip in shown)
        return SeenWorld(seen, told["known"], told["truth"], kept["position"])


def _write(path: Path, world: SeenWorld) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    passing = path.with_suffix(".part.npz")
    told = {"names": [c.name for c in world.clips], "known": world.known, "truth": world.truth}
    arrays = {name: np.stack([getattr(c, name) for c in world.clips]) for name in ("frames", "masks", "times")}
    np.savez(passing, told=np.array(json.dumps(told)), position=world.position, **arrays)
    os.replace(passing, path)


def _with_masks(clip: FilmedClip) -> RecordedClip:
    whole = letterbox_for(SIZE, SIZE)
    read = Clip(clip.frames, clip.times, clip.times, float(FPS), SIZE, whole)
    found = find_in_clip(read, mask_networks(), Prompts())
    return RecordedClip(clip.name, clip.frames, found.masks, clip.times)
