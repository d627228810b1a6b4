"""Something unseen and fixed stands in the way: a sphere of radius `size`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.discovery_rules import DiscoveryRules, Experiment, HitFit, Hits
from pipeline.scene.effects.hiding import Hiding, Launches
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene

LEAST_RADIUS = 0.005  # m
SIZE_GUESS, SIZE_SPREAD = 0.2, 0.3  # m: prior mean and standard deviation of the radius; one hit adds little to it
CONTACT_ERROR = 0.015  # m: bodies and contacts are not quite rigid; in MuJoCo bodies sink in by up to 0.04 at 8 m/s
MOST_OFF = 4.0  # standard errors by which a hit may be off the sphere
REBOUND = 0.6  # restitution of the sphere in hidden worlds


def collide(values: Values, position: np.ndarray, velocity: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """Velocities (..., 3) after hits on the smooth sphere; reach (...) m: radii of the bodies."""
    away = position - values["position"]
    distance = np.linalg.norm(away, axis=-1)
    normal = away / np.maximum(distance, 1e-12)[..., None]
    inwards = (velocity * normal).sum(-1)
    hit = (distance < reach + values["size"]) & (inwards < 0)
    return velocity - np.where(hit, (1 + REBOUND) * inwards, 0.0)[..., None] * normal


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    number = sum(geom.name is not None and geom.name.startswith("hidden_obstacle") for geom in root.worldbody.geom)
    root.worldbody.add(
        "geom",
        name=f"hidden_obstacle_{number}",
        type="sphere",
        size=[values["size"]],
        pos=values["position"],
        condim=6,
        rgba=[0.5, 0.5, 0.5, 0.3],
    )


def fit_hits(hits: Hits) -> HitFit:
    """The sphere that best explains the hits: its centre is the body's centre - (body's radius + size) normal.

    Hits that are far from what the others say (an outlier that looks like a jump) are left out one by one.
    """
    x, n, r = hits.position, hits.normal, hits.radius
    kept = np.ones(len(x), bool)
    while True:
        few = Hits(x[kept], n[kept], r[kept], hits.position_error[kept], hits.normal_error[kept])
        solution, covariance = _sphere(few)
        off = x - (r + solution[3])[:, None] * n - solution[:3]
        error = np.hypot(np.hypot(CONTACT_ERROR, hits.position_error), (r + solution[3]) * hits.normal_error)
        z = np.linalg.norm(off, axis=1) / error
        if z[kept].max() < MOST_OFF or kept.sum() == 1:
            break
        # of two hits the one with the less certain normal
        kept[np.argmax(np.where(kept, z if kept.sum() > 2 else hits.normal_error, -1))] = False
    misfit = float(np.sqrt(np.mean((off[kept] ** 2).sum(1))))
    freedom = 3 * int(kept.sum()) - 4
    scatter = np.sqrt(max(float((z[kept] ** 2).sum()) / freedom, 1.0)) if freedom > 2 else 1.0
    spread = scatter * np.sqrt(np.diag(covariance))
    size, size_error = max(float(solution[3]), LEAST_RADIUS), float(spread[3])
    return HitFit(
        values={"position": [float(v) for v in solution[:3]], "size": size},
        errors={
            "position": [float(v) for v in spread[:3]],
            "size": size_error if size_error < SIZE_SPREAD / 2 else None,  # else it is that of the prior
        },
        misfit=misfit,
        count=int(kept.sum()),
    )


def _sphere(hits: Hits) -> tuple[np.ndarray, np.ndarray]:
    """Centre and radius (4,) and their covariance, from x - r n = centre + radius n, which is linear in both."""
    x, n, r = hits.position, hits.normal, hits.radius
    design = np.concatenate([np.tile(np.eye(3), (len(x), 1)), n.reshape(-1, 1)], 1)
    target, size = (x - r[:, None] * n).ravel(), SIZE_GUESS
    prior = np.array([1e-4, 1e-4, 1e-4, 1 / SIZE_SPREAD**2])
    for _ in range(3):
        error = np.hypot(np.hypot(CONTACT_ERROR, hits.position_error), (r + size) * hits.normal_error)
        weight = np.repeat(1 / error**2, 3)
        covariance = np.linalg.inv(design.T @ (weight[:, None] * design) + np.diag(prior))
        solution = covariance @ (design.T @ (weight * target) + prior * np.array([*x.mean(0), SIZE_GUESS]))
        size = max(float(solution[3]), LEAST_RADIUS)
    return solution, covariance


def equals(effect: Mapping[str, Any], experiment: Experiment) -> frozenset[str]:
    """In a single clip a hit may be a blow; of several clips a blow is sought at one time of all."""
    return frozenset({"impulse"}) if experiment.clips == 1 else frozenset()


def draw(launches: Launches, strength: float, sign: float, rng: np.random.Generator) -> dict[str, Any]:
    """A sphere in the way of some of the bodies: the weaker, the smaller."""
    size = {3: 0.12, 10: 0.25}.get(round(strength), 0.45)
    bodies = launches[int(rng.integers(len(launches)))]
    b, t = bodies[0], float(rng.uniform(0.35, 0.6))
    path = np.array(b.position) + t * np.array(b.velocity) - np.array([0, 0, 9.81 / 2 * t * t])
    velocity = np.array(b.velocity) - np.array([0, 0, 9.81 * t])
    aside = rng.normal(size=3) * 0.25
    ahead = velocity / np.linalg.norm(velocity) + aside
    place = path + ahead / np.linalg.norm(ahead) * (size + b.size[0])
    return {"position": tuple(place), "size": size}


EFFECT = EffectKind(
    name="hidden_obstacle",
    formula="a fixed sphere",
    parameters=(
        Parameter("position", "m", length=3, scale=0.2),
        Parameter("size", "m", low=1e-4, high=10, scale=0.05, neutral=0.05, physical=(LEAST_RADIUS, 10)),
    ),
    regimes=(Regime.IMPACT,),
    experiment="send more bodies past the place from other sides",
    collide=collide,
    edit=edit,
    discovery=DiscoveryRules(fit_hits=fit_hits, equals=equals),
    hiding=Hiding(draw=draw, scenarios=("throw",), engines=("mujoco", "events")),
)
