import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

from pipeline.errors import SceneError, SimulationError
from pipeline.physics.simulate import compile_xml, simulate
from pipeline.scene.mjcf import mesh_vertices, scene_xml, solref
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Camera, Scene, SceneObject

SCENE = Scene(
    (
        SceneObject(
            shape="sphere",
            size=(0.1,),
            mass=0.5,
            sliding_friction=0.3,
            rolling_friction=0.004,
            damping=0.6,
            position=(0, 0, 0.4),
            velocity=(1, 0.2, 0.5),
            angular_velocity=(1, 2, 3),
        ),
        SceneObject(
            shape="box",
            size=(0.2, 0.3, 0.1),
            mass=2.0,
            sliding_friction=0.6,
            rolling_friction=0.0,
            damping=0.2,
            position=(0.6, 0.1, 0.3),
            velocity=(-1, 0, 0),
            angular_velocity=(0, 4, 1),
            orientation=(1, 0.2, 0.3, 0),
        ),
        SceneObject(
            shape="cylinder",
            size=(0.1, 0.3),
            mass=1.0,
            sliding_friction=0.5,
            rolling_friction=0.01,
            damping=1.0,
            position=(-0.6, 0, 0.15),
            velocity=(0, 0, 0),
            angular_velocity=(0, 0, 5),
            name="can",
        ),
    ),
    Camera((0, -2, 0.8), 42, pitch=-22),
    (0.1, 0.0, -9.0),
    0.0,
)


def test_bodies_camera_ground_and_keyframe_have_the_names_of_the_format() -> None:
    model = compile_xml(scene_xml(SCENE))
    assert [model.body(i).name for i in range(1, model.nbody)] == ["sphere_0", "box_1", "can"]
    assert model.camera("camera").fovy == pytest.approx(42)
    assert model.geom("ground").type == mujoco.mjtGeom.mjGEOM_PLANE
    assert model.nkey == 1
    assert model.key("initial").id == 0
    assert model.opt.timestep == pytest.approx(1 / 240, rel=1e-12)
    np.testing.assert_allclose(model.opt.gravity, [0.1, 0, -9.0])
    np.testing.assert_allclose(model.body_mass[1:], [0.5, 2.0, 1.0])
    assert all(j == mujoco.mjtJoint.mjJNT_FREE for j in model.jnt_type)


def test_the_camera_looks_along_y_and_down_by_its_pitch() -> None:
    model = compile_xml(scene_xml(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    right, up, back = data.cam_xmat[0].reshape(3, 3).T
    np.testing.assert_allclose(right, [1, 0, 0], atol=1e-9)
    np.testing.assert_allclose(-back, [0, np.cos(np.radians(22)), -np.sin(np.radians(22))], atol=1e-6)
    assert up[2] > 0


def test_loaded_into_plain_mujoco_it_moves_as_the_projects_simulation() -> None:
    model = mujoco.MjModel.from_xml_string(scene_xml(SCENE))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    trace = simulate(SCENE)
    for step in range(1, 241):
        mujoco.mj_step(model, data)
        np.testing.assert_array_equal(data.qpos.reshape(-1, 7)[:, :3], trace.position[step])
        np.testing.assert_array_equal(data.qpos.reshape(-1, 7)[:, 3:], trace.quaternion[step])


def test_velocities_in_the_trace_start_as_the_scenes_in_the_worlds_frame() -> None:
    trace = simulate(SCENE, 0.05)
    for i, obj in enumerate(SCENE.objects):
        np.testing.assert_allclose(trace.position[0, i], obj.position)
        np.testing.assert_allclose(trace.velocity[0, i], obj.velocity)
        np.testing.assert_allclose(trace.angular_velocity[0, i], obj.angular_velocity, atol=2e-6)


def test_the_angular_velocity_turns_the_body_about_the_worlds_axis(rng: np.random.Generator) -> None:
    omega = rng.normal(size=3)
    ball = SceneObject(
        "sphere", (0.1,), 1.0, position=(0, 0, 5), angular_velocity=tuple(omega), orientation=tuple(rng.normal(size=4))
    )
    trace = simulate(Scene((ball,), ground=None), 0.1)
    start, end = matrix_from_quaternion(trace.quaternion[[0, -1], 0])
    axis = np.array(ball.angular_velocity) / np.linalg.norm(ball.angular_velocity)
    np.testing.assert_allclose(end @ start.T @ axis, axis, atol=1e-9)


def test_numbers_pass_through_the_text_unrounded() -> None:
    scene = Scene((SceneObject("box", (0.123457, 0.234568, 0.345679), 0.000123457, position=(1.23457e-5, 123456, 7)),))
    model = compile_xml(scene_xml(scene))
    np.testing.assert_array_equal(model.key_qpos[0, :3], scene.objects[0].position)
    np.testing.assert_allclose(model.geom_size[1], np.array(scene.objects[0].size) / 2, rtol=1e-15)


def test_a_scene_without_camera_ground_or_objects_is_a_scene() -> None:
    trace = simulate(Scene((), ground=None), 0.1)
    assert trace.position.shape == (25, 0, 3)
    assert simulate(Scene((SceneObject("sphere", (0.1,), 1.0),), ground=None), 0.1).position[-1, 0, 2] < 0


def test_a_contacts_spring_is_one_that_the_time_step_follows(rng: np.random.Generator) -> None:
    time_constant, ratio = solref(10 ** rng.uniform(-3, 1, 100)).T
    assert (time_constant >= 0.02).all()
    period = 2 * np.pi * 0.9 * time_constant * ratio  # s, of the undamped spring: MuJoCo manual, "Solver parameters"
    assert (period * 240 >= 7).all()
    np.testing.assert_array_equal(solref(np.array(0.3)), [0.02, 0.3])


def test_a_scene_that_mujoco_refuses_is_a_simulation_error_in_its_words() -> None:
    with pytest.raises(SimulationError, match=r"compiler refuses the scene: .*mass and inertia"):
        simulate(Scene((SceneObject("sphere", (1e-6,), 1e-18),)))


def box_obj(x: float, y: float, z: float) -> str:
    corners = [(i, j, k) for i in (0, x) for j in (0, y) for k in (0, z)]
    faces = "1 2 4,1 4 3,5 7 8,5 8 6,1 5 6,1 6 2,3 4 8,3 8 7,1 3 7,1 7 5,2 6 8,2 8 4"
    return "".join(f"v {a} {b} {c}\n" for a, b, c in corners) + "".join(f"f {f}\n" for f in faces.split(","))


def box_stl(x: float, y: float, z: float) -> bytes:
    lines = box_obj(x, y, z).splitlines()
    vertices = np.array([list(map(float, line.split()[1:])) for line in lines if line[0] == "v"])
    faces = np.array([list(map(int, line.split()[1:])) for line in lines if line[0] == "f"]) - 1
    rows = np.zeros(len(faces), [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    rows["corners"] = vertices[faces]
    return bytes(80) + np.uint32(len(faces)).tobytes() + rows.tobytes()


@pytest.mark.parametrize("kind", ["obj", "stl"])
def test_a_mesh_is_simulated_about_the_middle_of_its_box(tmp_path: Path, kind: str) -> None:
    file = tmp_path / f"brick.{kind}"
    file.write_bytes(box_obj(1, 2, 3).encode() if kind == "obj" else box_stl(1, 2, 3))
    vertices = mesh_vertices(str(file))
    np.testing.assert_allclose(vertices.max(0), [0.5, 1.0, 1.5], atol=1e-6)
    np.testing.assert_allclose(vertices.min(0), [-0.5, -1.0, -1.5], atol=1e-6)
    brick = SceneObject("mesh", (0.1,), 2.0, file=str(file), position=(0, 0, 0.5), name="brick")
    model = compile_xml(scene_xml(Scene((brick,))))
    np.testing.assert_allclose(np.sort(model.body_inertia[1]), 2 / 12 * np.array([5, 10, 13]) * 0.01, rtol=1e-4)
    trace = simulate(Scene((brick,)))
    fallen = 0.5 - 0.5 * 9.81 * 0.25**2
    assert trace.position[60, 0, 2] == pytest.approx(fallen, abs=0.01)
    assert trace.position[-1, 0, 2] == pytest.approx(0.15, abs=0.003)


def test_a_mesh_that_is_not_at_its_centre_of_mass_still_moves_by_its_middle(tmp_path: Path) -> None:
    file = tmp_path / "wedge.obj"
    file.write_text("v 0 0 0\nv 3 0 0\nv 0 2 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    wedge = SceneObject("mesh", (0.1,), 1.0, file=str(file), position=(0.1, 0.2, 1.0), velocity=(1, 0, 0))
    trace = simulate(Scene((wedge,), gravity=(0, 0, 0), ground=None), 0.5)
    np.testing.assert_allclose(trace.position[-1, 0], [0.6, 0.2, 1.0], atol=1e-9)


def test_a_mesh_file_that_is_missing_or_no_mesh_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"mesh file .*gone\.obj: there is no such file"):
        simulate(Scene((SceneObject("mesh", (1.0,), 1.0, file=str(tmp_path / "gone.obj")),)))
    (tmp_path / "words.stl").write_text("this is no mesh")
    with pytest.raises(SceneError, match=re.escape(f"mesh file {tmp_path / 'words.stl'}: MuJoCo cannot read it")):
        mesh_vertices(str(tmp_path / "words.stl"))
