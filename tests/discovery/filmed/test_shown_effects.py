"""An effect is named only if clips that were not fitted show it."""

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.discovery.filmed import shown_effects
from pipeline.discovery.filmed.shown_effects import discover_shown
from pipeline.discovery.filmed.unfitted import LEAST_ERROR, Unfitted
from pipeline.discovery.selection import established

SCORES = {"drag": 50.0, "wind": 100.0, "tilt": 400.0}
FRAMES = np.linspace(0.9, 0.6, 20)


def unfitted(change: np.ndarray) -> Unfitted:
    before, after = (SimpleNamespace(frame_iou=iou) for iou in (FRAMES, FRAMES + change))
    return Unfitted((before,), (after,))  # type: ignore[arg-type]


@pytest.fixture(autouse=True)
def models(monkeypatch: pytest.MonkeyPatch) -> None:
    """What a model leaves of the gap: what it says itself, or little where it has effects. None has a simpler one."""

    def gap(_: Any, model: Any) -> float:
        return float(getattr(model, "left", 0.2 if model.effects else 1.0))

    monkeypatch.setattr(established, "left_of_gap", gap)
    monkeypatch.setattr(shown_effects, "shorter_selections", lambda _: {})
    monkeypatch.setattr(shown_effects, "simpler_selection", lambda selection: selection)
    monkeypatch.setattr(shown_effects, "discovery_of", lambda selection: result(selection.chosen, selection.singles))


def result(chosen: Any, singles: Sequence[Any] = ()) -> Any:
    """The discovery that chooses a model."""
    none = SimpleNamespace(effects=(), held_out=100.0, score=500.0)
    selection = SimpleNamespace(none=none, chosen=chosen, answer=chosen, singles=singles, measured=None, baseline=none)
    return SimpleNamespace(selection=selection, answer=chosen, problem=SimpleNamespace(held_out=("clip_3",)))


def found(named: Sequence[str], gain: float, held: tuple[str, ...] = ("clip_3",), left: float = 0.2) -> Any:
    none = SimpleNamespace(held_out=100.0, effects=(), score=500.0)
    score = SCORES[named[0]] if named else 500.0
    answer = SimpleNamespace(held_out=100.0 - gain, effects=tuple(named), score=score, left=left if named else 1.0)
    return SimpleNamespace(
        selection=SimpleNamespace(none=none, answer=answer, singles=()),
        answer=answer,
        problem=SimpleNamespace(held_out=held),
    )


def names_after(
    monkeypatch: pytest.MonkeyPatch, gain: float, change: np.ndarray, held: tuple[str, ...], left: float = 0.2
) -> list[str]:
    """What is named of `drag`, whose forecasts and share of the gap that it leaves are given, and of nothing."""

    def forecast(selection: Any, _: Any, __: Any = None) -> Unfitted:
        return unfitted(change if selection.answer.effects else 0 * change)

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    motion: Any = None
    shown = discover_shown(
        motion, ["drag", "wind"], lambda names: found([n for n in names if n == "drag"], gain, held, left)
    )
    assert len(shown.notes) == (shown.found.answer.effects == ())
    return list(shown.found.answer.effects)


@pytest.mark.parametrize(
    ("gain", "slope", "left", "named"),
    [
        (50.0, 0.1, 0.2, True),
        (0.0, 0.1, 1.0, True),  # a rebound shows in the picture only
        (50.0, 0.1, 0.6, True),
        (50.0, 0.04, 0.2, False),  # the gap shrinks, but IoU rises by no more than what masks err by
        (50.0, -0.1, 0.2, False),
        (-50.0, 0.1, 0.2, False),
        (0.0, 0.0, 0.2, False),
    ],
)
def test_an_effect_is_named_if_something_speaks_for_it_and_nothing_against_it(
    monkeypatch: pytest.MonkeyPatch, gain: float, slope: float, left: float, named: bool
) -> None:
    change = slope * np.linspace(0, 1, len(FRAMES))
    assert names_after(monkeypatch, gain, change, ("clip_3",), left) == (["drag"] if named else [])


def test_where_no_clip_is_held_out_nothing_is_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    assert names_after(monkeypatch, 0.0, np.zeros(20), ()) == ["drag"]


@pytest.mark.parametrize(
    ("slope", "left_mm", "named"),
    [(0.1, 3.0, ["drag", "wind"]), (-0.1, 3.0, ["drag"]), (0.0, 3.0, ["drag"]), (0.1, 1.2, ["drag"])],
)
def test_of_two_effects_each_has_to_be_shown_beside_the_other(
    monkeypatch: pytest.MonkeyPatch, slope: float, left_mm: float, named: list[str]
) -> None:
    """wind is shown beside drag only where the slope is upwards, and drag alone leaves more than noise (1 mm)."""
    one, both = (
        SimpleNamespace(effects=effects, held_out=50.0, score=50.0) for effects in (("drag",), ("drag", "wind"))
    )

    def forecast(found: Any, _: Any, before: Any = None) -> Unfitted:
        beside = before is not None and before.effects == ("drag",)
        return unfitted((slope if beside else 0.2) * np.linspace(0.5, 1, len(FRAMES)))

    def shorter(selection: Any) -> dict[str, Any]:
        return {"wind": result(one).selection} if selection.chosen is both else {}

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    monkeypatch.setattr(shown_effects, "shorter_selections", shorter)
    monkeypatch.setattr(shown_effects, "leaves_noise", lambda *_: left_mm < 1.5)
    motion: Any = None
    shown = discover_shown(motion, ["drag", "wind"], lambda _: result(both))
    assert list(shown.found.answer.effects) == named
    assert len(shown.notes) == 2 - len(named)


@pytest.mark.parametrize(("second", "named"), [("wind", ["wind"]), ("tilt", [])])
def test_what_is_named_instead_of_a_dropped_effect_has_to_explain_half_as_much(
    monkeypatch: pytest.MonkeyPatch, second: str, named: list[str]
) -> None:
    def forecast(selection: Any, _: Any, __: Any = None) -> Unfitted:
        return unfitted((-0.1 if "drag" in selection.answer.effects else 0.1) * np.linspace(0.5, 1, len(FRAMES)))

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    motion: Any = None
    shown = discover_shown(motion, ["drag", second], lambda left: found(left[:1], 50.0))
    assert list(shown.found.answer.effects) == named


@pytest.mark.parametrize(
    ("score", "rise", "left", "named"),
    [
        (110.0, 0.05, 1.0, "wind"),
        (110.0, -0.05, 1.0, "drag"),
        (130.0, 0.05, 1.0, "drag"),  # fits much worse
        (110.0, 0.05, 0.2, "drag"),  # the gap shows drag
    ],
)
def test_where_the_gap_shows_nothing_forecasts_decide_between_effects_that_fit_alike(
    monkeypatch: pytest.MonkeyPatch, score: float, rise: float, left: float, named: str
) -> None:
    def model(name: str, score: float) -> Any:
        return SimpleNamespace(effects=(name,), name=name, score=score, held_out=50.0, left=left, parameters=9)

    drag, wind = model("drag", 100.0), model("wind", score)

    def forecast(_: Any, __: Any, before: Any = None) -> Unfitted:
        return unfitted((rise if before is drag else 0.2) * np.linspace(0.5, 1, len(FRAMES)))

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    monkeypatch.setattr(shown_effects, "with_single", lambda _, rival: result(rival, (drag, wind)).selection)
    motion: Any = None
    shown = discover_shown(motion, ["drag", "wind"], lambda _: result(drag, (drag, wind)))
    assert shown.found.answer.effects == (named,)
    assert len(shown.notes) == (named == "wind")


@pytest.mark.parametrize(("rise", "named"), [(0.05, "tilt"), (-0.02, "tilt"), (-0.05, "wind")])
def test_an_effect_of_fewer_numbers_is_named_instead_if_it_does_not_forecast_worse(
    monkeypatch: pytest.MonkeyPatch, rise: float, named: str
) -> None:
    wind, tilt = (SimpleNamespace(effects=(n,), name=n, score=100.0, held_out=50.0, left=0.2) for n in ("wind", "tilt"))

    def forecast(_: Any, __: Any, before: Any = None) -> Unfitted:
        return unfitted((rise if before is wind else 0.2) * np.linspace(0.5, 1, len(FRAMES)))

    monkeypatch.setattr(shown_effects, "forecast_unfitted", forecast)
    monkeypatch.setattr(shown_effects, "simpler_selection", lambda _: result(tilt, (wind, tilt)).selection)
    motion: Any = None
    shown = discover_shown(motion, ["wind", "tilt"], lambda _: result(wind, (wind, tilt)))
    assert shown.found.answer.effects == (named,)
    assert len(shown.notes) == (named == "tilt")


@pytest.mark.parametrize(("left", "named"), [(0.2, ["drag"]), (0.6, [])])
def test_where_no_clip_can_be_forecast_the_gap_has_to_be_halved(
    monkeypatch: pytest.MonkeyPatch, left: float, named: list[str]
) -> None:
    monkeypatch.setattr(shown_effects, "forecast_unfitted", lambda *_: Unfitted((), ()))
    motion: Any = None
    shown = discover_shown(motion, ["drag"], lambda names: found(names, 50.0, left=left))
    assert list(shown.found.answer.effects) == named


def test_frames_that_err_alike_count_as_few_and_white_noise_counts_in_full(rng: np.random.Generator) -> None:
    noise = rng.normal(0, 1.0, 400)
    slow = np.sin(np.linspace(0, 3, 400))
    assert unfitted(slow[:20] * 0).rise == (0.0, LEAST_ERROR)
    mean, error = _rise(noise)
    assert abs(mean) < 5 * error and error == pytest.approx(1 / 20, rel=0.3)
    assert _rise(slow)[1] > 0.3 * slow.std()


def _rise(change: np.ndarray) -> tuple[float, float]:
    before, after = (SimpleNamespace(frame_iou=iou) for iou in (np.zeros(len(change)), change))
    return Unfitted((before,), (after,)).rise  # type: ignore[arg-type]
