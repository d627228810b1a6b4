"""Measuring a clip: its frames are read, bodies are looked for, and flow is measured beside that."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.bodies.free_motion import LEAST_SECONDS
from pipeline.bodies.mask_source import mask_source
from pipeline.bodies.user_clip import UserClip, with_masks
from pipeline.bodies.video_stretch import VideoStretch, read_stretch
from pipeline.clips.schedule import FilmedSchedule
from pipeline.inference.asking import raw_flow, shown_flow
from pipeline.inference.measured_clip import MeasuredClip, clip_schedule, measured_clip
from pipeline.inference.progress import Progress
from pipeline.model.model_input import ModelInput

LATE = 0.15  # s: a clip in which no body is seen for longer begins where one is


@dataclass(frozen=True)
class FlowSource:
    """What measures flow.

    Attributes:
        name: "raft" or "dis".
        raft: Weights of RAFT.
    """

    name: str
    raft: Path


def measure_clip(
    clip: VideoStretch | UserClip,
    shown: ModelInput,
    flow: FlowSource,
    *,
    progress: Progress,
    when_seen: Callable[[UserClip], None] | None = None,
) -> MeasuredClip:
    """Read frames, find bodies and measure flow.

    A stretch whose beginning the user did not choose begins where a body is first seen.

    Args:
        clip: A stretch of a video, or frames with masks.
        shown: How the model's input is made, which says how flow is measured.
        flow: What measures it.
        progress: Told of each step.
        when_seen: Called with the clip and its masks as soon as they are there.

    Raises:
        VideoError: For a clip that cannot be used, or in which nothing moves.
    """
    if isinstance(clip, VideoStretch):
        with progress.step("frames"):
            read, part = read_stretch(clip, mask_source(clip.place, clip.masks, clip.prompts))
        name, begins, frames, note = str(clip.place), part.start, read.clip, part.note
    else:
        name, taken, frames, note = "clip", clip, clip.clip, None
    schedule = clip_schedule(Path(name), frames.times)
    with ThreadPoolExecutor(1, "flow") as beside:
        measuring = beside.submit(raw_flow, frames, schedule, shown, flow.name, flow.raft)
        if isinstance(clip, VideoStretch):
            with progress.step("masks"):
                taken = with_masks(read, clip.prompts)
            late = seen_from(taken)
            if clip.start is None and late > LATE and part.seconds - late >= LEAST_SECONDS:
                progress.say("note", f"no body is seen before {part.start + late:.2f} s: the clip begins there")
                later = replace(clip, start=part.start + late, seconds=part.seconds - late)
                return measure_clip(later, shown, flow, progress=progress, when_seen=when_seen)
            say_bodies(progress, name, begins, taken, [*([note] if note else []), *taken.clip.notes])
        if when_seen is not None:
            when_seen(taken)
        with progress.step("flow"):  # what is left of it after the masks
            field = shown_flow(measuring.result(), taken, schedule, shown)
    measured = measured_clip(name, taken, schedule, field)
    return measured if note is None else replace(measured, notes=(note, *measured.notes))


def seen_from(taken: UserClip) -> float:
    """s after its beginning, when a clip first shows a body."""
    return float(taken.clip.times[taken.masks.any((1, 2)).argmax()])


def say_bodies(progress: Progress, name: str, start: float, taken: UserClip, notes: Sequence[str]) -> None:
    """Tell what was read and found; notes: on the clip."""
    width, height = taken.clip.source_size
    span = f"{start:.3g} to {start + FilmedSchedule.of(taken.clip.times).seconds:.3g} s"
    progress.say("clip", f"{name}: {span}, {width}x{height}, {taken.clip.source_fps:.4g} FPS")
    for note in notes:
        progress.say("note", note)
    progress.say("masks", summary(taken))
    for note in taken.found.notes if taken.found else ():
        progress.say("note", note)
    for doubt in taken.doubts:
        progress.say("doubt", doubt)


def summary(taken: UserClip) -> str:
    """How many bodies, with their scores, and from where."""
    count = len(taken.found.bodies) if taken.found else taken.objects
    many = "body" if count == 1 else "bodies"
    if taken.found is None:
        return f"{count} {many}, from {taken.masks_from}"
    scores = ", ".join(f"{k} ({b.label})" for k, b in enumerate(taken.found.bodies, 1))
    return f"{count} {many}, from {taken.masks_from}: {scores}"
