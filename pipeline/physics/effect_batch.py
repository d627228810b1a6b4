"""Batches of scenes with effects, through `mujoco.batch`, beside the quicker batches without any (`batch`).

Each scene is compiled, so that what MuJoCo has of an effect is as its compiler makes it; the rest is applied as forces,
for all scenes at once, before each step.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mujoco import batch as mjbatch

from pipeline.physics.batch import States
from pipeline.physics.effect_forces import (
    HalfwayVelocity,
    RecentNormalForce,
    applied_by_us,
    chosen_effects,
    ground_forces,
    needs_contacts,
    other_centres,
    resting_body,
    total_force,
)
from pipeline.physics.simulate import compile_xml
from pipeline.scene.effects.body import Body
from pipeline.scene.mjcf import STEPS_PER_SECOND, scene_xml
from pipeline.scene.rotation import rotate
from pipeline.scene.scene import Scene


def run_with_effects(scenes: Sequence[Scene], steps: np.ndarray, threads: int) -> States:
    """States of B scenes at the given increasing `steps` (T,) of 1/240 s each; the initial state is step 0.

    The scenes share their objects' shapes and names, whether they have a ground, and their effects' names and objects;
    numbers differ.
    """
    models = [compile_xml(scene_xml(scene)) for scene in scenes]
    effects, body = chosen_effects(scenes, applied_by_us), resting_body(scenes)
    in_contact = needs_contacts(effects)
    normal, halfway = RecentNormalForce(), HalfwayVelocity()
    batch = mjbatch.Batch(models[0], nsim=len(scenes), nthread=threads, persistent=in_contact)
    batch.set_models(models)
    batch.reset(keyframe=0)
    count = len(scenes[0].objects)
    qpos, qvel, time = batch.bind("qpos"), batch.bind("qvel"), batch.bind("time")
    push = batch.bind("xfrc_applied")
    offset = np.array([m.body_ipos[1:] for m in models])  # (B, N, 3), of the centres of mass in their bodies
    history = np.empty((len(scenes), len(steps), count * 7))
    for step in range(int(steps[-1]) + 1):
        history[:, steps == step] = qpos[:, None]
        if effects and step < steps[-1]:
            _now(body, qpos, qvel, offset, step)
            body.velocity = halfway.after(body.velocity)
            if in_contact:
                each = [ground_forces(models[i], batch.get_data(i), count) for i in range(len(scenes))]
                body.normal_force = normal.after(np.array(each))
            push[:, 1:, :3] = total_force(effects, body)
        if step < steps[-1]:
            batch.step()
    valid = np.isclose(time.reshape(-1), steps[-1] / STEPS_PER_SECOND, rtol=0, atol=1e-9)
    valid &= np.isfinite(history).all((1, 2))
    history[~valid] = history[~valid, :1]
    states = history.reshape(len(scenes), len(steps), count, 7)
    return States(np.ascontiguousarray(states[..., :3]), np.ascontiguousarray(states[..., 3:]), valid)


def _now(body: Body, qpos: np.ndarray, qvel: np.ndarray, offset: np.ndarray, step: int) -> None:
    """Bring the bodies up to date with the states of the batch."""
    shape = offset.shape[:2]
    poses, rates = np.array(qpos).reshape(*shape, 7), np.array(qvel).reshape(*shape, 6)
    spin, arm = rotate(poses[..., 3:], rates[..., 3:]), rotate(poses[..., 3:], offset)
    body.time = np.full(shape, step / STEPS_PER_SECOND)
    body.position = poses[..., :3] + arm
    body.velocity = rates[..., :3] + np.cross(spin, arm)
    body.angular_velocity = spin
    body.others = other_centres(body.position)
