"""An integrator without MuJoCo: balls and flat pucks, forces by the midpoint rule, impacts as instants.

Newton's restitution along the normal, Coulomb friction across it, for the ground and a hidden sphere; a body that
hardly leaves the ground any more stays on it and slides, rolls and stops by Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.physics.effect_forces import chosen_effects, other_centres, resting_body, total_force, with_force
from pipeline.scene.effects.body import Body
from pipeline.scene.effects.kinds.restitution import restitution_of
from pipeline.scene.scene import Scene

RATE = 960  # steps a second
STAYS = 0.06  # m/s: a slower rebound is none
Extra = Callable[[float, np.ndarray, np.ndarray], np.ndarray]


def run_events(
    scene: Scene, times: np.ndarray, drag_slope: float = 0.0, spin_decay: float = 0.0, extra: Extra | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Positions and angular velocities (T, N, 3) at `times`; drag_slope, spin_decay, extra: see `engine.Twist`."""
    body = resting_body([scene])
    x = np.array([o.position for o in scene.objects], float)[None]
    v = np.array([o.velocity for o in scene.objects], float)[None]
    w = np.array([o.angular_velocity for o in scene.objects], float)[None]
    values = {e.name: e.values for e in scene.effects}
    forces = chosen_effects([scene], with_force)
    reach = np.array([o.size[0] if o.shape == "sphere" else o.size[1] / 2 for o in scene.objects])[None]
    rolls = np.array([o.shape == "sphere" for o in scene.objects])[None]
    bounce = np.array([restitution_of(o.damping) for o in scene.objects])[None]
    if "restitution" in values:
        bounce = np.full_like(bounce, values["restitution"]["coefficient"])
    belt = np.array([*values.get("moving_ground", {}).get("velocity", (0.0, 0.0)), 0.0])
    press = float(values.get("adhesion", {}).get("force", 0.0))
    rolling = np.array([[o.rolling_friction for o in scene.objects]])
    rolling = rolling + values.get("rolling_resistance", {}).get("coefficient", 0.0)
    ground = -np.inf if scene.ground is None else scene.ground
    grounded = (x[..., 2] - reach - ground < 1e-6) & (np.abs(v[..., 2]) < STAYS)
    h, out_x, out_w, done = 1 / RATE, [], [], 0
    before_x, before_w, now = x, w, 0.0

    def acceleration(t: float, x: np.ndarray, v: np.ndarray) -> np.ndarray:
        body_at(body, t, x, v, w, grounded, press)
        slope = 1 + drag_slope * np.linalg.norm(v, axis=-1, keepdims=True)
        a = body.gravity + total_force(forces, body) * slope / body.mass[..., None]
        return a if extra is None else a + extra(t, x, v)

    while done < len(times):
        while done < len(times) and times[done] <= now + 1e-12:
            u = 1.0 if now == 0 else (times[done] - (now - h)) / h
            out_x.append((1 - u) * before_x[0] + u * x[0])
            out_w.append((1 - u) * before_w[0] + u * w[0])
            done += 1
        before_x, before_w = x, w
        a = acceleration(now, x, v)
        a = acceleration(now + h / 2, x + h / 2 * v, v + h / 2 * a)
        normal = np.maximum(-a[..., 2] * body.mass, 0) + press
        after = v + h * a
        if grounded.any():
            after[..., 2] = np.where(grounded, 0.0, after[..., 2])
            after, w = _rub(after, w, body, normal * h, belt, rolls, rolling, grounded)
        x, v = x + h / 2 * (v + after), after
        w = w * np.exp(-spin_decay * h)
        now += h
        hits = (x[..., 2] < ground + reach) & (v[..., 2] < 0) & ~grounded
        if hits.any():
            rebound = -bounce * v[..., 2]
            blow = body.mass * (rebound - v[..., 2])
            v = v.copy()
            v[..., 2] = np.where(hits, np.where(rebound > STAYS, rebound, 0.0), v[..., 2])
            x = x.copy()
            x[..., 2] = np.where(hits, ground + reach, x[..., 2])
            v, w = _rub(v, w, body, np.where(hits, blow, 0), belt, rolls, 0 * rolling, hits)
            grounded = grounded | (hits & (rebound <= STAYS))
        if "hidden_obstacle" in values:
            v = _off_sphere(x, v, reach, values["hidden_obstacle"])
    return np.array(out_x), np.array(out_w)


def body_at(
    body: Body, t: float, x: np.ndarray, v: np.ndarray, w: np.ndarray, grounded: np.ndarray, press: float
) -> None:
    """Bring the bodies to the states (1, N, 3) of time t; grounded (1, N): on the ground, pressed on by `press`."""
    body.time = np.full(x.shape[:-1], t)
    body.position, body.velocity, body.angular_velocity, body.others = x, v, w, other_centres(x)
    body.normal_force = np.where(grounded, body.mass * 9.81 + press, 0.0)


def _rub(
    v: np.ndarray, w: np.ndarray, body: Body, normal_blow: np.ndarray, belt: np.ndarray, rolls: np.ndarray,
    rolling: np.ndarray, touching: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Velocities after Coulomb friction for a blow of the ground, normal_blow (1, N) N s, on the bodies that touch
    it."""
    radius = np.where(rolls, body.radius, 0.0)
    inertia = 0.4 * body.mass * np.where(rolls, body.radius, 1.0) ** 2
    slip = v - belt
    slip = np.stack([slip[..., 0] - w[..., 1] * radius, slip[..., 1] + w[..., 0] * radius, 0 * radius], -1)
    speed = np.linalg.norm(slip, axis=-1)
    stop = np.where(rolls, body.mass / 3.5, body.mass) * speed
    size = np.where(touching, np.minimum(body.sliding_friction * normal_blow, stop), 0.0)
    push = -(size / np.maximum(speed, 1e-12))[..., None] * slip
    v = v + push / body.mass[..., None]
    turn = np.stack([push[..., 1], -push[..., 0], 0 * size], -1) * (radius / inertia)[..., None]
    w = np.where(rolls[..., None], w + turn, w)
    tangential = np.linalg.norm(w[..., :2], axis=-1)
    loss = np.where(touching & rolls, np.minimum(rolling * normal_blow / inertia, tangential), 0.0)
    share = 1 - loss / np.maximum(tangential, 1e-12)
    return v, np.concatenate([w[..., :2] * share[..., None], w[..., 2:]], -1)


def _off_sphere(x: np.ndarray, v: np.ndarray, reach: np.ndarray, values: dict[str, object]) -> np.ndarray:
    """Velocities after hits on a smooth fixed sphere."""
    away = x - np.array(values["position"], float)
    distance = np.linalg.norm(away, axis=-1)
    normal = away / np.maximum(distance, 1e-12)[..., None]
    inwards = (v * normal).sum(-1)
    hit = (distance < reach + float(values["size"])) & (inwards < 0)  # type: ignore[arg-type]
    return v - np.where(hit, 1.6 * inwards, 0.0)[..., None] * normal
