"""An effect is named only if clips that were not fitted show it."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.filmed import shown_effects
from pipeline.filmed.shown_effects import discover_shown
from pipeline.filmed.unfitted import Unfitted

FRAMES = np.linspace(0.9, 0.6, 20)


def unfitted(change: np.ndarray) -> Unfitted:
    before, after = (SimpleNamespace(frame_iou=iou) for iou in (FRAMES, FRAMES + change))
    return Unfitted((before,), (after,))  # type: ignore[arg-type]


def found(named: Sequence[str], gain: float, held: tuple[str, ...] = ("clip_3",)) -> Any:
    none, answer = (SimpleNamespace(held_out=chi2, effects=tuple(named)) for chi2 in (100.0, 100.0 - gain))
    return SimpleNamespace(
        selection=SimpleNamespace(none=none), answer=answer, problem=SimpleNamespace(held_out=held), gain=gain
    )


def names_after(monkeypatch: pytest.MonkeyPatch, gain: float, change: np.ndarray, held: tuple[str, ...]) -> list[str]:
    """What is named of `drag`, whose forecasts are given, and of nothing."""

    def forecast(result: Any, _: Any) -> Unfitted:
        return unfitted(change if result.answer.effects else 0 * change)

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    motion: Any = None
    shown = discover_shown(motion, ["drag", "wind"], lambda left: found([n for n in left if n == "drag"], gain, held))
    assert len(shown.notes) == (shown.found.answer.effects == ())
    return list(shown.found.answer.effects)


@pytest.mark.parametrize(
    ("gain", "slope", "named"),
    [
        (50.0, 0.1, True),
        (0.0, 0.1, True),  # a rebound shows in the picture only
        (50.0, 0.0, True),
        (50.0, -0.1, False),
        (-50.0, 0.1, False),
        (0.0, 0.0, False),
    ],
)
def test_an_effect_is_named_if_something_speaks_for_it_and_nothing_against_it(
    monkeypatch: pytest.MonkeyPatch, gain: float, slope: float, named: bool
) -> None:
    change = slope * np.linspace(0, 1, len(FRAMES))
    assert names_after(monkeypatch, gain, change, ("clip_3",)) == (["drag"] if named else [])


def test_where_no_clip_is_held_out_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    assert names_after(monkeypatch, 0.0, np.zeros(20), ()) == ["drag"]


def test_frames_that_err_alike_count_as_few_and_white_noise_counts_in_full(rng: np.random.Generator) -> None:
    noise = rng.normal(0, 0.01, 400)
    slow = np.sin(np.linspace(0, 3, 400)) * 0.01
    assert unfitted(slow[:20] * 0).rise == (0.0, 0.0)
    mean, error = _rise(noise)
    assert abs(mean) < 5 * error and error == pytest.approx(0.01 / 20, rel=0.3)
    assert _rise(slow)[1] > 0.3 * slow.std()


def _rise(change: np.ndarray) -> tuple[float, float]:
    before, after = (SimpleNamespace(frame_iou=iou) for iou in (np.zeros(len(change)), change))
    return Unfitted((before,), (after,)).rise  # type: ignore[arg-type]
