"""The stretch of a recording in which bodies move freely: some body is fast, and no hand is at it.

The network for masks looks at frames spread over the whole recording. A body counts as moving where it has a
share of the fastest one's usual speed, so that a body in a hand, which is hardly moved, and one that rests do not.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pipeline.bodies.candidates import LEAST_SCORE, Candidates, candidate_scores, first_look, working_size
from pipeline.bodies.clip_faults import SHAKING_PX, camera_moves, camera_shift
from pipeline.bodies.networks.network import SegmentationNetwork
from pipeline.bodies.tracks.grouping import Track
from pipeline.errors import VideoError
from pipeline.vision.recordings.mask_file import read_times
from pipeline.vision.recordings.video import Decoder, check_file, frame_times

SECONDS = 1.0  # of a stretch whose start is known: what the models learned from
SHORT_FILE = 1.2  # s: a file so long is taken from its beginning
MOST_FRAMES = 160  # looked at
LEAST_SECONDS, MOST_SECONDS = 0.15, 12.0  # of a stretch
SLOW = 0.2  # share of the fastest body's usual speed, below which a body rests
CHORD, LEAST_CHORD = 0.1, 2  # s, and samples, before and after, over which a speed is measured
LEAST_WAY = 1.0  # radii that a body must get away in the recording
LIKE_BEST, MAY_BE = 0.4, 0.15  # probability of a body that is looked at: of the highest one, and at least
GAP = 0.4  # s, of a rest between two motions of one stretch: at the top of a way
HAND, TOUCHED = 0.5, 0.3  # probability of a hand; area of hands near a body, over the body's, from which they hold it
NEAR = 0.7  # radii around a body, where a hand holds it


@dataclass(frozen=True)
class Stretch:
    """A part of a recording.

    Attributes:
        start: s, from the recording's beginning.
        seconds: Its length.
        by: What chose it: "the user", "masks", "the file", which is short, or "motion".
    """

    start: float
    seconds: float
    by: str = "the user"

    @property
    def note(self) -> str | None:
        """A sentence where the motion chose it."""
        if self.by != "motion":
            return None
        return (
            f"the clip begins at {self.start:.2f} s and has {self.seconds:.2f} s, in which bodies move freely; --start "
            "and --seconds choose another part"
        )


def stretch_of(
    video: Path,
    network: Callable[[], SegmentationNetwork],
    *,
    start: float | None,
    seconds: float | None,
    assume_fps: float | None,
    masks: Path | None,
) -> Stretch:
    """The stretch of a recording that is inferred from.

    Args:
        video: The file.
        network: Loads the network for masks.
        start: s, where the user says that it begins; None: where bodies move freely, in a long file.
        seconds: Its length, where the user says it.
        assume_fps: Frame rate of the recording where its time stamps are wrong; None: they are used.
        masks: A file or folder of masks that are given.

    Raises:
        VideoError: The file cannot be read, is shorter than the stretch, or nothing moves in it.
    """
    if start is not None:
        return Stretch(start, SECONDS if seconds is None else seconds)
    check_file(video)
    stamps = frame_times(video, assume_fps)
    if len(stamps) < 2:
        raise VideoError(f"{video} has one frame only: at least two are needed")
    times = None if masks is None else read_times(masks)
    if times is not None and len(times) > 1 and np.isfinite(times).all():
        begin, length = float(times[0]), float(times[-1] - times[0]) * len(times) / (len(times) - 1)
        return Stretch(begin, length if seconds is None else seconds, "masks")
    end = float(stamps[-1] + np.median(np.diff(stamps)))
    if masks is not None or end <= SHORT_FILE:
        return Stretch(0.0, end if seconds is None else seconds, "the file")
    if seconds is not None and seconds > end:
        raise VideoError(f"{video} is {end:.2f} s long: a clip of {seconds:g} s does not fit")
    return free_stretch(video, network(), stamps, assume_fps, seconds)


def free_stretch(
    path: Path, network: SegmentationNetwork, stamps: np.ndarray, assume_fps: float | None, seconds: float | None
) -> Stretch:
    """The stretch of a video file in which bodies move freely.

    Args:
        path: The file.
        network: For masks.
        stamps: (N,) s, of the file's frames.
        assume_fps: Frame rate of the recording where its time stamps are wrong; None: they are used.
        seconds: Length of the stretch; None: as long as bodies move, at most MOST_SECONDS.

    Raises:
        VideoError: The file cannot be decoded, or nothing moves in it.
    """
    interval = float(np.median(np.diff(stamps)))
    end = float(stamps[-1]) + interval
    frames, times = spread_frames(path, stamps, assume_fps)
    found, _ = first_look(frames, network)  # enough to tell when bodies move, in half the time
    scores = candidate_scores(found, network)
    # A body that is lost now and then, since few frames are looked at, has several tracks with low scores.
    least = max(LIKE_BEST * scores.max(initial=0), MAY_BE)
    bodies = [t for t, s in zip(found.tracks, scores, strict=True) if s >= least]
    low, high = longest_motion(*free_way(bodies, found, times), times)
    if not high or scores.max() < LEAST_SCORE:
        shift = camera_shift(frames, np.zeros(frames.shape[:3], np.uint8))
        if shift > SHAKING_PX:
            raise VideoError(f"{path}: {camera_moves(shift)}")
        raise VideoError(
            f"{path}: no body moves freely in it, as far as {len(times)} of its frames show; give --start and --seconds"
        )
    return fitted(low, high + interval, end, seconds)


def fitted(low: float, high: float, end: float, seconds: float | None) -> Stretch:
    """The stretch from low to high, s, of a recording that ends at `end`, brought to a length."""
    length = seconds if seconds is not None else min(max(high - low, LEAST_SECONDS), MOST_SECONDS)
    start = low if length <= high - low else 0.5 * (low + high - length)
    start = min(max(start, 0.0), max(end - length, 0.0))
    return Stretch(start, min(length, end - start), "motion")


def spread_frames(path: Path, stamps: np.ndarray, assume_fps: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Frames (T, h, w, 3) uint8 spread over a recording, of the network's size, and their times (T,) s.

    stamps: (N,) s, of all frames.
    """
    kept = np.unique(np.linspace(0, len(stamps) - 1, min(len(stamps), MOST_FRAMES)).round().astype(int))
    wanted, decoder = set(kept.tolist()), Decoder(path, 0.0, assume_fps)
    frames, times = [], []
    for k, (time, picture) in enumerate(decoder):
        if k in wanted:
            size = working_size(picture.shape[1], picture.shape[0])
            frames.append(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
            times.append(time)
    decoder.close()
    if len(frames) < 2:
        raise VideoError(f"{path} is broken: its frames cannot be decoded")
    return np.stack(frames), np.array(times)


def free_way(bodies: Sequence[Track], found: Candidates, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far bodies go freely, and where one of them comes back into the picture.

    A body does not move freely where it is slow beside the fastest one, where a hand is at it, and where the border of
    the picture cuts it.

    Args:
        bodies: Their tracks.
        found: All candidates of the clip.
        times: (T,) s, of its frames.

    Returns:
        (T,) radii that all bodies go freely up to each frame from the one before, and (T,) bool: frames in which a body
        is out of the picture, or cut by its border, that is whole before and after, or in which none is seen. What
        happens there is not known.
    """
    out, breaks, followed = np.zeros(len(times)), np.zeros(len(times), bool), np.zeros(len(times), bool)
    motions = []
    for body in bodies:
        seen = np.array(sorted(body.pieces))
        radius = body.typical_radius
        place = np.array([body.pieces[k].centre for k in seen])
        if len(seen) > 2 and np.linalg.norm(np.ptp(place, axis=0)) > LEAST_WAY * radius:
            speed = steady_speed(place, times[seen])
            motions.append((body, seen, radius, speed, speed * np.diff(times[seen], prepend=times[seen[0]])))
    fastest = max((usual_speed(steps, speed) for *_, speed, steps in motions), default=0.0)
    for body, seen, radius, speed, steps in motions:
        cut = np.array([body.pieces[k].at_border(*found.frames.shape[1:3]) for k in seen])
        held = np.array([touched(body, found, int(k)) for k in seen])
        free = (speed > SLOW * fastest) & ~held & ~cut
        out[seen[free]] += steps[free] / radius
        followed[seen[0] : seen[-1] + 1] = True
        if free.any():
            first, last = seen[free][[0, -1]]
            breaks[seen[cut & (seen > first) & (seen < last)]] = True
    return out, breaks | ~followed


def steady_speed(place: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(T,) speeds at times (T,) of places (T, 2): the lower of those before and after, since a hand lets go first."""
    index = np.arange(len(times))
    span = max(LEAST_CHORD, round(CHORD / float(np.median(np.diff(times)))))

    def chord(other: np.ndarray) -> np.ndarray:
        apart = np.abs(times[other] - times)
        way = np.linalg.norm(place[other] - place, axis=1)
        return np.where(apart > 0, way / np.where(apart > 0, apart, 1), np.inf)

    return np.minimum(chord(np.minimum(index + span, len(times) - 1)), chord(np.maximum(index - span, 0)))


def usual_speed(steps: np.ndarray, speed: np.ndarray) -> float:
    """The speed above which a body goes half of its way; steps: (N,), each with its speed (N,)."""
    order = np.argsort(speed)
    along = np.cumsum(steps[order])
    return float(speed[order][np.searchsorted(along, along[-1] / 2)])


def touched(body: Track, found: Candidates, k: int) -> bool:
    """Whether a hand is at a body in frame k."""
    piece, (height, width) = body.pieces[k], found.frames.shape[1:3]
    own = np.zeros(height * width, np.uint8)
    own[piece.pixels] = 1
    reach = max(round(NEAR * piece.radius), 2)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    near = cv2.dilate(own.reshape(height, width), disc) > 0
    return bool(((found.prediction.other[k] > HAND) & near).sum() > TOUCHED * len(piece.pixels))


def longest_motion(way: np.ndarray, breaks: np.ndarray, times: np.ndarray) -> tuple[float, float]:
    """Begin and end, s, of the motion without a longer rest than GAP in which bodies go furthest; (0, 0) without any.

    Args:
        way: (T,) radii that bodies go from the frame before.
        breaks: (T,) bool: frames at which a motion ends and another begins, in any case.
        times: (T,) s.
    """
    moving = np.flatnonzero(way > 0)
    if not len(moving):
        return 0.0, 0.0
    gap = max(GAP, 2.5 * float(np.median(np.diff(times))))
    apart = (np.diff(times[moving]) > gap) | (np.diff(np.cumsum(breaks)[moving]) > 0)
    parts: Sequence[np.ndarray] = np.split(moving, np.flatnonzero(apart) + 1)
    best = max(parts, key=lambda part: way[part].sum())
    return float(times[max(best[0] - 1, 0)]), float(times[best[-1]])
