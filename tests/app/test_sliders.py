"""Sliders and the edits that they stand for."""

import math
from dataclasses import replace

import pytest
import small_clip

from pipeline.app.live_replay import LiveScene
from pipeline.app.sliders import edits_of, read_changes, sliders_of
from pipeline.errors import SceneError
from pipeline.scene.edited import edited


def changed(changes: dict):
    scene = small_clip.scene()
    return edited(scene, edits_of(scene, read_changes(changes)))


def test_without_a_change_there_is_no_edit() -> None:
    assert edits_of(small_clip.scene(), read_changes({})) == []
    assert edits_of(small_clip.scene(), read_changes({"objects": {"ball": {}}})) == []


def test_factors_are_of_what_was_found() -> None:
    scene = changed({"objects": {"crate": {"mass": 3, "friction": 0.1, "damping": 0.4, "speed": 2}}})
    crate = scene.objects[1]
    assert (crate.mass, crate.sliding_friction, crate.damping, crate.velocity) == (1.5, 0.1, 0.4, (-0.8, 0, 0))
    assert scene.objects[0] == small_clip.scene().objects[0]


def test_the_heading_turns_the_velocity_about_the_vertical() -> None:
    ball = changed({"objects": {"ball": {"heading": 90}}}).objects[0]
    assert ball.velocity == pytest.approx((0, 1, 0), abs=1e-6)


def test_gravity_keeps_its_direction() -> None:
    tilted = replace(small_clip.scene(), gravity=(3.0, 0.0, -4.0))
    after = edited(tilted, edits_of(tilted, read_changes({"gravity": 10})))
    assert after.gravity == pytest.approx((6, 0, -8))
    assert changed({"gravity": 0}).gravity == (0, 0, 0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"gravity": 1e9}, "gravity: input should be less"),
        ({"gravity": math.nan}, "gravity: input should be a finite"),
        ({"objects": {"ball": {"mass": 0}}}, "objects.ball.mass: input should be greater"),
        ({"objects": {"ball": {"colour": 1}}}, "objects.ball.colour: extra"),
        ([], "changes: input should be"),
    ],
)
def test_what_no_slider_can_say_is_refused(changes, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        read_changes(changes)


def test_an_object_that_is_not_there_is_refused() -> None:
    with pytest.raises(SceneError, match="valid: ball, crate"):
        edits_of(small_clip.scene(), read_changes({"objects": {"bal": {"mass": 2}}}))


def test_every_slider_starts_within_its_range() -> None:
    for obj in small_clip.scene().objects:
        for slider in sliders_of(obj):
            assert slider.low <= slider.value <= slider.high


def test_a_live_replay_shows_the_bodies_where_they_are_and_the_found_motion_as_ghosts() -> None:
    live = LiveScene.of(small_clip.scene(), small_clip.SCHEDULE, (480, 320))
    told = live.replay(read_changes({"gravity": 2}))
    assert (told["width"], told["height"], told["edits"]) == (240, 160, ["gravity=[0, 0, -2]"])
    assert [b["ghost"] for b in told["motion"]["bodies"]] == [False, False, True, True]
    assert [b["ghost"] for b in live.replay(read_changes({}))["motion"]["bodies"]] == [False, False]
    pictures = live.pictures(live.scene, live.trace)
    away = (pictures != live.backdrop).any(-1)
    masks = small_clip.masks() > 0
    assert (away & masks).sum() > 0.97 * masks.sum()
    assert (away & ~masks).sum() < 0.03 * masks.sum()
