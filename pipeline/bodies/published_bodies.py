"""The bodies of a clip, followed by a published segmenter from the network's masks and the user's points and boxes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.bodies.clip_faults import clip_faults
from pipeline.bodies.found_bodies import FoundBodies, FoundBody, find_in_clip
from pipeline.bodies.networks.mask_networks import MaskNetworks
from pipeline.bodies.networks.propagation import Prompt, body_prompts, segment_with
from pipeline.bodies.networks.published_models import load_published
from pipeline.bodies.prompts import Prompts, frame_of
from pipeline.errors import VideoError
from pipeline.vision.recordings.mask_file import only
from pipeline.vision.recordings.video import Clip

IN_BOX = 0.5  # share of a body's mask that must lie in a box to be the body in it


def follow_in_clip(clip: Clip, networks: MaskNetworks, prompts: Prompts, family: str, folder: Path) -> FoundBodies:
    """The bodies of a clip in its own size.

    Args:
        clip: Its frames, of a resting camera.
        networks: For masks; each body that it finds is followed from the frame in which it is seen best.
        prompts: What the user says; a body at a point or in a box is followed from there.
        family: "sam2" or "edgetam".
        folder: Of its weights.

    Raises:
        ModelError: Where the weights cannot be loaded.
        VideoError: Where no body is found.
        ParamsError: For prompts that do not fit the clip.
    """
    prompts.check(clip.source_size, clip.source_times)
    segmenter = load_published(family, folder)
    marks = (*prompts.points, *prompts.boxes)
    scale = np.array([clip.frames.shape[2] / clip.source_size[0], clip.frames.shape[1] / clip.source_size[1]])
    places = [(frame_of(m, clip.source_times), np.array(m.at) * np.tile(scale, len(m.at) // 2)) for m in marks]
    found = _unmarked(clip, networks, prompts, len(marks))
    seeds: list[Prompt] = []
    scores: list[float | None] = []
    if found is not None:
        for k, (body, seed) in enumerate(zip(found.bodies, body_prompts(found.masks), strict=True), 1):
            if not any(_is_at(found.masks[t] == k, place) for t, place in places):
                seeds.append(seed)
                scores.append(body.score)
    seeds += [_prompt(t, place) for t, place in places]
    masks = segment_with(segmenter, clip.frames, seeds)
    kept = [k for k in range(1, len(seeds) + 1) if (masks == k).any()]
    if not kept:
        raise VideoError(f"{family} finds none of the {len(seeds)} bodies that it is prompted with")
    masks = only(masks, kept)
    scores += [None] * len(marks)
    bodies = tuple(FoundBody(scores[k - 1], family, None) for k in kept)
    notes = [
        f"{family} follows {len(seeds) - len(marks)} bodies from the network's masks and {len(marks)} from prompts"
    ]
    if len(kept) < len(seeds):
        notes.append(f"{family} finds {len(seeds) - len(kept)} of them in no frame: they are left out")
    doubts = clip_faults(clip.frames, masks)
    return FoundBodies(clip, masks, bodies, (*(found.notes if found else ()), *notes), tuple(doubts))


def _unmarked(clip: Clip, networks: MaskNetworks, prompts: Prompts, marks: int) -> FoundBodies | None:
    """What the network finds by itself; None where it need not, or finds nothing."""
    left = None if prompts.objects is None else prompts.objects - marks
    if left is not None and left <= 0:
        return None
    try:
        return find_in_clip(clip, networks, replace(prompts, points=(), boxes=(), objects=left))
    except VideoError:
        if not marks:
            raise
        return None


def _is_at(mask: np.ndarray, place: np.ndarray) -> bool:
    """Whether a mask (H, W) is at a point (2,) or lies in a box (4,), px."""
    if len(place) == 2:
        col, row = place.astype(int)
        return bool(mask[row, col])
    left, top, right, bottom = np.clip(np.round(place), 0, None).astype(int)
    return bool(mask.any() and mask[top:bottom, left:right].sum() > IN_BOX * max(mask.sum(), 1))


def _prompt(t: int, place: np.ndarray) -> Prompt:
    return Prompt(t, points=place[None]) if len(place) == 2 else Prompt(t, box=place)
