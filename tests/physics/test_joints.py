"""Laws of bodies that hang, swing and slide, and what the text of a joint says."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from pipeline.clips.replay import states_at
from pipeline.editing.edited_motion import scene_at
from pipeline.errors import SceneError
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.physics.simulate import compile_xml, simulate
from pipeline.physics.trace import Trace
from pipeline.scene.edited import edited
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import JOINT_KEYS, Joint, Scene, SceneObject, Spring
from pipeline.scene.text import load_scene, read_scene, write_scene

G = 9.81
EXAMPLE = Path(__file__).resolve().parents[2] / "docs" / "double_pendulum.yaml"


def ball(position: np.ndarray, joint: Joint | None, **values: object) -> SceneObject:
    return SceneObject("sphere", (0.05,), 0.3, position=tuple(position), joint=joint, **values)  # type: ignore[arg-type]


def motion(*objects: SceneObject, seconds: float = 10.0) -> Trace:
    return simulate(Scene(objects, ground=None), seconds)


def period(x: np.ndarray, rate: int) -> float:
    """Mean time between zero crossings upward, s, of x (S,)."""
    at = np.flatnonzero((x[:-1] < 0) & (x[1:] >= 0))
    return float(np.diff(at + x[at] / (x[at] - x[at + 1])).mean() / rate)


def hanging(length: float, angle: float, kind: str, **values: float) -> SceneObject:
    anchor = np.array([0.2, -0.1, 1.3])
    axis = (0.0, 1.0, 0.0) if kind == "hinge" else None
    place = anchor + length * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return ball(place, Joint(kind, tuple(anchor), axis, **values))  # type: ignore[arg-type]


@pytest.mark.parametrize("kind", ["hinge", "ball", "rod", "rope"])
def test_a_small_pendulum_has_the_period_of_its_length_and_inertia(kind: str, rng: np.random.Generator) -> None:
    length, angle = rng.uniform(0.15, 0.8), rng.uniform(0.02, 0.06)
    trace = motion(hanging(length, angle, kind))
    turning = 0.0 if kind == "rope" else 0.4 * 0.05**2  # a body on a rope does not turn with it
    expected = 2 * np.pi * np.sqrt((length**2 + turning) / (G * length)) * (1 + angle**2 / 16)
    assert period(trace.position[:, 0, 0] - 0.2, trace.rate) == pytest.approx(expected, rel=5e-4)
    distance = np.linalg.norm(trace.position[:, 0] - (0.2, -0.1, 1.3), axis=1)
    np.testing.assert_allclose(distance, length, atol=5e-4)


def test_energy_of_a_double_pendulum_is_conserved_and_its_lengths_stay(rng: np.random.Generator) -> None:
    a, b = rng.uniform(0.2, 0.5, 2)
    first, between = np.array([a, 0.0, 0.0]), ball(np.array([0.0, 3.0, 0.0]), None, name="between")
    upper = ball(first, Joint("rod", (0, 0, 0)), name="upper")
    lower = ball(first + np.array([0, 0, b]), Joint("rod", tuple(first), to="upper"), name="lower")
    trace = motion(lower, between, upper, seconds=5.0)
    speeds = 0.5 * (trace.velocity**2).sum(2) + 0.5 * 0.4 * 0.05**2 * (trace.angular_velocity**2).sum(2)
    energy = (speeds + G * trace.position[..., 2])[:, [0, 2]].sum(1)
    np.testing.assert_allclose(energy, energy[0], atol=2e-3 * G * (a + b))
    np.testing.assert_allclose(np.linalg.norm(trace.position[:, 0] - trace.position[:, 2], axis=1), b, atol=1e-6)
    np.testing.assert_allclose(trace.position[-1, 1, 2], -0.5 * G * 25, rtol=0.01)  # the third one falls


def test_damping_lets_a_swing_decay_exponentially(rng: np.random.Generator) -> None:
    length, rate = rng.uniform(0.3, 0.6), rng.uniform(0.2, 0.6)
    inertia = 0.3 * (length**2 + 0.4 * 0.05**2)
    trace = motion(hanging(length, 0.05, "rod", damping=2 * rate * inertia))
    wide = np.abs(trace.position[:, 0, 0] - 0.2)
    peaks = 1 + np.flatnonzero((wide[1:-1] > wide[:-2]) & (wide[1:-1] >= wide[2:]))
    assert -np.polyfit(peaks / trace.rate, np.log(wide[peaks]), 1)[0] == pytest.approx(rate, rel=0.02)


def test_a_slide_with_a_spring_swings_about_its_rest_place_with_sqrt_k_over_m(rng: np.random.Generator) -> None:
    stiffness, rest = rng.uniform(5, 60), rng.uniform(-0.5, 0.5)
    joint = Joint("slide", (0.1, 0.2, 1.0), (2.0, 0.0, 0.0), spring=Spring(stiffness, rest))
    x = motion(ball(np.array([0.1 + rest + 0.1, 0.2, 1.0]), joint)).position[:, 0, 0] - 0.1 - rest
    assert period(x, 240) == pytest.approx(2 * np.pi * np.sqrt(0.3 / stiffness), rel=1e-3)
    assert (x.min(), x.max()) == pytest.approx((-0.1, 0.1), rel=1e-3)


def test_a_torsion_spring_pulls_a_hinge_to_its_angle_of_rest(rng: np.random.Generator) -> None:
    stiffness, rest = rng.uniform(0.5, 2.0), rng.uniform(0.1, 0.4)
    joint = Joint("hinge", (0, 0, 0), (0, 0, 1), spring=Spring(stiffness, rest))
    path = motion(ball(np.array([0.3, 0, 0]), joint)).position[:, 0]
    turned = np.arctan2(path[:, 1], path[:, 0]) - rest
    expected = 2 * np.pi * np.sqrt(0.3 * (0.3**2 + 0.4 * 0.05**2) / stiffness)
    assert period(turned, 240) == pytest.approx(expected, rel=1e-3)


def test_coulomb_friction_stops_a_slide_after_half_v_squared_m_over_f_and_holds_it(rng: np.random.Generator) -> None:
    force, speed = rng.uniform(0.3, 1.0), rng.uniform(0.5, 1.5)
    joint = Joint("slide", (0, 0, 0), (1, 0, 0), friction=force)
    x = motion(ball(np.zeros(3), joint, velocity=(speed, 0, 0)), seconds=6.0).position[:, 0, 0]
    assert x[-1] == pytest.approx(0.5 * 0.3 * speed**2 / force, rel=0.02)
    held = Joint("slide", (0, 0, 0), (1, 0, 1), friction=1.1 * 0.3 * G / np.sqrt(2))
    assert np.ptp(motion(ball(np.zeros(3), held)).position[:, 0, 0]) < 1e-3


def test_a_slack_rope_lets_the_body_fall_freely_and_stops_it_at_its_length(rng: np.random.Generator) -> None:
    length, drop = rng.uniform(0.3, 0.6), rng.uniform(0.05, 0.25)
    start = np.array([0.0, 0.0, 1.0 - length + drop])
    trace = motion(ball(start, Joint("rope", (0, 0, 1), length=length)), seconds=2.0)
    z, falls = trace.position[:, 0, 2], int(np.sqrt(2 * drop / G) * 240) - 1
    np.testing.assert_allclose(z[:falls], start[2] - 0.5 * G * (np.arange(falls) / 240) ** 2, atol=1e-6)
    bounced = np.gradient(z, 1 / 240)[falls:].max()
    assert bounced < 0.2 * np.sqrt(2 * G * drop)
    np.testing.assert_allclose(z[-48:], 1.0 - length, atol=1e-3)


def test_an_elastic_rope_swings_about_the_place_where_it_carries_the_weight() -> None:
    z = motion(ball(np.array([0, 0, 0.4]), Joint("rope", (0, 0, 1), spring=Spring(30.0, 0.5)))).position[:, 0, 2]
    middle = 0.5 - 0.3 * G / 30.0
    assert period(z - middle, 240) == pytest.approx(2 * np.pi * np.sqrt(0.3 / 30.0), rel=1e-3)


def test_two_bodies_on_a_rope_pull_each_other(rng: np.random.Generator) -> None:
    first = ball(np.zeros(3), None, name="first")
    second = ball(np.array([0.5, 0, 0]), Joint("rope", (0, 0, 0), to="first"), velocity=tuple(rng.uniform(-1, 1, 3)))
    trace = simulate(Scene((first, second), ground=None, gravity=(0, 0, 0)), 3.0)
    np.testing.assert_allclose(trace.velocity.sum(1) - trace.velocity[0].sum(0), 0, atol=1e-6)  # momentum
    assert np.linalg.norm(trace.position[:, 0] - trace.position[:, 1], axis=1).max() < 0.51


@pytest.mark.parametrize("kind", JOINT_KEYS)
@pytest.mark.parametrize("to", [None, "base"])
def test_a_scene_goes_on_from_a_later_state_as_it_would_have(kind: str, to: str | None) -> None:
    axis = (0.2, 1.0, 0.1) if "axis" in JOINT_KEYS[kind] else None
    spring = Spring(8.0, 0.1) if "axis" in JOINT_KEYS[kind] else None
    base = ball(np.array([0.0, 0.0, 1.0]), Joint("hinge", (-0.2, 0.0, 1.0), (0.0, 1.0, 0.0)), name="base")
    held = ball(
        np.array([0.3, 0.0, 1.1]), Joint(kind, (0.0, 0.0, 1.0), axis, spring=spring, damping=0.01, to=to), name="b"
    )
    scene = Scene((held, base), ground=None)
    whole = simulate(scene, 0.6)
    later = read_scene(write_scene(scene_at(scene, whole, 72)))
    np.testing.assert_allclose(
        simulate(later, 0.3).position, whole.position[72:], atol=2e-3 if kind == "rope" else 1e-4
    )


def test_the_text_of_a_joint_reads_back_equal_and_its_mjcf_moves_so_in_plain_mujoco() -> None:
    scene = load_scene(EXAMPLE)
    assert read_scene(write_scene(scene)) == scene
    model = compile_xml(scene_xml(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    mujoco.mj_step(model, data, nstep=240)
    mujoco.mj_kinematics(model, data)
    trace = simulate(scene)
    for i, o in enumerate(scene.objects):
        np.testing.assert_allclose(data.body(o.name).xpos, trace.position[-1, i], atol=1e-12)
    states = states_at(scene, np.array([0, 120, 240]))
    np.testing.assert_array_equal(states.position[0], trace.position[[0, 120, 240]])


def test_every_kind_of_joint_reads_back_equal() -> None:
    values = {"axis": (0, 0, 2), "end": (0.1, 0, 0.5), "spring": Spring(3.0, 0.2), "damping": 0.1, "friction": 0.2}
    for kind, keys in JOINT_KEYS.items():
        joint = Joint(kind, (0.1, 0, 1), **{k: values[k] for k in keys if k in values})  # type: ignore[arg-type]
        other = ball(np.zeros(3), Joint("rope", (1, 0, 0), length=2.0, to="b"), name="a")
        scene = Scene((other, ball(np.array([0.1, 0, 0.5]), joint, name="b")))
        assert read_scene(write_scene(scene)) == scene


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        ("objects[0].joint.kind=rail", r"objects\[0\].joint.kind: valid: 'hinge'"),
        ("objects[0].joint={kind: hinge, anchor: [0, 0, 1]}", r"objects\[0\].joint: a hinge needs an axis"),
        ("objects[0].joint={kind: rod, anchor: [0, 0, 1], axis: [0, 0, 1]}", "a rod has no axis; valid keys"),
        ("objects[0].joint={kind: rod}", r"objects\[0\].joint.anchor: missing key; needed: kind, anchor"),
        ("objects[0].joint={kind: rod, ancor: [0, 0, 1]}", "unknown key .*anchor"),
        ("objects[0].joint.anchor=[0, 1]", r"objects\[0\].joint.anchor: valid: a list of 3 numbers"),
        ("objects[0].joint.to=lowr", r"objects\[0\].joint.to: 'lowr' .*did you mean 'lower'"),
        ("objects[0].joint.to=lower", "form a circle"),
        ("objects[2].joint.length=0.1", r"objects\[2\].joint.length: the rope spans 0.2236 m at first"),
        ("objects[2].joint.spring={stiffness: 3}", "a rope with a spring has no length"),
        ("objects[1].velocity=[0, 0, 1]", r"objects\[1\].velocity: of a rod it is .*valid here: \[0, 0, 0\]"),
    ],
)
def test_a_wrong_joint_is_one_error_that_names_the_place(edit: str, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        edited(load_scene(EXAMPLE), [edit])


def test_a_velocity_that_a_hinge_or_slide_does_not_allow_is_an_error() -> None:
    for kind, values in (("slide", {"velocity": (0, 1, 0)}), ("hinge", {"angular_velocity": (0, 1, 0)})):
        scene = Scene((ball(np.zeros(3), Joint(kind, (0, 0, 0), (1, 0, 0)), **values),))  # type: ignore[arg-type]
        with pytest.raises(SceneError, match=rf"objects\[0\].*of a {kind} it is along the axis"):
            read_scene(write_scene(scene))


def test_a_batch_of_scenes_with_joints_moves_as_each_of_them_does() -> None:
    scene = load_scene(EXAMPLE)
    scenes = [scene, edited(scene, ["gravity=5"]), edited(scene, ["objects[0].mass=3"])]
    steps = np.array([0, 60, 120])
    states = BatchSimulator(scene.shapes, True, 4, 1).run(stack_scenes(scenes), steps)
    assert states.valid.all()
    for position, own in zip(states.position, scenes, strict=True):
        np.testing.assert_allclose(position, simulate(own, 0.5).position[steps], atol=1e-9)


def test_without_its_joint_a_body_falls_freely() -> None:
    free = replace(load_scene(EXAMPLE), ground=None).without_joints()
    assert simulate(free, 0.4).position[-1, 0, 2] == pytest.approx(1.5 - 0.5 * G * 0.16, abs=0.02)
