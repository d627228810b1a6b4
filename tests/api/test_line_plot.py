"""Laws of the plots that `dynamics infer` draws."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.api.line_plot import MOST_TICKS, Panel, Series, draw_panels, extent, ticks

numbers = st.floats(-1e6, 1e6, allow_nan=False)


@given(low=numbers, length=st.floats(1e-3, 1e6))
def test_ticks_are_few_lie_in_the_range_and_say_where_they_are(low: float, length: float) -> None:
    marks = ticks(low, low + length)
    assert 1 <= len(marks) <= MOST_TICKS + 1
    for value, text in marks:
        assert low - 1e-6 * length <= value <= low + length * (1 + 1e-6)
        assert abs(float(text) - value) <= 1e-6 * length + 1e-9 * abs(value)


@given(values=st.lists(numbers | st.just(float("nan")), max_size=8), least=st.floats(0, 10))
def test_an_axis_shows_all_values_and_is_never_empty(values: list[float], least: float) -> None:
    low, high = extent([np.array(values)], least)
    known = np.array(values)[np.isfinite(values)]
    assert high > low
    assert high - low >= least * (1 - 1e-6)
    assert (known >= low).all() and (known <= high).all()


def test_a_line_is_drawn_in_its_colour_and_not_where_values_are_missing() -> None:
    x = np.linspace(0, 1, 41)
    y = np.where((x > 0.4) & (x < 0.6), np.nan, 0.0)
    picture = draw_panels([Panel("x, m", (Series(x, y, (255, 0, 0), False),), 1.0)], "", [], "time, s")
    columns = np.flatnonzero((picture[..., 0] > picture[..., 1].astype(int) + 100).any(0))
    assert len(columns) > 300
    assert np.diff(columns).max() > 100
