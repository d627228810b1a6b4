"""Films that once went wrong, each of a kind; they lie beside the project and are not part of it."""

from pathlib import Path

import pytest

from pipeline.api.infer import Inference, infer
from pipeline.errors import VideoError
from training.data_folder import data_folder

CASES = data_folder() / "cases"


def film(case: str) -> Path:
    found = sorted((CASES / case).glob("clip.*"))
    if not found:
        pytest.skip(f"there is no {CASES / case}: set DYNAMICS_DATA to the folder that has cases")
    return found[0]


def answer(case: str) -> Inference:
    return infer(film(case))


@pytest.mark.parametrize("case", ["small_fast_bounce_30", "small_fast_bounce"])
def test_a_small_fast_ball_is_followed_in_the_frames_that_were_filmed(case: str) -> None:
    found = answer(case)
    assert found.clip.objects == 1
    assert found.best.overlap.sequence >= 0.75
    assert found.grade.name == "good"
    assert not any("repeat" in note for note in found.clip.notes)


def test_sinking_at_a_steady_speed_is_not_told_from_a_view_from_above() -> None:
    found = answer("terminal_speed")
    view = found.scenes.filmed.motion.view.kind
    assert view in ("side", "flight") or any("--view top or --view side" in doubt for doubt in found.doubts)


def test_a_camera_that_pans_is_named() -> None:
    with pytest.raises(VideoError, match="the camera moves"):
        answer("camera_pans")
