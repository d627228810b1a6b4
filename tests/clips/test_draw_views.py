"""Sampled views are reproducible, free of overlap, in view and in motion."""

from collections import Counter

import numpy as np
import pytest

from pipeline.clips.draw_views import LEAST_SHARE, VIEW_FILTERS, draw_view_clips, view_kind
from pipeline.clips.replay import replay
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import areas_px
from pipeline.physics.overlap import penetration
from pipeline.scene.sample_views import VIEWS, draw_view_scene
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene, write_scene
from pipeline.vision.rendering.camera import pinhole

SCHEDULE = Schedule()


@pytest.fixture(scope="module")
def clips() -> list[Scene]:
    return draw_view_clips(7, "views", range(20), SCHEDULE).scenes


def test_a_clip_depends_on_its_index_alone(clips: list[Scene]) -> None:
    assert draw_view_clips(7, "views", [13, 4], SCHEDULE).scenes == [clips[13], clips[4]]
    assert draw_view_clips(8, "views", [4], SCHEDULE).scenes != [clips[4]]


def test_the_kinds_alternate_and_look_as_they_are_called(clips: list[Scene]) -> None:
    assert Counter(map(view_kind, range(20))) == dict.fromkeys(VIEWS, 4)
    for index, scene in enumerate(clips):
        assert scene.camera is not None
        ahead = -pinhole(scene.camera).rotation_world[:, 2]
        kind = view_kind(index)
        if kind == "top":
            assert ahead[2] < -0.99
        if kind == "side":
            assert abs(ahead[2]) < 0.25
        if kind == "flight":
            assert scene.ground is None
        if kind == "incline":
            (ramp,) = scene.fixed
            turn = np.array(ramp.orientation)
            tilt = 2 * np.degrees(np.arccos(turn[0]))
            assert 7.9 < tilt < 35.1


def test_every_clip_is_stable_in_view_and_reads_back_from_its_text(clips: list[Scene]) -> None:
    for scene in clips:
        assert read_scene(write_scene(scene)) == scene
        assert penetration(scene) <= 0
        run = replay(scene, SCHEDULE, 240, 160)
        seen = areas_px(run.masks, len(scene.objects)) > VIEW_FILTERS.visible_px / 2
        assert (seen.mean(0) > LEAST_SHARE / 2).all()
        assert np.ptp(run.position, axis=0).max() > 0.03


def test_fixed_bodies_and_hollow_ones_are_frequent(rng: np.random.Generator) -> None:
    drawn = [draw_view_scene(rng, kind) for kind in VIEWS for _ in range(40)]
    assert sum(bool(s.fixed) for s in drawn) > 50
    assert sum(any(o.hollow for o in s.objects) for s in drawn) > 20
    assert all(abs(s.gravity[2] + 9.81) < 1e-9 for s in drawn)
