"""Laws of edited pictures: what is not edited stays, what is made anew looks as filmed, what is removed is gone."""

import filmed
import numpy as np
import small_clip

from pipeline.clips.replay import replay
from pipeline.editing.compose import EditedFrames, compose
from pipeline.editing.edit_list import Edit
from pipeline.editing.edited_motion import run_edits
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import Appearance, plain_appearance
from pipeline.vision.rendering.render import render_rgb


def edited(*edits: Edit) -> EditedFrames:
    made = run_edits(small_clip.scene(), filmed.motion()[1], edits, filmed.TIMES)
    rng = np.random.default_rng(0)
    return compose(filmed.clip(), filmed.layers(), made.motion, made.origin, made.first, rng)


def rendered(scene: Scene, appearance: Appearance) -> tuple[np.ndarray, np.ndarray]:
    """Frames and masks of a scene, as the small clip is made."""
    run = replay(scene, small_clip.SCHEDULE, small_clip.WIDTH, small_clip.HEIGHT)
    size = small_clip.WIDTH, small_clip.HEIGHT
    return render_rgb(scene, run.position, run.quaternion, appearance, *size, "raycast"), run.masks


def test_an_edit_that_changes_nothing_leaves_every_pixel() -> None:
    same = edited(Edit(0.0, set="gravity=9.81"))
    np.testing.assert_array_equal(same.frames, filmed.clip().frames)
    assert same.bodies == (1, 0, 0)


def test_a_clip_that_is_made_anew_from_its_layers_looks_as_filmed() -> None:
    motion, rng = filmed.motion()[0], np.random.default_rng(0)
    made = compose(filmed.clip(), filmed.layers(), motion, (0, 1), 0, rng, redraw=True)
    frames, inside = filmed.clip().frames, filmed.clip().masks > 0
    assert filmed.psnr(made.frames, frames, np.ones_like(inside)) >= 30
    assert filmed.psnr(made.frames, frames, inside) >= 24
    assert sum(made.bodies) == 1
    assert ((made.ids > 0) != inside).sum() <= 0.03 * inside.sum()  # half-covered pixels at the edges


def test_where_a_body_was_removed_the_clip_shows_what_is_behind_it() -> None:
    scene = small_clip.scene()
    look = plain_appearance(2)
    alone = Scene(scene.objects[:1], scene.camera, scene.gravity, scene.ground)
    true, _ = rendered(alone, Appearance(look.materials[:1], look.floor, look.backdrop, look.lights))
    gone = edited(Edit(0.0, remove="crate"))
    where = filmed.clip().masks == 2
    assert filmed.psnr(gone.frames, true, where) >= 26
    assert filmed.psnr(filmed.clip().frames, true, where) < 20
    assert not (gone.ids == 2).any()


def test_an_edited_clip_is_nearer_to_the_true_one_than_the_clip_as_it_was() -> None:
    scene = small_clip.scene()
    edit = Edit(0.0, set="objects[crate].velocity=[-0.9, 0.0, 1.5]")
    made = edited(edit)
    run = run_edits(scene, filmed.motion()[1], [edit], filmed.TIMES)
    true, masks = rendered(run.scene, plain_appearance(2))
    both = (masks == 2) | (filmed.clip().masks == 2)
    assert filmed.psnr(made.frames, true, both) >= filmed.psnr(filmed.clip().frames, true, both) + 6
    overlap = (made.ids == 2) & (masks == 2)
    assert overlap.sum() >= 0.9 * ((made.ids == 2) | (masks == 2)).sum()


def test_frames_before_the_edit_are_the_clips() -> None:
    made = edited(Edit(0.5, remove="ball"))
    np.testing.assert_array_equal(made.frames[:15], filmed.clip().frames[:15])
    assert (made.frames[15] != filmed.clip().frames[15]).any()
