import sys

import mujoco
import numpy as np
import pytest

from pipeline.errors import ParamsError, SceneError
from pipeline.scene.mjcf import scene_mjcf
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.vision.rendering import render_backend
from pipeline.vision.rendering.appearance import plain_appearance, sample_appearance
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.mjcf_appearance import add_appearance
from pipeline.vision.rendering.mujoco_render import Canvas, render_mujoco
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import RENDERERS, render_rgb
from pipeline.vision.rendering.render_backend import CHOICES, GL_PLATFORMS, choose_backend, gl_problem

OBJECTS = (
    SceneObject("sphere", (0.15,), 0.5, position=(-0.4, 0.1, 0.15), velocity=(1.0, 0.2, 0.0)),
    SceneObject("cylinder", (0.12, 0.3), 0.5, position=(0.0, 0.5, 0.3), orientation=(0.9, 0.3, 0.1, 0.2)),
    SceneObject("box", (0.25, 0.3, 0.2), 0.5, position=(0.4, 0.2, 0.4), orientation=(0.8, 0.1, 0.5, 0.2)),
)
SCENE = Scene(OBJECTS, Camera((0, -2, 0.8), 42, pitch=-18))
POSITIONS = np.array([[o.position for o in OBJECTS]])
QUATERNIONS = np.array([[o.orientation for o in OBJECTS]])


@pytest.fixture
def gl() -> None:
    if all(gl_problem(platform) for platform in GL_PLATFORMS):
        pytest.skip("no OpenGL platform works here")


def test_each_choice_of_a_backend_but_auto_has_a_renderer() -> None:
    assert set(CHOICES) - {"auto"} == set(RENDERERS)


@pytest.mark.usefixtures("gl")
def test_both_renderers_give_nearly_the_same_picture(rng: np.random.Generator) -> None:
    for look in (plain_appearance(3), sample_appearance(rng, 3, metal_probability=0.0)):
        ours, theirs = (
            render_rgb(SCENE, POSITIONS, QUATERNIONS, look, 240, 160, backend).astype(float)
            for backend in ("raycast", "mujoco")
        )
        assert ours.shape == theirs.shape == (1, 160, 240, 3)
        mask = rasterise(OBJECTS, POSITIONS, QUATERNIONS, pinhole(SCENE.camera), 240, 160).mask > 0
        assert np.abs(ours - theirs)[mask].mean() < 25
        assert np.abs(ours - theirs).mean() < 25


@pytest.mark.usefixtures("gl")
def test_mujocos_segmentation_is_our_mask_but_for_edges() -> None:
    root = scene_mjcf(SCENE)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    with Canvas(model, 240, 160) as canvas:
        theirs = canvas.segmentation(POSITIONS[0], QUATERNIONS[0])
    ours = rasterise(OBJECTS, POSITIONS, QUATERNIONS, pinhole(SCENE.camera), 240, 160).mask[0]
    assert (theirs != ours).mean() < 0.005
    assert set(np.unique(theirs)) == {0, 1, 2, 3}


@pytest.mark.usefixtures("gl")
def test_no_frames_give_no_pictures() -> None:
    empty = render_mujoco(SCENE, POSITIONS[:0], QUATERNIONS[:0], plain_appearance(3), 24, 16)
    assert empty.shape == (0, 16, 24, 3)


def test_an_appearance_does_not_change_the_motion(rng: np.random.Generator) -> None:
    bare, dressed = scene_mjcf(SCENE), scene_mjcf(SCENE)
    add_appearance(dressed, sample_appearance(rng, 3), 64, 48)
    states = []
    for root in (bare, dressed):
        model = mujoco.MjModel.from_xml_string(root.to_xml_string(precision=17), root.get_assets())
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_step(model, data, 240)
        states.append(data.qpos.copy())
    np.testing.assert_array_equal(states[0], states[1])


def test_without_opengl_the_ray_caster_is_chosen_and_says_why(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("MUJOCO_GL", raising=False)
    monkeypatch.setattr(render_backend, "gl_problem", lambda platform: f"no {platform} here")
    backend, reason = choose_backend("auto")
    assert backend == "raycast"
    assert "no egl here" in reason
    assert "no osmesa here" in reason
    with pytest.raises(ParamsError, match="no egl here"):
        choose_backend("mujoco")


def test_an_opengl_that_kills_its_process_is_survived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render_backend, "_PROBE", "import os; os.abort()")
    assert "exited with" in (gl_problem.__wrapped__("egl") or "")


def test_an_unknown_backend_is_named_with_those_that_are_valid() -> None:
    with pytest.raises(ParamsError, match="'vulkan': valid are auto, mujoco, raycast"):
        choose_backend("vulkan")


def test_the_ray_caster_is_chosen_without_a_try_when_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(render_backend.subprocess, "run", lambda *_, **__: sys.exit("tried"))
    assert choose_backend("raycast")[0] == "raycast"


def test_a_scene_without_a_camera_cannot_be_drawn() -> None:
    with pytest.raises(SceneError, match="camera: missing"):
        render_rgb(Scene(OBJECTS), POSITIONS, QUATERNIONS, plain_appearance(3), 24, 16, "raycast")
