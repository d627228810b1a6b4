"""The moving bodies of a clip, found by the network for masks and by what the user says of them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from pipeline.bodies.candidates import Candidates, candidate_scores, draw_masks, find_candidates
from pipeline.bodies.clip_faults import clip_faults
from pipeline.bodies.networks.mask_networks import MaskNetworks
from pipeline.bodies.networks.outlines import sharpen
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.track_choice import TrackChoice
from pipeline.bodies.tracks.continued_body import continued_bodies
from pipeline.bodies.tracks.exchanged_bodies import without_exchanges
from pipeline.bodies.tracks.rigid_pieces import joined_pieces
from pipeline.bodies.tracks.shadow_tracks import shadows_among
from pipeline.bodies.tracks.track_score import FIGURES
from pipeline.errors import VideoError
from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.mask_file import only
from pipeline.vision.recordings.video import Clip

LIKE_OTHER = 0.5  # probability from which a body is doubted
LEAST_OTHER = 0.002  # of the picture, mean over the clip, that hands and cloth cover: they are named as what moves


@dataclass(frozen=True)
class FoundBody:
    """One body of the masks.

    Attributes:
        score: Probability that it is a moving body; None where the user pointed at it and the network did not see it.
        origin: "network", "candidate" (below the least score, but asked for), "grown" (from a point or a box), or the
            published segmenter that followed it.
        radius_px: Of the clip's frames; None where it was not estimated.
    """

    score: float | None
    origin: str
    radius_px: float | None

    @property
    def label(self) -> str:
        """Its score, or where it comes from, in few letters."""
        return self.origin if self.score is None else f"{self.score:.2f}"


@dataclass(frozen=True)
class FoundBodies:
    """The bodies of a clip.

    Attributes:
        clip: The frames in which they were looked for, in the video's own size.
        masks: (T, H, W) uint8 of these frames, 0 or the body's number from 1.
        bodies: In the order of their numbers, which is that of their appearance.
        notes: What was done because of prompts, a sentence each.
        doubts: What may be wrong, a sentence each.
    """

    clip: Clip
    masks: np.ndarray
    bodies: tuple[FoundBody, ...]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]


def find_in_clip(clip: Clip, networks: MaskNetworks, prompts: Prompts) -> FoundBodies:
    """The bodies of a clip in its own size.

    Args:
        clip: Its frames, of a resting camera.
        networks: For masks.
        prompts: What the user says.

    Raises:
        VideoError: Where no body is found; it says what moves instead.
        ParamsError: For prompts that are outside of the clip, or that nothing in it fits.
    """
    prompts.check(clip.source_size, clip.source_times)
    found = find_candidates(clip.frames, networks.moving)
    like_other = found.figures[:, FIGURES.index("other")]
    likely = candidate_scores(found, networks.moving)
    choice = TrackChoice(
        found=found,
        scores=likely,
        like_other=like_other,
        prompts=prompts,
        times=clip.source_times,
        source_size=clip.source_size,
    )
    kept = choice.chosen()
    if not kept:
        raise VideoError(why_none(clip, found, float(likely.max(initial=0)), choice.notes))
    drawn = draw_masks([c.track for c in kept], found.probability, clip.frames)
    stiff = [bool(c.track.ends) for c in kept]
    masks, groups = joined_pieces(drawn, clip.frames, clip.times, [c.marked for c in kept], stiff)
    masks = without_exchanges(masks, clip.frames, clip.times)
    alone = [k for k, g in enumerate(groups) if len(g) == 1 and not kept[g[0] - 1].marked]
    shadows = {alone[i] for i in shadows_among([kept[groups[k][0] - 1].track for k in alone], found.frames)}
    if shadows:
        left = [k for k in range(len(groups)) if k not in shadows]
        masks, groups = only(masks, [k + 1 for k in left]), [groups[k] for k in left]
    if networks.outlines is not None:
        hulls = [k for k, g in enumerate(groups, 1) if len(g) > 1 or stiff[g[0] - 1]]
        masks = sharpen(clip.frames, masks, networks.outlines, hulls)
    marked = [any(kept[piece - 1].marked for piece in g) for g in groups]
    masks, same = continued_bodies(masks, clip.frames, clip.times, marked)
    notes = [
        *choice.notes,
        *(["a shadow that moves beside its body was left out; --point on it keeps it"] if shadows else []),
    ]
    for k, tracks in enumerate(same, 1):
        pieces = [len(groups[t]) for t in tracks]
        notes += [f"{count} pieces that move as one rigid body are body {k}" for count in pieces if count > 1]
        if len(tracks) > 1:
            notes.append(f"{len(tracks)} tracks are body {k}, which moves too far between two frames to be followed")
    groups = [list(itertools.chain.from_iterable(groups[k] for k in g)) for g in same]
    scale = np.mean([clip.frames.shape[side] / found.frames.shape[side] for side in (1, 2)])
    bodies, doubts = [], []
    for number, group in enumerate(groups, 1):
        first = max((kept[piece - 1] for piece in group), key=lambda c: c.rank)
        radius = float(scale * kept[group[0] - 1].track.typical_radius) if len(group) == 1 else None
        bodies.append(FoundBody(first.score, first.origin, radius))
        if first.like_other > LIKE_OTHER:
            doubts.append(
                f"body {number} may be a hand, cloth or a mirror image (probability {first.like_other:.2f}); if it is, "
                "--ignore drops it"
            )
    doubts += clip_faults(clip.frames, masks)
    return FoundBodies(clip, masks, tuple(bodies), tuple(notes), tuple(doubts))


def moving_masks(frames: np.ndarray, times: np.ndarray, networks: MaskNetworks) -> np.ndarray:
    """The masks that `find_in_clip` finds without any prompt, of frames in memory.

    A body that moves at some time is found in all frames, also while it rests. Hands, cloth, shadows and mirror images
    are left out.

    Args:
        frames: (T, H, W, 3) uint8 of a resting camera, T of 2 or more.
        times: (T,) s.
        networks: Of `load_mask_networks`.

    Returns:
        (T, H, W) uint8, 0 or a body's number from 1; 0 throughout where no body is found.

    Raises:
        ValueError: For frames of another type or shape.
    """
    size = (frames.shape[2], frames.shape[1])
    clip = Clip(frames, times, times, float(1 / np.median(np.diff(times))), size, letterbox_for(size, size))
    try:
        return find_in_clip(clip, networks, Prompts()).masks
    except VideoError:
        return np.zeros(frames.shape[:3], np.uint8)


def why_none(clip: Clip, found: Candidates, likeliest: float, notes: list[str]) -> str:
    """One sentence on a clip in which no body is found: what moves instead, and what to do.

    Args:
        clip: Its frames.
        found: The candidates, none of which counts.
        likeliest: The highest of their probabilities.
        notes: What prompts did.
    """
    ask = "; give another --start, or --point X,Y on a body"
    nothing = np.zeros(clip.frames.shape[:3], np.uint8)
    faults = clip_faults(clip.frames, nothing)
    if notes:
        return f"no body is left: {'; '.join(notes)}"
    if faults:
        return f"no moving body is found, and {' and '.join(faults)}{ask}"
    if float((found.prediction.other > LIKE_OTHER).mean()) > LEAST_OTHER:
        return f"no moving body is found: what moves in this clip looks like a hand, cloth or a mirror image{ask}"
    if len(found.tracks):
        return f"no moving body is found: what changes is a body with probability {likeliest:.2f} at most{ask}"
    return f"nothing moves in this clip, or it is too small to be seen{ask}"
