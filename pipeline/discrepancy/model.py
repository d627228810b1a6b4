"""A model of the motion as a vector of numbers: the frictions of the known scene that are fitted, and effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.motion import ActingEffect, GroundFriction
from pipeline.discrepancy.stack import ArcStack
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.mjcf import TORSIONAL_FRICTION
from pipeline.scene.scene import Effect

#: Of balls: one that never stops slipping would look as if it rolled with resistance.
LEAST_FRICTION = 0.05


@dataclass(frozen=True)
class Unknown:
    """One number to fit. owner: `object:<index>`, or the name of an effect; component: of a vector, else 0. sigma:
    of the weak prior about `start` that keeps undetermined numbers from running away."""

    owner: str
    name: str
    component: int
    unit: str
    start: float
    low: float
    high: float
    step: float
    sigma: float


@dataclass(frozen=True)
class Model:
    """The unknowns of a set of effects on top of the known scene. stated: effects that the scene has already, with
    their numbers; objects: names, in order."""

    effects: tuple[EffectKind, ...]
    unknowns: tuple[Unknown, ...]
    stated: tuple[Effect, ...] = ()
    objects: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(e.name for e in self.effects)

    @property
    def size(self) -> int:
        return len(self.unknowns)

    @property
    def start(self) -> np.ndarray:
        return np.array([u.start for u in self.unknowns])

    def column(self, owner: str, name: str, component: int = 0) -> int | None:
        """Where a number stands in the vector; None where it is not fitted."""
        for i, u in enumerate(self.unknowns):
            if (u.owner, u.name, u.component) == (owner, name, component):
                return i
        return None

    def acting(self, stack: ArcStack, theta: np.ndarray) -> list[ActingEffect]:
        """The effects with the values of theta (P, G)."""
        out = []
        everywhere = np.ones(len(stack), bool)
        for kind in self.effects:
            values: dict[str, np.ndarray] = {}
            for p in kind.parameters:
                columns = [i for c in range(p.length) if (i := self.column(kind.name, p.name, c)) is not None]
                assert len(columns) == p.length
                rows = theta[:, columns]  # (P, length)
                shape = (len(theta), len(stack))
                values[p.name] = (
                    np.broadcast_to(rows, shape)
                    if p.length == 1
                    else np.broadcast_to(rows[:, None], (*shape, p.length))
                )
            out.append(ActingEffect(kind, values, everywhere))
        return [*out, *self._stated(stack)]

    def _stated(self, stack: ArcStack) -> list[ActingEffect]:
        out = []
        for effect in self.stated:
            acts = np.array([effect.objects is None or self.objects[o] in effect.objects for o in stack.object])
            values = {name: np.array(value, float)[None, None] for name, value in effect.parameters}
            out.append(ActingEffect(effect_kinds()[effect.name], values, acts))
        return out

    def friction(self, stack: ArcStack, theta: np.ndarray) -> GroundFriction | None:
        """The frictions of theta (P, G) for bodies on the ground; None in the air."""
        if not stack.grounded:
            return None
        shape = (len(theta), len(stack))
        sliding, rolling = (np.array(np.broadcast_to(v, shape)) for v in (stack.friction, stack.rolling))
        torsional = np.full(shape, TORSIONAL_FRICTION)
        for name, values in (("sliding_friction", sliding), ("rolling_friction", rolling), ("torsional", torsional)):
            for number in np.unique(stack.object):
                column = self.column(f"object:{number}", name)
                if column is not None:
                    values[:, stack.object == number] = theta[:, column, None]
        return GroundFriction(sliding, rolling, torsional)


def known_model(known: KnownScene, stacks: Sequence[ArcStack]) -> Model:
    """The model without any effect: what `fit` lists, of the objects that are on the ground at some time."""
    unknowns = []
    for stack in stacks:
        if not stack.grounded:
            continue
        for number in np.unique(stack.object):
            obj, owner = known.scene.objects[number], f"object:{number}"
            if "sliding_friction" in known.fit:
                mu = obj.sliding_friction
                least = LEAST_FRICTION if obj.shape == "sphere" else 0.0
                unknowns.append(Unknown(owner, "sliding_friction", 0, "-", max(mu, least), least, 10, 0.01, 1.0))
            if obj.shape == "sphere":
                if "rolling_friction" in known.fit:
                    unknowns.append(Unknown(owner, "rolling_friction", 0, "m", obj.rolling_friction, 0, 1, 1e-4, 0.05))
                mine = stack.object == number
                if (stack.spin_weight[mine] > 0).any():  # MuJoCo's own torsional friction, or none at all
                    unknowns.append(Unknown(owner, "torsional", 0, "m", TORSIONAL_FRICTION, 0, TORSIONAL_FRICTION, 2e-4,
                                            0.01))  # fmt: skip
    model = Model((), tuple(unknowns), known.scene.effects, tuple(o.name for o in known.scene.objects))
    return with_effect(model, effect_kinds()["gravity_error"], known) if "gravity" in known.fit else model


def without_effect(model: Model, name: str) -> tuple[Model, np.ndarray]:
    """The model without one of its effects, and where the numbers that stay stand in the longer vector."""
    kept = np.array([i for i, u in enumerate(model.unknowns) if u.owner != name], int)
    effects = tuple(e for e in model.effects if e.name != name)
    return replace(model, effects=effects, unknowns=tuple(model.unknowns[i] for i in kept)), kept


def with_effect(
    model: Model, kind: EffectKind, known: KnownScene, values: Mapping[str, np.ndarray] | None = None
) -> Model:
    """The model with one more effect, which starts at `values`, by default at no effect."""
    more = []
    for p in kind.parameters:
        neutral = np.full(p.length, neutral_value(kind, p.name, known))
        start = neutral if values is None else np.broadcast_to(values[p.name], (p.length,))
        for c in range(p.length):
            more.append(Unknown(kind.name, p.name, c, p.unit, float(np.clip(start[c], p.low, p.high)), p.low, p.high,
                                2e-3 * p.scale, 300 * p.scale))  # fmt: skip
    return replace(model, effects=(*model.effects, kind), unknowns=(*model.unknowns, *more))


def neutral_value(kind: EffectKind, name: str, known: KnownScene) -> float:
    """The value without effect: of gravity what was stated."""
    if kind.name == "gravity_error":
        return float(np.linalg.norm(known.scene.gravity))
    return next(p.neutral for p in kind.parameters if p.name == name)
