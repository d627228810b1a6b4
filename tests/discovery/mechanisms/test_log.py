"""The log of a mechanism: its columns are named as in the model, and what does not fit is one error."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from small_mechanism import CART

from pipeline.discovery.mechanisms.log import Log, Quantity, read_log
from pipeline.discovery.mechanisms.mechanism import Mechanism, read_mechanism
from pipeline.discovery.mechanisms.noise import channel_noise
from pipeline.errors import MeasurementError


@pytest.fixture
def cart(tmp_path: Path) -> Mechanism:
    path = tmp_path / "cart.xml"
    path.write_text(CART)
    return read_mechanism(path)


def read(cart: Mechanism, **columns: object) -> Log:
    path = cart.path.with_name("log.csv")
    pd.DataFrame(columns).to_csv(path, index=False)
    return read_log(path, cart)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("log.csv", "\ufefftime;slide;clip\n0,0;0,5;a\n0,1;0,6;a\n0,2;;a\n0,3;0,8;a\n0,4;0,9;a\n"),
        ("log.txt", "% clip time slide\n0 0.0 0.5\n0 0.1 0.6\n0 0.2 nan\n0 0.3 0.8\n0 0.4 0.9\n"),
        ("log.tsv", "time\tslide\n0.0\t0.5\n0.1\t0.6\n0.2\t\n0.3\t0.8\n0.4\t0.9\n"),
    ],
)
def test_texts_with_other_separators_are_read_and_what_was_assumed_is_said(
    cart: Mechanism, name: str, text: str
) -> None:
    path = cart.path.with_name(name)
    path.write_text(text, encoding="utf-8")
    log = read_log(path, cart)
    (clip,) = log.clips
    np.testing.assert_allclose(clip.time, [0, 0.1, 0.2, 0.3, 0.4])
    np.testing.assert_allclose(clip.values[:, 0], [0.5, 0.6, np.nan, 0.8, 0.9])
    assert "read as text with" in log.notes[0]


def test_a_text_whose_columns_have_no_names_is_one_error(cart: Mechanism) -> None:
    path = cart.path.with_name("log.txt")
    path.write_text("% slide velocity\n0 0.0 0.5 1.0\n0 0.1 0.6 1.0\n")
    with pytest.raises(MeasurementError, match="2 names for 4 columns; needed: a name for each"):
        read_log(path, cart)


TIME = np.array([0.0, 0.1, 0.25, 0.3, 0.42, 0.5])
X = np.array([0.0, 0.1, np.nan, 0.2, 0.1, 0.0])


def test_columns_are_joints_rates_places_and_controls(cart: Mechanism) -> None:
    log = read(cart, time=TIME, slide=X, slide_velocity=X, cart_x=X, push=[1.0, np.nan, 2, 2, np.nan, 3])
    assert [(c.quantity, c.name, c.unit) for c in log.channels] == [
        (Quantity.JOINT, "slide", "m"),
        (Quantity.VELOCITY, "slide", "m/s"),
        (Quantity.BODY, "cart", "m"),
    ]
    (clip,) = log.clips
    assert clip.controls[:, 0].tolist() == [1, 1, 2, 2, 2, 3]  # held until the next row
    assert np.isnan(clip.values[2]).all() and log.driven == ("push",)


@pytest.mark.parametrize(
    ("columns", "says"),
    [
        ({"slide": X}, "no column 'time'"),
        ({"time": TIME}, "no measured column"),
        ({"time": TIME, "slid": X}, "did you mean 'slide'"),
        ({"time": TIME, "slide": ["a", *X[1:]]}, "row 1.*not a number"),
        ({"time": TIME[::-1], "slide": X}, "row 2.*does not increase"),
        ({"time": [0, 0, 1, 2, 3, 4], "slide": X}, "does not increase"),
        ({"time": TIME[:3], "slide": X[:3]}, "at least 5"),
        ({"time": TIME, "slide": X * np.nan}, "missing"),
        ({"time": TIME, "slide": X * 0 + 1.0}, "nothing moves"),
        ({"time": [np.nan, *TIME[1:]], "slide": X}, "row 1: no time"),
        ({"time": TIME, "slide": X, "sigma": -1.0}, "sigma"),
        ({"clip": ["a"] * 5 + [None], "time": TIME, "slide": X}, "row 6: no clip"),
    ],
)
def test_what_does_not_fit_is_one_error(cart: Mechanism, columns: dict[str, object], says: str) -> None:
    with pytest.raises(MeasurementError, match=says):
        read(cart, **columns)


def test_the_noise_of_a_smooth_motion_is_found_at_irregular_times(cart: Mechanism) -> None:
    rng = np.random.default_rng(0)
    time = np.cumsum(rng.uniform(0.01, 0.03, 2000))
    log = read(cart, time=time, slide=np.sin(3 * time) + rng.normal(0, 1e-3, 2000))
    assert channel_noise(log)[0] == pytest.approx(1e-3, rel=0.15)
