"""What is named beside a remainder, from models whose gaps are given."""

from types import SimpleNamespace
from typing import Any

import pytest

from pipeline.discovery.selection import established


def model(*effects: str, left: float, parameters: int = 1) -> Any:
    return SimpleNamespace(effects=effects, name=effects[0], left=left, parameters=parameters)


FOUND: Any = SimpleNamespace(calibration=None)


@pytest.fixture(autouse=True)
def _given_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(established, "left_of_gap", lambda found, candidate: candidate.left)
    monkeypatch.setattr(established, "_harms_a_body", lambda found, longer, shorter: False)
    monkeypatch.setattr(established, "excess", lambda calibration, candidate: (100.0 * candidate.left, 0.0))


def test_a_law_with_more_numbers_has_to_leave_a_quarter() -> None:
    drag = model("air_drag", left=0.4)
    for left, best in ((0.11, "air_drag"), (0.09, "wind")):
        wind = model("wind", left=left, parameters=4)
        assert established._simplest([wind, drag], FOUND).effects == (best,)


def test_unknown_spins_of_flights_count_as_numbers() -> None:
    lift, tilt = model("magnus_lift", left=0.3, parameters=36), model("tilted_gravity", left=0.4, parameters=2)
    assert established._simplest([lift, tilt], FOUND).effects == ("tilted_gravity",)


@pytest.mark.parametrize(("left", "part"), [(0.3, True), (0.04, False)])
def test_what_four_effects_explain_nearly_as_well_is_part_of_the_remainder(left: float, part: bool) -> None:
    names = ("wind", "hidden_attractor", "gravity_error", "impulse")
    rivals = [model("air_drag", name, left=left * (1 + 0.1 * i)) for i, name in enumerate(names)]
    assert established._is_part_of_remainder(FOUND, rivals[0], rivals) == part  # below 0.05 the model explains all
    assert not established._is_part_of_remainder(FOUND, rivals[0], rivals[:3])
    rivals[3].left = 2 * left
    assert not established._is_part_of_remainder(FOUND, rivals[0], rivals)


@pytest.mark.parametrize(("left", "named"), [(0.3, True), (0.6, False)])
def test_two_effects_win_over_one_with_more_numbers_if_both_are_established(
    monkeypatch: pytest.MonkeyPatch, left: float, named: bool
) -> None:
    drag, tilt, wind = (
        model("air_drag", left=0.9),
        model("tilted_gravity", left=1.0),
        model("wind", left=0.4, parameters=4),
    )
    pair = model("air_drag", "tilted_gravity", left=left, parameters=3)
    found: Any = SimpleNamespace(calibration=None, none=None, singles=(drag, tilt, wind), tried=(pair,))
    monkeypatch.setattr(established, "_shows", lambda longer, shorter: True)
    assert established._is_simpler(found, pair, wind) == named
    assert not established._is_simpler(found, pair, pair)
    fewer = model("wind", left=2 * left)
    assert not established._is_simpler(found, pair, fewer)  # it would have to leave a quarter
