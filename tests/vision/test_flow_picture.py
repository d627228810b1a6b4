"""Laws of the pictures of flow."""

import colorsys

import numpy as np
import pytest

from pipeline.vision.flow.flow_picture import MAX_PX, flow_picture, scaled_max_px, wheel


def random_flow(rng, longest=MAX_PX):
    angle, length = rng.uniform(0, 2 * np.pi, (3, 40, 50)), longest * rng.random((3, 40, 50)) ** 2
    return np.stack([length * np.cos(angle), length * np.sin(angle)], axis=-1).astype(np.float32)


def test_channels_are_read_back_to_half_a_step(rng):
    flow = random_flow(rng)
    signed = (flow_picture(flow, "channels")[..., :2].astype(np.float32) - 128) / 127
    back = np.sign(signed) * signed**2 * MAX_PX
    root = np.sqrt(np.abs(flow) / MAX_PX)
    step = MAX_PX * ((root + 0.5 / 127) ** 2 - root**2)  # what half a step of the root is in px
    assert (np.abs(back - flow) <= step + 1e-4).all()


@pytest.mark.parametrize("kind", ["wheel", "channels"])
def test_no_flow_is_one_colour_and_so_is_nan(kind):
    still, unknown = np.zeros((1, 4, 5, 2)), np.full((1, 4, 5, 2), np.nan)
    picture = flow_picture(still, kind)
    assert (picture == {"wheel": [255, 255, 255], "channels": [128, 128, 0]}[kind]).all()
    assert np.array_equal(picture, flow_picture(unknown, kind))


def test_opposite_flows_are_mirrored_about_128(rng):
    flow = random_flow(rng)
    ahead, back = flow_picture(flow).astype(int), flow_picture(-flow).astype(int)
    assert np.abs(ahead[..., :2] + back[..., :2] - 256).max() <= 1  # rounding to even
    assert np.array_equal(ahead[..., 2], back[..., 2])


def test_longer_flows_saturate(rng):
    flow = np.array([[[MAX_PX, 0.0]]])
    assert np.array_equal(flow_picture(flow), flow_picture(5 * flow))
    assert flow_picture(flow)[0, 0].tolist() == [255, 128, 255]


def test_the_same_motion_gives_the_same_picture_at_every_size(rng):
    flow = random_flow(rng)
    assert np.array_equal(flow_picture(flow, max_px=MAX_PX), flow_picture(flow / 4, max_px=scaled_max_px(120)))


def test_the_wheel_tells_direction_by_hue_and_speed_by_saturation(rng):
    angles = np.linspace(-np.pi, np.pi, 24, endpoint=False)
    colours = []
    for share in (0.25, 0.5, 0.99):
        flow = share * MAX_PX * np.stack([np.cos(angles), np.sin(angles)], axis=-1)[None]
        rgb = flow_picture(flow, "wheel")[0] / 255
        colours.append([colorsys.rgb_to_hsv(*c) for c in rgb])
    hue, saturation = np.array(colours)[..., 0], np.array(colours)[..., 1]
    turned = np.angle(np.exp(2j * np.pi * (hue - hue[2])))
    assert np.abs(turned).max() < 0.15
    assert (np.diff(saturation, axis=0) > 0.1).all()
    assert len({tuple(np.round(c, 2)) for c in colours[2]}) == 24


def test_the_wheel_has_middleburys_55_colours():
    colours = wheel()
    assert colours.shape == (55, 3)
    assert colours[0].tolist() == [255, 0, 0]
    assert colours[15].tolist() == [255, 255, 0]
    assert colours[25].tolist() == [0, 255, 255]


def test_an_unknown_kind_is_refused():
    with pytest.raises(ValueError, match=r"'hsv'.*wheel, channels"):
        flow_picture(np.zeros((2, 2, 2)), "hsv")
