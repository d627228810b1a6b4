"""A user's clip: its frames, masks and flow, and what was assumed on the way."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.bodies.free_motion import LEAST_SECONDS
from pipeline.bodies.networks.body_shapes import shape_probabilities
from pipeline.bodies.networks.shape_network import ShapeNetwork, load_shape_network
from pipeline.bodies.user_clip import WEIGHTS, UserClip
from pipeline.clips.schedule import FilmedSchedule
from pipeline.errors import VideoError
from pipeline.model.language.completion import MAX_OBJECTS
from pipeline.vision.recordings.letterbox import of_area

LEAST_FRAMES = 5  # of a clip
STILL_PX = 0.3  # px of 480x320 per frame interval: a slower body does not move


@lru_cache(maxsize=1)
def shape_network() -> ShapeNetwork:
    """The network for shapes that ships, loaded once."""
    return load_shape_network(WEIGHTS)


@dataclass(frozen=True)
class MeasuredClip:
    """What is known of a clip before anything is inferred.

    Attributes:
        taken: Frames and masks.
        schedule: Which moments are frames, and which pairs of them the model sees.
        flow: (P, H, W, 2), px of the frames, of these pairs.
        shape_prior: (N, 3) probability of each of `BASIC_SHAPES` by the network for shapes; None with given masks,
            whose outlines tell the shapes.
        notes: What was assumed or may be wrong, a sentence each.
    """

    taken: UserClip
    schedule: FilmedSchedule
    flow: np.ndarray
    shape_prior: np.ndarray | None
    notes: tuple[str, ...]

    @property
    def objects(self) -> int:
        """How many instances the masks have."""
        return self.taken.objects

    def shaped(self, size: tuple[int, int]) -> tuple[int, int]:
        """px, width and height, of pictures with the clip's shape and the area of a size."""
        return of_area(self.taken.clip.letterbox.size, size[0] * size[1])


def clip_schedule(place: Path, times: np.ndarray) -> FilmedSchedule:
    """The frames of a clip that were filmed at times (F,), s. Raises VideoError where they are too few."""
    schedule = FilmedSchedule.of(times)
    if schedule.frames < LEAST_FRAMES or schedule.seconds < LEAST_SECONDS:
        raise VideoError(
            f"{place}: {schedule.frames} frames in {schedule.seconds:.3g} s are too short; valid: {LEAST_FRAMES} "
            f"frames, and {LEAST_SECONDS:g} s, or more"
        )
    return schedule


def measured_clip(name: str, taken: UserClip, schedule: FilmedSchedule, flow: np.ndarray) -> MeasuredClip:
    """The clip of that name with its flow (P, H, W, 2). Raises VideoError where nothing moves in its masks."""
    check_motion(name, np.linalg.norm(flow, axis=-1), taken.masks[schedule.pairs[:, 0]])
    notes = [*taken.clip.notes, *(taken.found.notes if taken.found else ())]
    shape_prior = None
    if taken.found is not None:
        shape_prior = shape_probabilities(taken.clip.frames, taken.masks, taken.objects, shape_network())
    return MeasuredClip(taken, schedule, flow, shape_prior, (*notes, *limits(taken.masks, schedule.seconds)))


def check_motion(name: str, speed: np.ndarray, masks: np.ndarray) -> None:
    """Raise VideoError where no instance of masks (P, H, W) ever moves; speed (P, H, W), px."""
    for k in range(len(masks)):
        for i in np.unique(masks[k][masks[k] > 0]):
            if np.median(speed[k][masks[k] == i]) > STILL_PX:
                return
    raise VideoError(
        f"{name}: nothing moves in this clip: the flow in the masks stays below {STILL_PX} px a frame; give another "
        "--start, or --fps if it is slow motion"
    )


def limits(masks: np.ndarray, seconds: float) -> list[str]:
    """What makes the answer less sure: many bodies in masks (T, H, W), another length than the model learned from."""
    notes = []
    if masks.max(initial=0) > MAX_OBJECTS:
        notes.append(
            f"the masks have {masks.max()} objects, more than the {MAX_OBJECTS} of a scene: some may be pieces of one "
            "body, shadows or reflections; --objects, --ignore or other --masks help"
        )
    if abs(seconds - 1) > 0.1:
        notes.append(f"the clip has {seconds:.3g} s; the models that ship learned from clips of 1 s")
    return notes
