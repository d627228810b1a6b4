from dataclasses import replace

import numpy as np
import pytest
from sampled_scenes import COUNTS, SCHEDULE, distribution, draw, filters

from pipeline.clips.draw import draw_clips
from pipeline.clips.view import areas_px, frame_masks
from pipeline.errors import DynamicsError
from pipeline.physics.overlap import penetration
from pipeline.physics.simulate import simulate
from pipeline.vision.rendering.camera import pinhole, project


def seed_of(rng: np.random.Generator) -> int:
    return int(rng.integers(2**31))


def test_a_clips_scene_is_the_same_whatever_the_other_clips_are(rng: np.random.Generator) -> None:
    seed = seed_of(rng)
    together = draw(seed, range(8)).scenes
    assert draw(seed, range(4, 8)).scenes == together[4:]
    assert draw(seed, [6, 2]).scenes == [together[6], together[2]]
    assert draw(seed, [5]).scenes == [together[5]]


def test_seeds_and_suites_give_different_scenes(rng: np.random.Generator) -> None:
    seed = seed_of(rng)
    mine = draw(seed, range(3)).scenes
    assert draw(seed + 1, range(3)).scenes != mine
    other = draw_clips(seed, "another", range(3), distribution(), filters(), SCHEDULE, COUNTS).scenes
    assert other != mine


def test_what_is_accepted_passes_the_filters(rng: np.random.Generator) -> None:
    """Measured again at 480x320 and with the scene's own simulation; the filters look at 120x80."""
    f = filters()
    for scene in draw(seed_of(rng), range(24)).scenes:
        assert penetration(scene) <= f.overlap_m
        areas = areas_px(frame_masks(scene, simulate(scene), SCHEDULE, 480, 320), len(scene.objects))
        assert areas[0].sum() > 0.93 * f.area_px
        unseen = (areas[SCHEDULE.pairs[:, 0]] < f.visible_px / 4).all(0).sum()
        assert unseen <= f.out_of_view


def test_the_outcomes_of_all_candidates_add_up(rng: np.random.Generator) -> None:
    drawn = draw(seed_of(rng), range(16))
    outcome = dict(drawn.outcome)
    assert outcome["accepted"] == len(drawn.scenes) == 16
    assert outcome.pop("candidates") == sum(outcome.values())
    assert set(outcome) <= {"accepted", "too small", "overlap", "out of view", "bad numbers"}
    assert len(drawn.bad) == outcome.get("bad numbers", 0)


def test_objects_are_listed_from_left_to_right_where_they_first_appear(rng: np.random.Generator) -> None:
    f = filters()
    for scene in draw(seed_of(rng), range(12), {3: 1.0}).scenes:
        assert scene.camera is not None
        assert [o.name for o in scene.objects] == [f"{o.shape}_{i}" for i, o in enumerate(scene.objects)]
        trace = simulate(scene)
        areas = areas_px(frame_masks(scene, trace, SCHEDULE, 120, 80), 3)[SCHEDULE.pairs[:, 0]]
        places = []
        for i in range(3):
            frames = np.flatnonzero(areas[:, i] >= f.visible_px)
            if not len(frames):
                places.append(np.inf)
                continue
            centre = trace.position[SCHEDULE.frame_steps[SCHEDULE.pairs[frames[0], 0]], i]
            places.append(project(centre, pinhole(scene.camera), 480, 320)[0][0])
        assert places == sorted(places)


def test_a_clip_that_no_candidate_fits_says_what_became_of_them(rng: np.random.Generator) -> None:
    impossible = replace(filters(), area_px=150000.0, tries=7)
    with pytest.raises(DynamicsError, match=r"test/3 \(box\): none of 7 candidates passes .*'too small': 7.*; widen"):
        draw_clips(seed_of(rng), "test", [3], distribution(), impossible, SCHEDULE, {1: 1.0}, only=["box"])
    hidden = replace(filters(), visible_px=1e6, out_of_view=0, tries=3)
    with pytest.raises(DynamicsError, match="none of 3 candidates"):
        draw_clips(seed_of(rng), "test", [0], distribution(), hidden, SCHEDULE, {1: 1.0})


def test_scenes_are_of_the_compositions_asked_for(rng: np.random.Generator) -> None:
    only = ["box+sphere+sphere", "cylinder"]
    scenes = draw_clips(seed_of(rng), "test", range(8), distribution(), filters(), SCHEDULE, {1: 1.0}, only=only).scenes
    assert {s.composition for s in scenes} <= set(only)
    without = ["box+box", "box+cylinder", "cylinder+cylinder", "cylinder+sphere", "sphere+sphere"]
    scenes = draw_clips(
        seed_of(rng), "test", range(4), distribution(), filters(), SCHEDULE, {2: 1.0}, (), without
    ).scenes
    assert {s.composition for s in scenes} == {"box+sphere"}
