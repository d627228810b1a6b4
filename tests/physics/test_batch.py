"""Batches against one scene at a time."""

from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
import pytest
from sampled_scenes import draw

from pipeline.physics.batch import BatchSimulator, composition_model, scene_model, stack_scenes
from pipeline.physics.simulate import compile_xml, simulate, simulate_model
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import SIZE_KEYS, Effect, Scene, SceneObject

SHAPES = ("sphere", "box", "cylinder", "capsule", "ellipsoid")
#: Where bodies and cameras stand before the state is set: what a batch leaves as its composition has it.
PLACES = {"body_pos", "body_quat", "qpos0", "qpos_spring", "key_qpos", "key_qvel", "body_ipos", "dof_length"}


def random_scene(rng: np.random.Generator, shapes: tuple[str, ...], ground: float | None = 0.0) -> Scene:
    objects = []
    for i, shape in enumerate(shapes):
        size = rng.uniform(0.1, 0.3, len(SIZE_KEYS[shape]))
        if shape == "capsule":
            size[1] += 2 * size[0]
        objects.append(
            SceneObject(
                shape,
                tuple(size),
                *rng.uniform(0.1, 1, 4),
                position=(i, 0, (ground or 0) + 0.8),
                velocity=tuple(rng.normal(size=3)),
                angular_velocity=tuple(rng.normal(size=3)),
                orientation=tuple(rng.normal(size=4)),
            )
        )
    return Scene(tuple(objects), gravity=(0.1, 0, -rng.uniform(2, 12)), ground=ground)


def model_fields(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    fields = {n: np.array(getattr(model, n)) for n in dir(model) if isinstance(getattr(model, n), np.ndarray)}
    fields |= {f"opt.{n}": np.array(getattr(model.opt, n)) for n in dir(model.opt) if n[0] != "_" and n != "__doc__"}
    return {k: v for k, v in fields.items() if v.dtype.kind in "fiu"}


def simulator_of(scenes: list[Scene], size: int | None = None) -> BatchSimulator:
    return BatchSimulator(scenes[0].shapes, scenes[0].ground is not None, size or len(scenes), 1)


@pytest.mark.parametrize("ground", [0.0, None])
def test_the_fields_of_a_row_are_those_of_the_compiled_scene(rng: np.random.Generator, ground: float | None) -> None:
    first, second = (random_scene(rng, SHAPES, ground) for _ in range(2))
    if ground is not None:
        second = replace(second, ground=0.25)
    simulator = simulator_of([first, second])
    simulator.load(stack_scenes([first, second]))
    shared = model_fields(composition_model(SHAPES, ground is not None))
    for row, scene in enumerate((first, second)):
        compiled = model_fields(compile_xml(scene_xml(scene)))
        differing = {name for name in compiled if not np.array_equal(compiled[name], shared[name])} - PLACES
        assert {"geom_size", "body_inertia", "geom_solref", "geom_friction", "body_mass", "geom_rbound"} <= differing
        for model in (simulator._batch.get_model(row), scene_model(scene)):
            own = model_fields(model)
            for name in compiled.keys() - PLACES:
                np.testing.assert_allclose(own[name], compiled[name], rtol=1e-9, atol=1e-12, err_msg=name)


def test_a_model_without_mjcf_moves_as_the_compiled_one(rng: np.random.Generator) -> None:
    for shapes in (SHAPES, SHAPES[:1]):
        scene = random_scene(rng, shapes, float(rng.uniform(-1, 1)))
        direct, compiled = simulate_model(scene_model(scene), 0.2), simulate(scene, 0.2)
        np.testing.assert_allclose(direct.position, compiled.position, atol=1e-6)
        np.testing.assert_allclose(direct.quaternion, compiled.quaternion, atol=1e-6)
        assert direct.contacts.step.tolist() == compiled.contacts.step.tolist()
    with pytest.raises(AssertionError, match="effects"):
        scene_model(replace(scene, effects=(Effect("linear_drag"),)))


def test_the_state_of_a_row_is_that_of_the_keyframe(rng: np.random.Generator) -> None:
    scene = random_scene(rng, SHAPES)
    simulator = simulator_of([scene])
    simulator.load(stack_scenes([scene]))
    model = compile_xml(scene_xml(scene))
    np.testing.assert_allclose(simulator._qpos[0], model.key_qpos[0], atol=1e-12)
    np.testing.assert_allclose(simulator._qvel[0], model.key_qvel[0], atol=1e-12)


def test_a_batch_moves_as_single_scenes_do_until_they_touch(rng: np.random.Generator) -> None:
    scenes = [random_scene(rng, SHAPES) for _ in range(4)]
    steps = np.arange(0, 40, 3)
    states = simulator_of(scenes).run(stack_scenes(scenes), steps)
    assert states.valid.all()
    for row, scene in enumerate(scenes):
        trace = simulate(scene, 0.2)
        np.testing.assert_allclose(states.position[row], trace.position[steps], atol=1e-9)
        np.testing.assert_allclose(states.quaternion[row], trace.quaternion[steps], atol=1e-9)


def test_a_batch_lands_and_slides_as_single_scenes_do(rng: np.random.Generator) -> None:
    scenes = []
    for _ in range(4):
        ball = SceneObject(
            "sphere",
            (rng.uniform(0.05, 0.2),),
            *rng.uniform(0.2, 1, 4),
            position=(0, 0, 0.3),
            velocity=(1, rng.normal(), 0),
            angular_velocity=tuple(rng.normal(size=3)),
        )
        brick = SceneObject(
            "box", (0.4, 0.4, 0.1), *rng.uniform(0.2, 1, 4), position=(1, 0, 0.051), velocity=(0.5, 1, 0)
        )
        scenes.append(Scene((ball, brick)))
    states = simulator_of(scenes).run(stack_scenes(scenes), np.arange(0, 121, 8))
    for row, scene in enumerate(scenes):
        trace = simulate(scene, 0.5)
        np.testing.assert_allclose(states.position[row], trace.position[::8], atol=2e-3)


def test_a_row_does_not_depend_on_its_neighbours_or_its_place(rng: np.random.Generator) -> None:
    scenes = [random_scene(rng, ("box", "sphere")) for _ in range(6)]
    steps = np.arange(0, 241, 20)
    together = simulator_of(scenes).run(stack_scenes(scenes), steps)
    alone = simulator_of(scenes[:1]).run(stack_scenes(scenes[3:4]), steps)
    backwards = simulator_of(scenes, 9).run(stack_scenes(scenes[::-1]), steps)
    np.testing.assert_array_equal(alone.position[0], together.position[3])
    np.testing.assert_array_equal(backwards.position[::-1], together.position)


def test_a_simulator_that_is_used_again_gives_the_same(rng: np.random.Generator) -> None:
    scenes, others = ([random_scene(rng, ("box", "box")) for _ in range(3)] for _ in range(2))
    simulator, steps = simulator_of(scenes), np.arange(0, 241, 40)
    first = simulator.run(stack_scenes(scenes), steps)
    simulator.run(stack_scenes(others[:2]), steps)
    second = simulator.run(stack_scenes(scenes), steps)
    np.testing.assert_array_equal(first.position, second.position)
    np.testing.assert_array_equal(first.quaternion, second.quaternion)


def test_threads_do_not_change_the_result(rng: np.random.Generator) -> None:
    scenes = [random_scene(rng, ("box", "cylinder")) for _ in range(5)]
    batch, steps = stack_scenes(scenes), np.arange(0, 241, 40)
    one, two = (BatchSimulator(("box", "cylinder"), True, 5, threads).run(batch, steps) for threads in (1, 2))
    np.testing.assert_array_equal(one.position, two.position)


def test_sampled_scenes_move_in_a_batch_as_alone(rng: np.random.Generator) -> None:
    """To the bit at first; where bodies hit each other, what the last bit does grows."""
    drawn = draw(int(rng.integers(2**31)), range(12), {2: 1.0}).scenes
    for scene in drawn:
        states = simulator_of([scene]).run(stack_scenes([scene]), np.arange(0, 241, 8))
        trace = simulate(scene)
        touch = trace.contacts.step[trace.contacts.second >= 0].min(initial=60) // 8
        np.testing.assert_allclose(states.position[0, :touch], trace.position[::8][:touch], atol=0.01)


@pytest.mark.parametrize("bad", [{"velocity": (1e12, 0, 0)}, {"velocity": (1e9, 0, 0)}, {"position": (0, 0, 1e11)}])
def test_an_unstable_row_is_invalid_and_the_others_continue(rng: np.random.Generator, bad: dict[str, Any]) -> None:
    good = Scene((SceneObject("sphere", (0.1,), 1.0, position=(0, 0, 1)),))
    gone = Scene((replace(good.objects[0], **bad),))
    states = simulator_of([good] * 3).run(stack_scenes([good, gone, good]), np.array([0, 100, 240]))
    assert states.valid.tolist() == [True, False, True]
    assert np.isfinite(states.position).all()
    np.testing.assert_array_equal(states.position[1], np.tile(gone.objects[0].position, (3, 1, 1)))
    np.testing.assert_array_equal(states.position[0], states.position[2])


def test_the_initial_state_is_step_zero(rng: np.random.Generator) -> None:
    scene = random_scene(rng, ("box",))
    states = simulator_of([scene]).run(stack_scenes([scene]), np.array([0]))
    np.testing.assert_array_equal(states.position[0, 0, 0], scene.objects[0].position)
    assert states.valid.all()
