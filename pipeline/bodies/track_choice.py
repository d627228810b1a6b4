"""Which tracks of a clip are its bodies: those that the network is sure of, and what the user says."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.bodies.candidates import LEAST_SCORE, Candidates
from pipeline.bodies.prompts import Mark, Prompts, frame_of
from pipeline.bodies.tracks.grouping import Piece, Track
from pipeline.bodies.tracks.grown_track import grown_track, region_at_point, region_in_box
from pipeline.bodies.tracks.resting import resting
from pipeline.bodies.tracks.track_ends import with_all_ends
from pipeline.errors import ParamsError
from pipeline.vision.recordings.mask_file import MOST_BODIES

NEAR_RADII, NEAR_PX = 0.5, 2.0  # a point so near to a track's pixels is on its body; px of the network's picture
IN_BOX = 0.7  # share of a track's pixels that must lie in a box
SAME = 0.5  # median overlap of two tracks that are one body
FILLS_BOX = 0.3  # intersection over union of a box and of the box around the tracks in it


@dataclass(frozen=True)
class ChosenTrack:
    """A track that may be a body.

    Attributes:
        track: At the size of the network's picture.
        score: Probability that it is a moving body; None where the network did not see it.
        like_other: Probability that it is a hand, cloth or a mirror image.
        marked: The user pointed at it.
    """

    track: Track
    score: float | None
    like_other: float = 0.0
    marked: bool = False

    @property
    def origin(self) -> str:
        """What found it: "network", "candidate" (the network, below its least score) or "grown"."""
        return "grown" if self.score is None else "network" if self.score >= LEAST_SCORE else "candidate"

    @property
    def rank(self) -> tuple[bool, float]:
        """What is likelier is larger."""
        return self.marked, 1.0 if self.score is None else self.score


class TrackChoice:
    """The tracks of a clip, of which prompts choose.

    Args:
        found: The candidates.
        scores: (N,) Their probabilities to be moving bodies.
        like_other: (N,) To be hands, cloth or mirror images.
        prompts: What the user says.
        times: (T,) s, of the clip's frames.
        source_size: (width, height) px of the picture to which prompts refer.

    Attributes:
        notes: What was done because of the prompts, a sentence each.
    """

    def __init__(
        self,
        found: Candidates,
        scores: np.ndarray,
        like_other: np.ndarray,
        prompts: Prompts,
        times: np.ndarray,
        source_size: tuple[int, int],
    ) -> None:
        self._frames, self._prompts, self._times = found.frames, prompts, times
        height, width = found.frames.shape[1:3]
        self._scale = np.array([width / source_size[0], height / source_size[1]])
        probable = [t for t, s in zip(found.tracks, scores, strict=True) if prompts or s >= LEAST_SCORE]
        whole = with_all_ends(resting(probable, found.frames), found.frames, found.changed)
        rested = dict(zip(map(id, probable), whole, strict=True))
        self._all = [
            ChosenTrack(rested.get(id(t), t), float(s), float(o))
            for t, s, o in zip(found.tracks, scores, like_other, strict=True)
        ]
        self.notes: list[str] = []

    def chosen(self) -> list[ChosenTrack]:
        """The bodies, in the order of their appearance. Raises ParamsError where the prompts cannot be met."""
        prompts = self._prompts
        for point in prompts.points:
            self._mark_point(point)
        for box in prompts.boxes:
            self._mark_box(box)
        for point in prompts.ignored:
            self._drop(point)
        ranked = sorted(self._all, key=lambda c: c.rank, reverse=True)
        kept = [c for c in ranked if c.marked or c.origin == "network"][:MOST_BODIES]
        if prompts.objects is not None:
            if len(ranked) < prompts.objects:
                raise ParamsError(
                    f"--objects {prompts.objects}: only {len(ranked)} moving things are found in this clip; valid: at "
                    "most that many, or --point where another one is"
                )
            kept = ranked[: prompts.objects]
            for c in kept:
                if not c.marked and c.origin == "candidate":
                    self.notes.append(
                        f"--objects {prompts.objects}: a thing that the network takes for a moving body with "
                        f"probability {c.score:.2f} only is kept, too"
                    )
        return sorted(kept, key=lambda c: (c.track.first, -len(c.track.pieces[c.track.first].pixels)))

    def _mark_point(self, point: Mark) -> None:
        t, place = frame_of(point, self._times), np.array(point.at) * self._scale
        on = self._at(t, place)
        if on is not None:
            self._note_candidate(f"--point {point}", on)
            self._replace([on], replace(on, marked=True))
            return
        grown = region_at_point(self._frames, t, place)
        if grown is None:
            raise ParamsError(
                f"--point {point}: the network finds no body there, and no region of a body's size can be told apart "
                "by motion or colour; valid: a point in the middle of a body, or a --box around it"
            )
        self._grow(f"--point {point}", t, grown[0], f"a region was told apart by its {grown[1]}")

    def _mark_box(self, box: Mark) -> None:
        t, corners = frame_of(box, self._times), np.array(box.at) * np.tile(self._scale, 2)
        inside = [c for c in self._all if t in c.track.pieces and self._share_in(c.track.pieces[t], corners) >= IN_BOX]
        if inside and self._fills(inside, t, corners) >= FILLS_BOX:
            whole = max(inside, key=lambda c: len(c.track.pieces[t].pixels))
            joined = replace(whole, track=_joined([whole, *(c for c in inside if c is not whole)]), marked=True)
            if len(inside) > 1:
                self.notes.append(f"--box {box}: {len(inside)} pieces that the network found in it are one body")
            self._note_candidate(f"--box {box}", joined)
            self._replace(inside, joined)
            return
        region = region_in_box(self._frames, t, corners)
        if not region.any():
            raise ParamsError(
                f"--box {box}: nothing in it can be told from what is around it; valid: a box around a body"
            )
        self._grow(f"--box {box}", t, region, "the box was cut out by colour")

    def _drop(self, point: Mark) -> None:
        on = self._at(frame_of(point, self._times), np.array(point.at) * self._scale)
        if on is None:
            self.notes.append(f"--ignore {point}: nothing was found there, so that it changes nothing")
        elif on.marked:
            raise ParamsError(f"--ignore {point}: --point or --box names the body that is there; valid: one of the two")
        else:
            self.notes.append(f"--ignore {point}: what was found there (probability {on.score:.2f}) is left out")
            self._replace([on], None)

    def _grow(self, prompt: str, t: int, region: np.ndarray, how: str) -> None:
        track = grown_track(self._frames, t, region)
        note = f"{prompt}: the network finds no body there; {how} and followed through {len(track.pieces)} of "
        note += f"{len(self._frames)} frames"
        same = sorted((c for c in self._all if _same(c.track, track)), key=lambda c: c.rank, reverse=True)
        if not same:
            self.notes.append(note)
            self._all.append(ChosenTrack(track, None, marked=True))
            return
        self.notes.append(f"{note}; it is a body that the network sees in other frames")
        pieces: dict[int, Piece] = {}
        for c in sorted([*same, ChosenTrack(track, LEAST_SCORE)], key=lambda c: c.rank):  # the surer, the later
            pieces |= c.track.pieces
        self._replace(same, replace(same[0], track=replace(same[0].track, pieces=pieces), marked=True))

    def _note_candidate(self, prompt: str, on: ChosenTrack) -> None:
        if on.origin == "candidate":
            self.notes.append(
                f"{prompt}: the network takes what is there for a moving body with probability {on.score:.2f} only; it "
                "is kept"
            )

    def _replace(self, old: list[ChosenTrack], new: ChosenTrack | None) -> None:
        self._all = [c for c in self._all if not any(c is o for o in old)] + ([new] if new else [])

    def _at(self, t: int, place: np.ndarray) -> ChosenTrack | None:
        """The track that has a place (2,) px in frame t, or is near."""
        best, nearest = None, np.inf
        for each in sorted(self._all, key=lambda c: c.rank, reverse=True):
            piece = each.track.pieces.get(t)
            if piece is None:
                continue
            apart = float(np.linalg.norm(self._places(piece) - place, axis=1).min())
            if apart < max(NEAR_PX, NEAR_RADII * piece.radius) and apart < nearest - 0.5:
                best, nearest = each, apart
        return best

    def _places(self, piece: Piece) -> np.ndarray:
        """(M, 2) centres of a piece's pixels."""
        width = self._frames.shape[2]
        return np.stack([piece.pixels % width, piece.pixels // width], 1) + 0.5

    def _share_in(self, piece: Piece, corners: np.ndarray) -> float:
        places = self._places(piece)
        return float(((places >= corners[:2]) & (places <= corners[2:])).all(1).mean())

    def _fills(self, inside: list[ChosenTrack], t: int, corners: np.ndarray) -> float:
        """Intersection over union of a box (4,) px and the box around what tracks fill in frame t."""
        places = np.concatenate([self._places(c.track.pieces[t]) for c in inside])
        low, high = places.min(0) - 0.5, places.max(0) + 0.5
        shared = np.prod(np.clip(np.minimum(high, corners[2:]) - np.maximum(low, corners[:2]), 0, None))
        return float(shared / (np.prod(high - low) + np.prod(corners[2:] - corners[:2]) - shared))


def _same(one: Track, other: Track) -> bool:
    """Whether two tracks are one body's: they overlap in the frames in which both are seen."""
    shared = set(one.pieces) & set(other.pieces)
    if not shared:
        return False
    overlaps = []
    for t in shared:
        first, second = one.pieces[t].pixels, other.pieces[t].pixels
        overlaps.append(len(np.intersect1d(first, second)) / min(len(first), len(second)))
    return bool(np.median(overlaps) > SAME)


def _joined(tracks: list[ChosenTrack]) -> Track:
    """The first track, with the pixels of the others."""
    whole = replace(tracks[0].track, pieces=dict(tracks[0].track.pieces))
    for other in tracks[1:]:
        for t, piece in other.track.pieces.items():
            whole.add(t, piece)
    return whole
