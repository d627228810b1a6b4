"""Masks of rasteriser, ray caster and MuJoCo's renderer agree for every kind of camera and with fixed bodies."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pipeline.scene.mjcf import scene_mjcf
from pipeline.scene.scene import Camera, FixedBody, Scene, SceneObject
from pipeline.vision.rendering.appearance import Material, clear_view, plain_appearance
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.mjcf_appearance import add_appearance
from pipeline.vision.rendering.mujoco_render import Canvas
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render_backend import GL_PLATFORMS, gl_problem
from pipeline.vision.rendering.shade import shade

OBJECTS = (
    SceneObject("sphere", (0.15,), 0.5, position=(-0.4, 0.1, 0.3)),
    SceneObject("cylinder", (0.12, 0.3), 0.5, position=(0.0, 0.5, 0.4), orientation=(0.9, 0.3, 0.1, 0.2)),
    SceneObject("box", (0.25, 0.3, 0.2), 0.5, position=(0.4, 0.2, 0.5), orientation=(0.8, 0.1, 0.5, 0.2)),
)
FIXED = (
    FixedBody("box", (1.2, 0.6, 0.05), (0.1, 0.2, 0.15), (0.98, 0.0, 0.2, 0.0), name="ramp"),
    FixedBody("cylinder", (0.05, 0.8), (0.1, -0.2, 0.4), name="pole"),
    FixedBody("plane", (), (0, 2, 0), (np.sqrt(0.5), np.sqrt(0.5), 0, 0), name="wall"),  # its normal is -y
)


def look(yaw: float, pitch: float, roll: float) -> tuple[float, ...]:
    """Orientation of a camera from angles in deg: heading from +y, above the horizon, and about its axis."""
    q = np.array([1.0, 0, 0, 0])
    for angle, axis in ((yaw, 2), (90 + pitch, 0), (roll, 2)):
        turn = np.zeros(4)
        turn[0], turn[1 + axis] = np.cos(np.radians(angle) / 2), np.sin(np.radians(angle) / 2)
        out = np.zeros(4)
        mujoco.mju_mulQuat(out, q, turn)
        q = out
    return tuple(q)


CAMERAS = {
    "rolled": Camera((0, -2, 0.8), 45, orientation=look(0, -15, 30)),
    "upside down": Camera((0.2, -2, 0.5), 45, orientation=look(0, -5, 180)),
    "down": Camera((0, 0.2, 2.5), 40, pitch=-90),
    "down, turned": Camera((0, 0.2, 2.5), 40, orientation=look(50, -90, 0)),
    "low": Camera((0, -2, 0.02), 45, orientation=look(0, 8, -10)),
    "below the ground": Camera((0, -2, -0.4), 45, orientation=look(0, 20, 5)),
    "far": Camera((0, -60, 8), 2.2, orientation=look(0, -7.3, 12)),
    "from behind": Camera((0.3, 1.8, 0.7), 60, orientation=look(175, -15, 3)),
    "near": Camera((0.1, -0.6, 0.5), 80, orientation=look(5, -10, -20)),
}


@pytest.fixture
def gl() -> None:
    if all(gl_problem(platform) for platform in GL_PLATFORMS):
        pytest.skip("no OpenGL platform works here")


def poses(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    position = np.array([[o.position for o in scene.objects]])
    return position, np.array([[o.orientation for o in scene.objects]])


@pytest.mark.usefixtures("gl")
@pytest.mark.parametrize("ground", [0.0, None])
@pytest.mark.parametrize("name", CAMERAS)
def test_all_renderers_agree_on_the_masks(name: str, ground: float | None) -> None:
    camera = CAMERAS[name]
    scene = Scene(OBJECTS, camera, ground=ground, fixed=FIXED)
    position, quaternion = poses(scene)
    ours = rasterise(OBJECTS, position, quaternion, pinhole(camera), 240, 160, ground, FIXED).mask[0]
    assert set(np.unique(ours)) >= {0, 1, 3}

    root = scene_mjcf(scene)
    add_appearance(root, clear_view(plain_appearance(3, 3), camera.position, position), 240, 160)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    with Canvas(model, 240, 160) as canvas:
        theirs = canvas.segmentation(position[0], quaternion[0])
    assert (theirs != ours).mean() < 0.006

    # Colours that tell the objects: one channel each, no light but the ambient one.
    black = Material((0, 0, 0), (0, 0, 0), specular=0.0)
    colours = [replace(black, colour=c, second_colour=c) for c in ((1, 0, 0), (0, 1, 0), (0, 0, 1))]
    plain = plain_appearance(3, 3)
    backdrop = replace(plain.backdrop, horizon=(0, 0, 0), zenith=(0, 0, 0))
    flat = replace(plain, materials=tuple(colours), fixed=(black,) * 3, floor=black, lights=(), backdrop=backdrop)
    picture = shade(OBJECTS, position, quaternion, pinhole(camera), flat, 240, 160, ground, False, False, fixed=FIXED)[
        0
    ]
    seen = np.where(picture.max(-1) > 0, picture.argmax(-1) + 1, 0)
    np.testing.assert_array_equal(seen, ours)


def test_fixed_bodies_have_no_flow_and_hide_that_of_objects() -> None:
    camera = pinhole(CAMERAS["rolled"])
    position, quaternion = poses(Scene(OBJECTS))
    position, quaternion = np.repeat(position, 2, 0), np.repeat(quaternion, 2, 0)
    position[1] += [0.05, 0.0, 0.02]
    curtain = (FixedBody("box", (3, 0.02, 3), (0, -0.5, 0)),)
    hidden = exact_flow(OBJECTS, position, quaternion, camera, 120, 80, 0.0, fixed=curtain)
    assert not hidden.any()
    partly = exact_flow(OBJECTS, position, quaternion, camera, 120, 80, 0.0, fixed=FIXED)[0]
    mask = rasterise(OBJECTS, position, quaternion, camera, 120, 80, 0.0, FIXED).mask[0]
    assert partly[mask > 0].any(-1).all()
    assert not partly[mask == 0].any()


def test_a_fixed_body_has_its_own_material_and_casts_a_shadow() -> None:
    scene = Scene(OBJECTS[:1], Camera((0, 0, 3), 40, pitch=-90), fixed=FIXED[:1])
    plain = plain_appearance(1, 1)
    red = replace(plain, fixed=(Material((1, 0, 0), (1, 0, 0)),))
    without = replace(plain, fixed=())
    args = (*poses(scene), pinhole(scene.camera or CAMERAS["down"]))
    drawn = shade(scene.objects, *args, red, 120, 80, 0.0, fixed=scene.fixed)[0].astype(int)
    bare = shade(scene.objects, *args, without, 120, 80, 0.0)[0].astype(int)
    assert (drawn[..., 0] - drawn[..., 1] > 80).sum() > 800  # the ramp is red
    darker = (bare - drawn).min(-1) > 20
    assert darker.sum() > 50  # its shadow on the floor
