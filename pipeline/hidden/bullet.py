"""Hidden motion by Bullet (the extra `benchmark`): balls and boxes with effects as forces, 240 steps per second."""

from __future__ import annotations

import numpy as np

from pipeline.hidden.events import body_at
from pipeline.physics.effect_forces import HalfwayVelocity, chosen_effects, resting_body, total_force, with_force
from pipeline.scene.effects.contact_damping import restitution_of
from pipeline.scene.scene import Scene, half_extents

RATE = 240


def run_bullet(scene: Scene, seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions (S, N, 3), quaternions (S, N, 4) and angular velocities (S, N, 3), RATE a second, past `seconds`.

    Bullet multiplies the two bodies' friction and restitution, so that those of the ground are 1.
    Raises ImportError where Bullet is not installed.
    """
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

    world = BulletClient(connection_mode=pybullet.DIRECT)
    try:
        world.setTimeStep(1 / RATE)
        world.setGravity(*scene.gravity)
        if scene.ground is not None:
            plane = world.createMultiBody(
                0, world.createCollisionShape(pybullet.GEOM_PLANE), basePosition=[0, 0, scene.ground]
            )
            world.changeDynamics(plane, -1, lateralFriction=1.0, restitution=1.0)
        bodies = [_add(world, pybullet, o) for o in scene.objects]
        effects, body, halfway = chosen_effects([scene], with_force), resting_body([scene]), HalfwayVelocity()
        history = []
        for step in range(int(np.ceil(seconds * RATE)) + 2):
            poses = [world.getBasePositionAndOrientation(b) for b in bodies]
            rates = [world.getBaseVelocity(b) for b in bodies]
            x, v, w = (
                np.array(rows, float)[None]
                for rows in ([p[0] for p in poses], [r[0] for r in rates], [r[1] for r in rates])
            )
            history.append((x[0], np.array([p[1] for p in poses])[:, [3, 0, 1, 2]], w[0]))
            body_at(body, step / RATE, x, halfway.after(v), w)
            for b, force, place in zip(bodies, total_force(effects, body)[0], x[0], strict=True):
                world.applyExternalForce(b, -1, force.tolist(), place.tolist(), pybullet.WORLD_FRAME)
            world.stepSimulation()
    finally:
        world.disconnect()
    position, quaternion, spin = (np.array(c) for c in zip(*history, strict=True))
    return position, quaternion, spin


def _add(world, pybullet, obj) -> int:  # type: ignore[no-untyped-def]
    half = half_extents(obj)
    if obj.shape == "sphere":
        shape = world.createCollisionShape(pybullet.GEOM_SPHERE, radius=half[0])
    elif obj.shape == "cylinder":
        shape = world.createCollisionShape(pybullet.GEOM_CYLINDER, radius=half[0], height=2 * half[2])
    else:
        shape = world.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half.tolist())
    w, x, y, z = obj.orientation
    number = world.createMultiBody(obj.mass, shape, basePosition=obj.position, baseOrientation=[x, y, z, w])
    world.resetBaseVelocity(number, obj.velocity, obj.angular_velocity)
    world.changeDynamics(
        number,
        -1,
        lateralFriction=obj.sliding_friction,
        restitution=restitution_of(obj.damping),
        linearDamping=0,
        angularDamping=0,
        rollingFriction=obj.rolling_friction,
    )
    return int(number)
