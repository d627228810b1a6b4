"""Where fits of an effect begin: points of its parameter space, and the directions in which its force is linear
there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.model import neutral_value
from pipeline.discrepancy.stack import ArcStack
from pipeline.scene.effects.kind import EffectKind

Vector = np.ndarray
GRID = 8  # places along each axis, at which an attractor is tried


@dataclass(frozen=True)
class Start:
    """centre (k,): the effect's numbers, in order, without effect; directions (d, k): small changes that switch it
    on."""

    centre: Vector
    directions: Vector


def neutral(kind: EffectKind, known: KnownScene) -> Vector:
    """The effect's numbers where it has no effect."""
    return np.concatenate([np.full(p.length, neutral_value(kind, p.name, known)) for p in kind.parameters])


def starts(kind: EffectKind, known: KnownScene, stacks: Sequence[ArcStack]) -> list[Start]:
    """Those of `kind`; by default one, at no effect, with a direction for each of its numbers."""
    special = SPECIAL.get(kind.name)
    if special is not None:
        return special(stacks)
    scale = np.concatenate([np.full(p.length, p.scale) for p in kind.parameters])
    return [Start(neutral(kind, known), 0.05 * np.diag(scale))]


def _wind(stacks: Sequence[ArcStack]) -> list[Start]:
    out = []
    for speed in (1.5, 5.0):
        for angle in np.arange(8) * np.pi / 4:
            velocity = [speed * np.cos(angle), speed * np.sin(angle), 0.0]
            out.append(Start(np.array([*velocity, 0.0]), np.array([[0, 0, 0, 1e-4]])))
    return out


def _anisotropic(stacks: Sequence[ArcStack]) -> list[Start]:
    angles = (-np.pi / 4, 0.0, np.pi / 4, np.pi / 2)
    return [Start(np.array([1.0, a]), np.array([[-0.1, 0.0]])) for a in angles]


def _attractor(stacks: Sequence[ArcStack]) -> list[Start]:
    points = np.concatenate([s.position[s.weight.max(2) > 0] for s in stacks])
    low, high = points.min(0), points.max(0)
    pad = 0.2 * max(float((high - low).max()), 0.2)
    axes = [np.linspace(a - pad, b + pad, GRID if b - a > 0.05 else 2) for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    return [Start(np.array([*p, 0.0]), np.array([[0, 0, 0, 1e-3]])) for p in grid]


def _impulse(stacks: Sequence[ArcStack]) -> list[Start]:
    first = min(float(s.start.min()) for s in stacks)
    last = max(float((s.start + s.duration).max()) for s in stacks)
    times = np.linspace(first, last, 34)[2:-2]
    return [Start(np.array([t, 0, 0, 0]), np.hstack([np.zeros((3, 1)), 0.02 * np.eye(3)])) for t in times]


SPECIAL: dict[str, Callable[[Sequence[ArcStack]], list[Start]]] = {
    "wind": _wind,
    "anisotropic_friction": _anisotropic,
    "hidden_attractor": _attractor,
    "impulse": _impulse,
}
"""Effects whose force is linear in their parameters at certain points only."""
