import numpy as np
import pytest

from pipeline.clips.schedule import FilmedSchedule, Schedule


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


@pytest.mark.parametrize("rate", [15, 24, 25, 30, 50, 60, 120])
@pytest.mark.parametrize("count", [5, 12, 30, 90])
def test_the_model_sees_the_filmed_frames_that_are_nearest_to_its_moments(rate: int, count: int) -> None:
    times = np.arange(count) / rate
    schedule = FilmedSchedule.of(times)
    assert (schedule.frames, schedule.seconds) == (count, pytest.approx(count / rate, rel=1e-4))
    first, second = schedule.pairs.T
    moments = np.arange(10) * schedule.seconds / 10
    assert (np.abs(times[first] - moments) <= 0.5 / rate + 1e-6 + (first == count - 2) / rate).all()
    assert (second > first).all()
    apart = times[second] - times[first]
    assert (np.abs(apart - max(1 / 30, 1 / rate)) <= 0.5 / rate + 1e-6 + (second == count - 1) / 30).all()
    np.testing.assert_allclose(schedule.pair_scale * apart, 1 / 30, rtol=1e-3)


def test_a_second_that_was_filmed_at_30_frames_has_the_schedule_of_a_rendered_one() -> None:
    filmed, rendered = FilmedSchedule.of(np.arange(30) / 30), Schedule()
    np.testing.assert_array_equal(filmed.pairs, rendered.pairs)
    np.testing.assert_array_equal(filmed.frame_steps, rendered.frame_steps)
    np.testing.assert_allclose(filmed.pair_scale, 1, rtol=1e-3)


def test_the_first_part_of_a_filmed_clip_has_the_same_frames(rng: np.random.Generator) -> None:
    whole = FilmedSchedule.of(np.cumsum(rng.uniform(0.02, 0.05, 40)) - 0.02)
    part = whole.first(0.7 * whole.seconds)
    assert part.model_frames == 7
    np.testing.assert_array_equal(part.pairs, whole.pairs[:7])
    np.testing.assert_array_equal(part.frame_steps, whole.frame_steps[: part.frames])
    with pytest.raises(ValueError, match="valid: multiples of"):
        whole.first(0.66 * whole.seconds)
