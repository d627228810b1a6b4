"""The background plate where the ground is only ever seen in shadow."""

import numpy as np

from pipeline.editing.plate import INVENTED, REPAIRED, Plate, find_plate

HEIGHT, WIDTH, FRAMES = 60, 80, 5
BODY, SHADOW = np.s_[20:40, 30:50], np.s_[40:46, 30:50]  # the body rests: nothing of this is ever seen lit


def plate_of(floor: np.ndarray, share: float, said: float) -> Plate:
    """Of a body at rest whose shadow leaves `share` of the light, where the lights that were found say `said`."""
    frame = floor.copy()
    frame[SHADOW] *= share
    frame[BODY] = (200, 0, 0)
    frames = np.repeat(frame[None].astype(np.uint8), FRAMES, 0)
    covered, ratio = np.zeros(frames.shape[:3], bool), np.ones(frames.shape[:3], np.float32)
    covered[:, *BODY], ratio[:, *SHADOW] = True, said
    return find_plate(frames, covered, ratio)


def test_a_shadow_that_the_lights_explain_is_taken_from_the_floor() -> None:
    made = plate_of(np.full((HEIGHT, WIDTH, 3), 180.0), 0.5, 0.5)
    assert (made.kind[SHADOW] == REPAIRED).all()
    assert np.abs(made.colour - 180).max() < 5


def test_a_darker_shadow_than_the_lights_explain_is_painted_over() -> None:
    made = plate_of(np.full((HEIGHT, WIDTH, 3), 180.0), 0.4, 0.9)
    assert (made.kind[SHADOW] == INVENTED).all()
    assert np.abs(made.colour - 180).max() < 5


def test_a_textured_floor_keeps_what_was_seen_of_it_in_shadow() -> None:
    rows, cols = np.mgrid[:HEIGHT, :WIDTH]
    floor = np.repeat(np.where((rows // 3 + cols // 3) % 2, 200.0, 60.0)[..., None], 3, -1)
    made = plate_of(floor, 0.5, 0.5)
    assert (made.kind[SHADOW] == REPAIRED).all()
    assert np.abs(made.colour[SHADOW] - floor[SHADOW]).max() < 3
