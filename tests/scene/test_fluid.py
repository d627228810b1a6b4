"""MuJoCo's fluid says the laws of the air as they are, on bodies of any shape."""

import mujoco
import numpy as np
import pytest

from pipeline.scene.mjcf import scene_xml
from pipeline.scene.mjcf_effects import effects_outside_mjcf
from pipeline.scene.scene import Effect, Scene, SceneObject

BALL = SceneObject("sphere", (0.1,), 0.5, name="ball")
BRICK = SceneObject("box", (0.1, 0.2, 0.05), 0.2, position=(2, 0, 0), orientation=(0.9, 0.1, 0.4, 0.1), name="brick")
PAIR = Scene((BALL, BRICK), gravity=(0, 0, 0), ground=None)
K, C, S, WIND = 0.013, 0.21, -0.0017, np.array([1.0, -2.0, 0.5])


def law(name: str, objects: tuple[str, ...] | None = None, **values: object) -> Effect:
    return Effect(name, tuple(values.items()), objects)


DRAG, LINEAR = law("air_drag", coefficient=K), law("linear_drag", coefficient=C)
LIFT, AIR = law("magnus_lift", coefficient=S), law("wind", velocity=tuple(WIND), coefficient=K)


def in_the_fluid(effects: tuple[Effect, ...], v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """Forces and torques (2, 6) on the bodies at velocities v and spins w in their own frames, (2, 3)."""
    model = mujoco.MjModel.from_xml_string(
        scene_xml(Scene(PAIR.objects, gravity=(0, 0, 0), ground=None, effects=effects))
    )
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qvel[:] = np.concatenate([v, w], -1).ravel()
    mujoco.mj_forward(model, data)
    return data.qfrc_passive.reshape(2, 6)


def world(w: np.ndarray) -> np.ndarray:
    """Spins (2, 3) in the world frame."""
    from pipeline.scene.rotation import matrix_from_quaternion

    turns = matrix_from_quaternion(np.array([o.orientation for o in PAIR.objects]))
    return np.einsum("nij,nj->ni", turns, w)


def drag(u: np.ndarray) -> np.ndarray:
    return -K * np.linalg.norm(u, axis=-1, keepdims=True) * u


@pytest.mark.parametrize("speed", [0.01, 1.0, 100.0])
@pytest.mark.parametrize(
    ("effects", "force"),
    [
        ((DRAG,), lambda v, w: drag(v)),
        ((LINEAR,), lambda v, w: -C * v),
        ((LIFT,), lambda v, w: S * np.cross(w, v)),
        ((AIR,), lambda v, w: drag(v - WIND)),
        ((AIR, LIFT), lambda v, w: drag(v - WIND) + S * np.cross(w, v - WIND)),
    ],
    ids=["drag", "linear", "lift", "wind", "wind and lift"],
)  # fmt: skip
def test_the_fluids_force_is_the_law_and_there_is_no_torque(effects, force, speed: float) -> None:
    rng = np.random.default_rng(1)
    v, w = speed * rng.normal(size=(2, 3)), 10 * rng.normal(size=(2, 3))
    found, expected = in_the_fluid(effects, v, w), force(v, world(w))
    np.testing.assert_allclose(found[:, :3], expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(found[:, 3:], 0, atol=1e-9 * np.abs(expected).max())


def test_linear_drag_beside_quadratic_slows_a_spin_a_hundred_times_less_than_a_velocity() -> None:
    v, w = np.zeros((2, 3)), np.full((2, 3), 10.0)
    torque = in_the_fluid((DRAG, LINEAR), v, w)[0, 3:]
    moment = 0.4 * BALL.mass * 0.1**2
    assert np.abs(torque / moment / 10.0).max() < 0.01 * C / BALL.mass


def test_bodies_may_differ_in_linear_drag() -> None:
    v, w = np.ones((2, 3)), np.zeros((2, 3))
    found = in_the_fluid((law("linear_drag", ("ball",), coefficient=C),), v, w)[:, :3]
    np.testing.assert_allclose(found[0], -C, rtol=1e-9)
    np.testing.assert_allclose(found[1], 0, atol=1e-5 * C)
    both = (law("linear_drag", ("ball",), coefficient=C), law("linear_drag", ("brick",), coefficient=2 * C))
    np.testing.assert_allclose(in_the_fluid(both, v, w)[:, :3], [[-C] * 3, [-2 * C] * 3], rtol=1e-9)


def test_what_one_fluid_cannot_do_is_left_to_forces() -> None:
    def outside(*effects: Effect) -> tuple[int, ...]:
        return effects_outside_mjcf(Scene(PAIR.objects, effects=effects))

    assert outside(DRAG, LINEAR, LIFT, AIR) == ()
    assert outside(DRAG, law("linear_drag", ("ball",), coefficient=C)) == (1,)  # one viscosity for both bodies
    assert outside(DRAG, law("wind", ("ball",), velocity=(1.0, 0.0, 0.0), coefficient=K)) == (0, 1)  # one air
