"""Laws of the edited motion: it is the clip's until the first edit, and MuJoCo's of the edited scene from then on."""

from dataclasses import replace

import filmed
import numpy as np
import pytest
import small_clip

from pipeline.editing.edit_list import Edit
from pipeline.editing.edited_motion import EditedMotion, run_edits
from pipeline.errors import SceneError
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import frame_steps

BALL = {
    "shape": "sphere",
    "radius": 0.05,
    "mass": 0.1,
    "sliding_friction": 0.5,
    "rolling_friction": 0.0,
    "damping": 1.0,
    "position": [0.0, 0.5, 0.6],
    "velocity": [0.0, 0.0, 0.0],
    "angular_velocity": [0.0, 0.0, 0.0],
    "orientation": [1.0, 0.0, 0.0, 0.0],
}


def run(*edits: Edit) -> EditedMotion:
    return run_edits(small_clip.scene(), filmed.motion()[1], edits, filmed.TIMES)


def test_without_edits_the_motion_is_the_clips() -> None:
    made = run()
    np.testing.assert_array_equal(made.motion.position, filmed.motion()[0].position)
    assert made.motion.shown.all()
    assert (made.origin, made.first, made.scene) == ((0, 1), filmed.FRAMES, small_clip.scene())


def test_an_edit_at_the_beginning_gives_the_motion_of_the_edited_scene() -> None:
    made = run(Edit(0.0, set="gravity=1.6"))
    moon = simulate(replace(small_clip.scene(), gravity=(0, 0, -1.6)), 1.0)
    np.testing.assert_allclose(made.motion.position, moon.position[frame_steps(filmed.TIMES)], atol=1e-9)
    assert made.first == 0


def test_frames_before_an_edit_are_the_clips_and_the_motion_goes_on_from_there() -> None:
    made = run(Edit(0.4, set="objects[crate].velocity=[0, 0, 3]"))
    original = filmed.motion()[0].position
    assert made.first == 12
    np.testing.assert_array_equal(made.motion.position[:12], original[:12])
    np.testing.assert_allclose(made.motion.position[12], original[12], atol=1e-4)
    assert made.motion.position[15, 1, 2] > original[15, 1, 2] + 0.2
    assert made.time == pytest.approx(0.4)


def test_what_is_removed_is_no_longer_shown_and_what_is_added_is_from_then_on() -> None:
    made = run(Edit(0.2, remove="crate"), Edit(0.5, add={"name": "new", **BALL}))
    assert [o.name for o in made.motion.objects] == ["ball", "crate", "new"]
    assert made.origin == (0, 1, None)
    np.testing.assert_array_equal(made.motion.shown.sum(0), [30, 6, 15])
    assert isinstance(made.scene, Scene)
    assert [o.name for o in made.scene.objects] == ["ball", "new"]


def test_a_body_of_another_size_keeps_the_looks_of_the_one_that_it_was() -> None:
    made = run(Edit(0.0, set="objects[ball].radius=0.2"), Edit(0.0, set="objects[ball].position[2]=0.2"))
    assert made.origin == (0, 1, 0)
    np.testing.assert_array_equal(made.motion.shown[0], [False, True, True])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (Edit(0.0, remove="crtae"), "did you mean 'crate'.*valid: ball, crate"),
        (Edit(0.0, set="objects[crat].mass=2"), "valid: 0 to 1, or by name: ball, crate"),
        (Edit(0.0, set="objects[0].mass=-2"), "must be greater than 0"),
        (Edit(0.0, add={"name": "ball", **BALL}), "'ball' is taken"),
        (Edit(0.0, add={"name": "new", "shape": "ball"}), "unknown or missing shape"),
        (Edit(0.0, set="objects[ball].position=[0.35, 0.3, 0.5]"), r"mm inside (ball|crate)"),
        (Edit(0.0, set="objects[ball].position[2]=0.05"), "ball would be 100 mm inside the ground"),
        (Edit(0.0, add={"name": "new", **BALL, "position": [0.35, 0.3, 0.5]}), "add new.*mm inside"),
    ],
)
def test_an_edit_that_does_not_fit_is_refused_with_what_is_valid(edit: Edit, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        run(edit)
