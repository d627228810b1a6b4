"""Laws of motion on and against bodies that do not move."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from pipeline.physics.batch import NO_CAMERA, BatchSimulator, scene_model, stack_scenes, unstack
from pipeline.physics.overlap import penetration, separated
from pipeline.physics.simulate import compile_xml, simulate, simulate_model
from pipeline.physics.trace import FIRST_FIXED, GROUND, Trace
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.rotation import quaternion_multiply, rotate
from pipeline.scene.scene import FIXED_SIZE_KEYS, FixedBody, Scene, SceneObject

G = 9.81
ONTO_SIDE = np.array([np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0])  # z becomes -y


def incline(angle_deg: float, shape: str = "plane", **values: float) -> tuple[FixedBody, np.ndarray, np.ndarray]:
    """A ramp through the origin that falls along x, with its downhill direction and its normal."""
    a = np.radians(angle_deg)
    turn = (np.cos(a / 2), 0.0, np.sin(a / 2), 0.0)
    normal, downhill = np.array([np.sin(a), 0, np.cos(a)]), np.array([np.cos(a), 0, -np.sin(a)])
    if shape == "plane":
        return FixedBody("plane", (), orientation=turn, **values), downhill, normal
    return FixedBody("box", (2.0, 1.0, 0.1), tuple(-0.05 * normal), turn, **values), downhill, normal


def acceleration(trace: Trace, along: np.ndarray, first: int = 48, last: int = 168) -> float:
    """Of the only object, m/s², from its velocities between two steps."""
    speed = trace.velocity[first:last, 0] @ along
    return float(np.polyfit(trace.times[first:last], speed, 1)[0])


@pytest.mark.parametrize("shape", ["plane", "box"])
@pytest.mark.parametrize(
    ("body", "hollow", "share"),
    [
        ("sphere", 0.0, 5 / 7),
        ("sphere", 1.0, 3 / 5),
        ("sphere", 0.8, 1 / (1 + 0.4 * (1 - 0.8**5) / (1 - 0.8**3))),
        ("cylinder", 0.0, 2 / 3),
        ("cylinder", 1.0, 1 / 2),
        ("cylinder", 0.9, 1 / (1 + 0.5 * (1 + 0.81))),
    ],
)
def test_a_round_body_rolls_down_a_ramp_as_its_inertia_says(shape: str, body: str, hollow: float, share: float) -> None:
    ramp, downhill, normal = incline(20, shape)
    size = (0.1,) if body == "sphere" else (0.1, 0.2)
    turn = quaternion_multiply(np.array(ramp.orientation), ONTO_SIDE)
    start = tuple(0.1 * normal - 0.5 * downhill)
    rolling = SceneObject(body, size, 1.0, 1.0, position=start, orientation=tuple(turn), hollow=hollow)
    trace = simulate(Scene((rolling,), ground=None, fixed=(ramp,)), 0.8)
    expected = share * G * np.sin(np.radians(20))
    assert acceleration(trace, downhill) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize(("angle_deg", "friction"), [(25.0, 0.2), (35.0, 0.4), (15.0, 0.0)])
def test_a_block_slides_down_a_ramp_by_gravity_less_friction(angle_deg: float, friction: float) -> None:
    ramp, downhill, normal = incline(angle_deg, "box")
    start = tuple(0.03 * normal - 0.8 * downhill)
    block = SceneObject("box", (0.2, 0.2, 0.06), 1.0, friction, position=start, orientation=ramp.orientation)
    a = np.radians(angle_deg)
    trace = simulate(Scene((block,), ground=None, fixed=(ramp,)), 0.7)
    assert acceleration(trace, downhill) == pytest.approx(G * (np.sin(a) - friction * np.cos(a)), rel=0.02)


def test_a_block_rests_on_a_ramp_where_friction_exceeds_the_slope() -> None:
    ramp, downhill, normal = incline(20, "box")
    block = SceneObject("box", (0.2, 0.2, 0.06), 1.0, 0.5, position=tuple(0.03 * normal), orientation=ramp.orientation)
    trace = simulate(Scene((block,), ground=None, fixed=(ramp,)), 1.0)
    assert np.linalg.norm(trace.position[-1, 0] - trace.position[0, 0]) < 0.01
    assert abs(acceleration(trace, downhill)) < 0.05


@pytest.mark.parametrize(("own", "of_ramp", "slides"), [(1.0, 0.05, True), (0.0, 1.0, False), (0.05, None, True)])
def test_the_friction_of_a_ramp_counts_where_it_has_one(own: float, of_ramp: float | None, slides: bool) -> None:
    ramp, downhill, normal = incline(20, "box")
    ramp = replace(ramp, sliding_friction=of_ramp)
    block = SceneObject("box", (0.2, 0.2, 0.06), 1.0, own, position=tuple(0.03 * normal), orientation=ramp.orientation)
    trace = simulate(Scene((block,), ground=None, fixed=(ramp,)), 0.5)
    moved = float((trace.position[-1, 0] - trace.position[0, 0]) @ downhill)
    assert (moved > 0.2) if slides else (abs(moved) < 0.01)


def test_a_ball_rolls_over_the_end_of_a_ramp_and_falls_onto_the_ground() -> None:
    ramp, downhill, normal = incline(15, "box")
    ball = SceneObject("sphere", (0.05,), 1.0, 0.8, position=tuple(0.05 * normal + 0.7 * downhill))
    trace = simulate(Scene((ball,), ground=-1.0, fixed=(ramp,)), 1.5)
    c = trace.contacts
    left, landed = c.step[c.second == FIRST_FIXED].max(), c.step[c.second == GROUND].min()
    edge = downhill @ trace.position[left, 0]
    assert edge == pytest.approx(1.0, abs=0.06)
    flight = trace.velocity[left + 2 : landed, 0]
    np.testing.assert_allclose(
        np.diff(flight, axis=0) * trace.rate, np.tile([0, 0, -G], (len(flight) - 1, 1)), atol=1e-6
    )
    assert trace.position[-1, 0, 2] == pytest.approx(-0.95, abs=0.01)


@pytest.mark.parametrize(("of_ball", "of_wall", "bounces"), [(0.1, None, True), (1.0, None, False), (1.0, 0.1, True)])
def test_a_ball_bounces_off_a_wall_as_the_damping_of_ball_or_wall_says(
    of_ball: float, of_wall: float | None, bounces: bool
) -> None:
    wall = FixedBody("box", (0.1, 2.0, 2.0), (1.0, 0, 0), damping=of_wall, name="wall")
    ball = SceneObject("sphere", (0.1,), 1.0, 0.0, damping=of_ball, position=(0.5, 0, 0), velocity=(2.0, 0, 0))
    trace = simulate(Scene((ball,), ground=None, gravity=(0, 0, 0), fixed=(wall,)), 0.6)
    back = -trace.velocity[-1, 0, 0] / 2.0
    assert (0.5 < back < 0.95) if bounces else (back < 0.15)
    assert trace.position[:, 0, 0].max() < 0.9  # the wall's face is at 0.95


def every_fixed_body(rng: np.random.Generator, own_contact: bool) -> tuple[FixedBody, ...]:
    bodies = []
    for i, shape in enumerate(s for s in FIXED_SIZE_KEYS if s != "mesh"):
        size = rng.uniform(0.1, 0.3, len(FIXED_SIZE_KEYS[shape]))
        if shape == "capsule":
            size[1] += 2 * size[0]
        tilt = rng.normal(size=4) if shape != "plane" else np.array([1.0, *rng.uniform(-0.1, 0.1, 3)])
        position = (*rng.uniform(-0.5, 0.5, 2), -0.2) if shape != "plane" else (0.0, 0.0, -0.5)
        own = {"sliding_friction": 0.3} if own_contact and i % 2 else {"damping": 0.4} if own_contact else {}
        bodies.append(FixedBody(shape, tuple(size), position, tuple(tilt), **own))
    return tuple(bodies)


def falling(rng: np.random.Generator) -> tuple[SceneObject, ...]:
    ball = SceneObject("sphere", (0.1,), 1.0, *rng.uniform(0.1, 0.6, 3), position=(-0.2, 0.1, 0.5), hollow=0.7)
    box = SceneObject("box", (0.1, 0.2, 0.15), 1.0, *rng.uniform(0.1, 0.6, 3), position=(0.3, -0.2, 0.6))
    pipe = SceneObject("cylinder", (0.08, 0.3), 1.0, *rng.uniform(0.1, 0.6, 3), position=(0, 0.4, 0.7), hollow=0.95)
    return ball, box, pipe


@pytest.mark.parametrize("own_contact", [False, True])
@pytest.mark.parametrize("ground", [None, -0.6])
def test_a_batch_with_fixed_bodies_moves_as_single_scenes_do(
    rng: np.random.Generator, own_contact: bool, ground: float | None
) -> None:
    scenes = [Scene(falling(rng), ground=ground, fixed=every_fixed_body(rng, own_contact)) for _ in range(3)]
    batch, steps = stack_scenes(scenes), np.arange(0, 97, 8)
    states = BatchSimulator(batch.shapes, batch.has_ground, 3, 1, batch.fixed_kinds).run(batch, steps)
    for row, scene in enumerate(scenes):
        alone, direct = simulate(scene, 0.4), simulate_model(scene_model(scene), 0.4)
        first = alone.contacts.step.min() + 24 if len(alone.contacts) else 96  # what the last bit does grows after hits
        early = steps <= first
        np.testing.assert_allclose(states.position[row, early], alone.position[steps[early]], atol=1e-6)
        np.testing.assert_allclose(direct.position[: first + 1], alone.position[: first + 1], atol=1e-6)
        # the row is the scene that it was made from
        assert unstack(batch, row, replace(scene, camera=NO_CAMERA)).fixed == scene.fixed


def test_plain_mujoco_moves_a_scene_with_fixed_bodies_alike(rng: np.random.Generator) -> None:
    scene = Scene(falling(rng), fixed=every_fixed_body(rng, True), ground=None)
    model = compile_xml(scene_xml(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    trace = simulate(scene, 0.5)
    for _ in range(120):
        mujoco.mj_step(model, data)
    np.testing.assert_array_equal(data.qpos.reshape(-1, 7)[:, :3], trace.position[-1])
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_GEOM, i) for i in range(model.ngeom)]
    assert names[: len(scene.fixed)] == [b.name for b in scene.fixed]
    assert set(np.unique(model.geom_bodyid[: len(scene.fixed)])) == {0}


def test_contacts_name_the_fixed_body_and_push_away_from_it() -> None:
    floor = FixedBody("box", (4, 4, 0.2), (0, 0, -0.1))
    wall = FixedBody("plane", (), (1, 0, 0), tuple(np.array([1, 0, -1, 0]) / np.sqrt(2)))  # its normal is -x
    ball = SceneObject("sphere", (0.1,), 1.0, position=(0.5, 0, 0.1), velocity=(2, 0, 0))
    c = simulate(Scene((ball,), ground=None, fixed=(floor, wall)), 0.5).contacts
    for k, normal in enumerate([(0, 0, 1), (-1, 0, 0)]):
        rows = c.second == FIRST_FIXED - k
        assert rows.any()
        np.testing.assert_allclose(c.normal[rows], np.tile(normal, (rows.sum(), 1)), atol=1e-9)
        assert (c.force[rows] @ normal >= 0).all()
    assert set(c.second) == {FIRST_FIXED, FIRST_FIXED - 1}


@pytest.mark.parametrize("shape", [s for s in FIXED_SIZE_KEYS if s != "mesh"])
def test_an_object_overlaps_a_fixed_body_by_its_depth_and_is_moved_out(rng: np.random.Generator, shape: str) -> None:
    size = (0.1, 0.4) if shape == "capsule" else (0.2,) * len(FIXED_SIZE_KEYS[shape])
    turn = rng.normal(size=4)
    top = {"sphere": 0.2, "cylinder": 0.1, "capsule": 0.2, "plane": 0.0}.get(shape, 0.1)
    fixed = FixedBody(shape, size, tuple(rng.uniform(-1, 1, 3)), tuple(turn))
    up = rotate(np.array(fixed.orientation), np.array([0.0, 0.0, 1.0]))
    ball = SceneObject("sphere", (0.05,), 1.0, position=tuple(np.array(fixed.position) + (top + 0.05 - 0.01) * up))
    scene = Scene((ball,), ground=None, fixed=(fixed,))
    assert penetration(scene) == pytest.approx(0.01, abs=1e-4)
    apart = separated(scene)
    assert penetration(apart) <= 2e-4
    assert apart.fixed == scene.fixed
