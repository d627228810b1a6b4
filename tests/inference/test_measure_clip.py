"""Laws of the measuring of a clip."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.bodies.user_clip import ReadClip, UserClip
from pipeline.bodies.video_stretch import VideoStretch
from pipeline.errors import VideoError
from pipeline.inference import measure_clip as measuring
from pipeline.inference.measure_clip import FlowSource, measure_clip
from pipeline.inference.measured_clip import clip_schedule
from pipeline.inference.progress import Progress
from pipeline.model.model_input import ModelInput
from pipeline.shards.code_hash import ROOT

VIDEO = ROOT / "data" / "samples" / "cross_engine_17" / "video.mp4"
SHOWN = ModelInput("flow", None, "dis", (240, 160), 1, True, "bodies")


@pytest.fixture
def appears(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    """The time, s, from which the masks show a body."""
    when = {"s": 0.0}

    def with_masks(read: ReadClip, _: object) -> UserClip:
        grey = read.clip.frames.mean(-1)
        masks = (np.abs(grey - np.median(grey, axis=0)) > 40).astype(np.uint8)
        masks[read.clip.source_times < when["s"]] = 0
        return UserClip(read.clip, masks, "a test", None, ())

    monkeypatch.setattr(measuring, "with_masks", with_masks)
    return when


@pytest.mark.parametrize(("seen", "begins"), [(0.0, 0.0), (0.1, 0.0), (0.4, 0.4), (0.9, 0.0)])
def test_a_clip_begins_where_a_body_is_first_seen_if_enough_is_left(
    appears: dict[str, float], seen: float, begins: float
) -> None:
    appears["s"] = seen
    measured = measure_clip(VideoStretch(VIDEO), SHOWN, FlowSource("dis", Path()), progress=Progress())
    assert measured.taken.clip.source_times[0] == pytest.approx(begins, abs=0.02)
    assert len(measured.taken.masks) == len(measured.taken.clip.frames)


def test_clips_of_a_few_frames_are_too_short() -> None:
    assert clip_schedule(VIDEO, np.arange(5) / 30).frames == 5
    with pytest.raises(VideoError, match=r"4 frames in 0\.133 s are too short; valid: 5 frames, and 0\.15 s, or more"):
        clip_schedule(VIDEO, np.arange(4) / 30)


@pytest.mark.parametrize("seconds", [0.5166, 0.55, 0.6499])
def test_a_clip_has_as_many_frames_as_its_schedule(appears: dict[str, float], seconds: float) -> None:
    asked = replace(VideoStretch(VIDEO), start=0.0, seconds=seconds)
    measured = measure_clip(asked, SHOWN, FlowSource("dis", Path()), progress=Progress())
    assert len(measured.taken.clip.frames) == measured.schedule.frames


def test_a_beginning_that_the_user_chose_stays(appears: dict[str, float]) -> None:
    appears["s"] = 0.5
    chosen = replace(VideoStretch(VIDEO), start=0.0)
    measured = measure_clip(chosen, SHOWN, FlowSource("dis", Path()), progress=Progress())
    assert measured.taken.clip.source_times[0] == 0
