"""What changes in the course of the tiny model's training."""

import pytest

from training.tiny import learning_rate, most_objects, noise_at


def test_noise_rises_to_rafts_and_stays() -> None:
    assert [noise_at(m, 40) for m in (0, 20, 40, 100)] == [0, 0.5, 1, 1] and noise_at(0, 0) == 1


def test_the_learning_rate_rises_stays_and_falls_at_the_end() -> None:
    assert learning_rate(0, 60, 20) == pytest.approx(0.01)
    assert learning_rate(99, 60, 20) == learning_rate(5000, 20, 20) == 1.0
    assert learning_rate(5000, 10, 20) == pytest.approx(0.51)
    assert learning_rate(5000, 0, 20) == pytest.approx(0.02)
    assert learning_rate(5000, 0, 0) == 1.0


def test_the_text_begins_with_clips_of_one_object() -> None:
    assert [most_objects(m, 40, 30) for m in (0, 39, 40, 49, 50, 60, 69)] == [6, 6, 1, 1, 2, 3, 3]
    assert most_objects(70, 40, 30) == most_objects(40, 40, 0) == 6
