"""An integrator without MuJoCo, for balls and flat pucks: forces by the midpoint rule, instantaneous impacts.

Impacts have Newton's restitution along the normal and Coulomb friction across it. A body whose rebound is slow stays on
the ground, where it slides, rolls and stops by Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.hidden.law_perturbation import NO_PERTURBATION, LawPerturbation
from pipeline.physics.effect_forces import (
    AppliedEffect,
    chosen_effects,
    other_centres,
    resting_body,
    total_force,
    with_force,
)
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.contact_damping import restitution_of
from pipeline.scene.scene import Scene

RATE = 960  # steps a second
LEAST_REBOUND = 0.06  # m/s: after a slower one the body stays on the ground


def run_events(
    scene: Scene, times: np.ndarray, perturbation: LawPerturbation = NO_PERTURBATION
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and angular velocities (T, N, 3) of a scene's spheres and cylinders at increasing `times` (T,) s."""
    body = resting_body([scene])
    x = np.array([o.position for o in scene.objects], float)[None]
    v = np.array([o.velocity for o in scene.objects], float)[None]
    w = np.array([o.angular_velocity for o in scene.objects], float)[None]
    effects, forces = chosen_effects([scene], lambda _: True), chosen_effects([scene], with_force)
    colliding = [e for e in effects if e.kind.collide is not None]
    reach = np.array([o.size[0] if o.shape == "sphere" else o.size[1] / 2 for o in scene.objects])[None]
    ground = _ground_of(scene, effects, body)
    impact = replace(ground, rolling=0 * ground.rolling)  # too short for rolling friction
    grounded = (x[..., 2] - reach - ground.height < 1e-6) & (np.abs(v[..., 2]) < LEAST_REBOUND)
    h, out_x, out_w, done = 1 / RATE, [], [], 0
    before_x, before_w, now = x, w, 0.0

    def acceleration(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        body_at(body, t, x, v, w)
        body.normal_force = np.where(grounded, body.mass * 9.81 + ground.press, 0.0)
        slope = 1 + perturbation.drag_slope * np.linalg.norm(v, axis=-1, keepdims=True)
        a = body.gravity + total_force(forces, body) * slope / body.mass[..., None]
        return a if perturbation.extra is None else a + perturbation.extra(t, x, v)

    while done < len(times):
        while done < len(times) and times[done] <= now + 1e-12:
            u = 1.0 if now == 0 else (times[done] - (now - h)) / h
            out_x.append((1 - u) * before_x[0] + u * x[0])
            out_w.append((1 - u) * before_w[0] + u * w[0])
            done += 1
        before_x, before_w = x, w
        a = acceleration(now, x, v)
        a = acceleration(now + h / 2, x + h / 2 * v, v + h / 2 * a)
        normal = np.maximum(-a[..., 2] * body.mass, 0) + ground.press
        after = v + h * a
        if grounded.any():
            after[..., 2] = np.where(grounded, 0.0, after[..., 2])
            after, w = _with_friction(after, w, body, ground, np.where(grounded, normal * h, 0.0))
        x, v = x + h / 2 * (v + after), after
        w = w * np.exp(-perturbation.spin_decay * h)
        now += h
        hits = (x[..., 2] < ground.height + reach) & (v[..., 2] < 0) & ~grounded
        if hits.any():
            rebound = -ground.bounce * v[..., 2]
            blow = body.mass * (rebound - v[..., 2])
            v = v.copy()
            v[..., 2] = np.where(hits, np.where(rebound > LEAST_REBOUND, rebound, 0.0), v[..., 2])
            x = x.copy()
            x[..., 2] = np.where(hits, ground.height + reach, x[..., 2])
            v, w = _with_friction(v, w, body, impact, np.where(hits, blow, 0.0))
            grounded = grounded | (hits & (rebound <= LEAST_REBOUND))
        for e in colliding:
            assert e.kind.collide is not None
            v = np.where(e.acts[:, None], e.kind.collide(e.values, x, v, reach), v)
    return np.array(out_x), np.array(out_w)


def body_at(body: Body, t: float, x: np.ndarray, v: np.ndarray, w: np.ndarray) -> None:
    """Write the states (1, N, 3) of a time, s, into `body`: m, m/s, rad/s."""
    body.time = np.full(x.shape[:-1], t)
    body.position, body.velocity, body.angular_velocity, body.others = x, v, w, other_centres(x)


@dataclass(frozen=True)
class _Ground:
    """How the ground acts on N bodies.

    Attributes:
        height: m; -inf without a ground.
        bounce: (1, N) restitution.
        press: (1, N) N that presses bodies on the ground, beside their weight.
        belt: (..., 3) m/s, velocity of the ground's surface.
        rolls: (1, N) bool, balls.
        rolling: (1, N) m, rolling friction.
    """

    height: float
    bounce: np.ndarray
    press: np.ndarray
    belt: np.ndarray
    rolls: np.ndarray
    rolling: np.ndarray


def _ground_of(scene: Scene, effects: Sequence[AppliedEffect], body: Body) -> _Ground:
    """The ground of a scene, with the effects that change it."""
    bounce = np.array([restitution_of(o.damping) for o in scene.objects])[None]
    belt, press = np.zeros(3), np.zeros(bounce.shape)
    rolling = np.array([[o.rolling_friction for o in scene.objects]])
    for e in effects:
        if e.kind.bounce_ratio is not None:
            bounce = np.where(e.acts, e.kind.bounce_ratio(e.values), bounce)
        if e.kind.ground_velocity is not None:
            belt = belt + np.where(e.acts[:, None], e.kind.ground_velocity(e.values, body), 0.0)
        if e.kind.normal_force is not None:
            press = press + np.where(e.acts, e.kind.normal_force(e.values, body), 0.0)
        if e.kind.rolling_friction is not None:
            rolling = rolling + np.where(e.acts, e.kind.rolling_friction(e.values), 0.0)
    return _Ground(
        height=-np.inf if scene.ground is None else scene.ground,
        bounce=bounce,
        press=press,
        belt=belt,
        rolls=np.array([o.shape == "sphere" for o in scene.objects])[None],
        rolling=rolling,
    )


def _with_friction(
    v: np.ndarray, w: np.ndarray, body: Body, ground: _Ground, normal_blow: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocities v (1, N, 3) m/s and w (1, N, 3) rad/s after Coulomb friction with the ground.

    normal_blow: (1, N) N s, impulse of the ground; 0 for bodies that do not touch it.
    """
    rolls, belt = ground.rolls, ground.belt
    radius = np.where(rolls, body.radius, 0.0)
    inertia = 0.4 * body.mass * np.where(rolls, body.radius, 1.0) ** 2
    slip = v - belt
    slip = np.stack([slip[..., 0] - w[..., 1] * radius, slip[..., 1] + w[..., 0] * radius, 0 * radius], -1)
    speed = np.linalg.norm(slip, axis=-1)
    stop = np.where(rolls, body.mass / 3.5, body.mass) * speed
    size = np.minimum(body.sliding_friction * normal_blow, stop)
    push = -(size / np.maximum(speed, 1e-12))[..., None] * slip
    v = v + push / body.mass[..., None]
    turn = np.stack([push[..., 1], -push[..., 0], 0 * size], -1) * (radius / inertia)[..., None]
    w = np.where(rolls[..., None], w + turn, w)
    tangential = np.linalg.norm(w[..., :2], axis=-1)
    loss = np.where(rolls, np.minimum(ground.rolling * normal_blow / inertia, tangential), 0.0)
    share = 1 - loss / np.maximum(tangential, 1e-12)
    return v, np.concatenate([w[..., :2] * share[..., None], w[..., 2:]], -1)
