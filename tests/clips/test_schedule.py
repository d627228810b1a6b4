import numpy as np
import pytest

from pipeline.clips.schedule import Schedule


def test_a_second_at_30_frames_has_ten_pairs_three_frames_apart() -> None:
    schedule = Schedule()
    assert (schedule.frames, schedule.steps) == (30, 240)
    np.testing.assert_array_equal(schedule.frame_steps, 8 * np.arange(30))
    np.testing.assert_array_equal(schedule.pairs, [[3 * i, 3 * i + 1] for i in range(10)])


@pytest.mark.parametrize(
    ("seconds", "fps", "model_frames"), [(1, 30, 16), (0.5, 25, 10), (2, 30, 10), (1, 30, 29), (1, 7, 2)]
)
def test_pairs_are_spread_evenly_and_stay_inside_the_clip(seconds: float, fps: int, model_frames: int) -> None:
    schedule = Schedule(seconds, fps, model_frames)
    first, second = schedule.pairs.T
    assert len(first) == model_frames
    np.testing.assert_array_equal(second, first + 1)
    assert first[0] == 0
    assert second[-1] < schedule.frames
    gaps = np.diff(first)
    assert gaps.max() - gaps.min() <= 1
    assert schedule.frames - first[-1] <= gaps.max() + 1
    steps = schedule.frame_steps
    assert (np.diff(steps) > 0).all()
    assert steps[-1] < schedule.steps
    np.testing.assert_allclose(steps / 240, np.arange(schedule.frames) / fps, atol=0.5 / 240 + 1e-9)


def test_the_first_part_has_the_same_frames_as_the_whole() -> None:
    whole = Schedule()
    part = whole.first(0.5)
    assert (part.frames, part.model_frames) == (15, 5)
    np.testing.assert_array_equal(part.pairs, whole.pairs[:5])
    np.testing.assert_array_equal(part.frame_steps, whole.frame_steps[:15])
    with pytest.raises(ValueError, match=r"0.47 s; valid: multiples of 0.1 s"):
        whole.first(0.47)
    with pytest.raises(ValueError, match="1 s; valid"):
        whole.first(1.0)
