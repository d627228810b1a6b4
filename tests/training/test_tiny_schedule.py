"""Schedules of the tiny model's training."""

import pytest

from training.tiny.schedule import learning_rate, max_objects, noise_strength


def test_noise_rises_to_rafts_and_stays() -> None:
    assert [noise_strength(m, 40) for m in (0, 20, 40, 100)] == [0, 0.5, 1, 1] and noise_strength(0, 0) == 1


def test_the_learning_rate_rises_stays_and_falls_at_the_end() -> None:
    assert learning_rate(0, 60, 20) == pytest.approx(0.01)
    assert learning_rate(99, 60, 20) == learning_rate(5000, 20, 20) == 1.0
    assert learning_rate(5000, 10, 20) == pytest.approx(0.51)
    assert learning_rate(5000, 0, 20) == pytest.approx(0.02)
    assert learning_rate(5000, 0, 0) == 1.0


def test_after_the_vision_tower_come_clips_of_one_two_and_three_objects() -> None:
    assert [max_objects(m, 40, 30) for m in (0, 39, 40, 49, 50, 60, 69)] == [6, 6, 1, 1, 2, 3, 3]
    assert max_objects(70, 40, 30) == max_objects(40, 40, 0) == 6
