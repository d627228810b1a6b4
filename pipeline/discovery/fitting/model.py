"""A model of the motion: the parameters of the known scene that are fitted, and those of effects, as one vector."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.motion import ActingEffect, GroundFriction
from pipeline.discovery.tracks.known_scene import SCENE_FITTABLE, KnownScene
from pipeline.discovery.tracks.stack import ArcStack
from pipeline.scene.effects.kind import EffectKind, Parameter, local_kind
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds, kind_of_scene_parameter
from pipeline.scene.effects.text import effect_kind
from pipeline.scene.mjcf import TORSIONAL_FRICTION
from pipeline.scene.scene import Effect

LEAST_BALL_FRICTION = 0.05  # with less a ball never stops slipping, which looks like rolling resistance
OBJECT = "object:"
"""Begins the owner of an unknown that is an object's: `object:<index>`."""
REGION = "region:"
"""Begins the owner of an unknown that is of the region in which an effect acts: `region:<effect>`."""
REGION_STEP, REGION_SIGMA = 2e-3, 10.0  # s, m, m/s or rad, of finite differences, and of the weak prior
CAMERA = "camera"
"""Owner of the unknowns of the camera, in units of their standard deviations."""
MOST_SIGMAS = 6.0  # by which a number of the camera may be off


@dataclass(frozen=True)
class Unknown:
    """One fitted number.

    Attributes:
        owner: `object:<index>`, `camera`, or the name of an effect.
        name: Of the parameter.
        component: Of a vector; 0 of a number.
        unit: Of the parameter.
        start: Where fits begin.
        low: Lower bound.
        high: Upper bound.
        step: Of finite differences.
        sigma: Of the weak prior about `start`, which keeps undetermined numbers bounded.
        body: Index of the object whose own number of an effect it is; None: all objects share it.
    """

    owner: str
    name: str
    component: int
    unit: str
    start: float
    low: float
    high: float
    step: float
    sigma: float
    body: int | None = None


@dataclass(frozen=True)
class Model:
    """The unknowns of a set of effects on top of the known scene.

    Attributes:
        effects: Their kinds.
        unknowns: All fitted numbers, in order.
        stated: Effects that the known scene has, with their numbers.
        objects: Names of the objects, in order.
    """

    effects: tuple[EffectKind, ...]
    unknowns: tuple[Unknown, ...]
    stated: tuple[Effect, ...] = ()
    objects: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects."""
        return tuple(e.name for e in self.effects)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.unknowns)

    @property
    def start(self) -> np.ndarray:
        """Where a fit begins, (G,)."""
        return np.array([u.start for u in self.unknowns])

    def column(self, owner: str, name: str, component: int = 0, body: int | None = None) -> int | None:
        """Index of a number in the vector; None where it is not fitted."""
        for i, u in enumerate(self.unknowns):
            if (u.owner, u.name, u.component, u.body) == (owner, name, component, body):
                return i
        return None

    def columns(self, effect: str, parameter: Parameter, body: int | None) -> list[int]:
        """Indices of the components of an effect's parameter. body: of `bodies`."""
        found = (self.column(effect, parameter.name, c, body) for c in range(parameter.length))
        return [i for i in found if i is not None]

    def bodies(self, effect: str) -> tuple[int | None, ...]:
        """The objects that have their own numbers of an effect; only None where all share them."""
        return tuple(dict.fromkeys(u.body for u in self.unknowns if u.owner == effect))

    def acting(self, stack: ArcStack, theta: np.ndarray) -> list[ActingEffect]:
        """The effects with the parameters theta (P, G), and those of the known scene."""
        out = []
        for kind in self.effects:
            for body in self.bodies(kind.name):
                values: dict[str, np.ndarray] = {}
                for p in kind.parameters:
                    columns = self.columns(kind.name, p, body)
                    assert len(columns) == p.length
                    rows = theta[:, columns]  # (P, length)
                    shape = (len(theta), len(stack))
                    values[p.name] = (
                        np.broadcast_to(rows, shape)
                        if p.length == 1
                        else np.broadcast_to(rows[:, None], (*shape, p.length))
                    )
                acts = np.ones(len(stack), bool) if body is None else stack.object == body
                if kind.only is not None and kind.only.clips is not None:
                    acts &= np.isin(stack.clip, kind.only.clips)
                out.append(ActingEffect(self._where_it_acts(kind, theta), values, acts))
        return [*out, *self._stated(stack)]

    def region(self, kind: EffectKind, theta: np.ndarray) -> Region | None:
        """The region in which one of the effects acts, with the numbers of theta (..., G), each (...)."""
        columns = {u.name: i for i, u in enumerate(self.unknowns) if u.owner == f"{REGION}{kind.name}"}
        if kind.only is None or not columns:
            return kind.only
        return kind.only.moved({name: theta[..., i][()] for name, i in columns.items()})  # plain numbers of one theta

    def _where_it_acts(self, kind: EffectKind, theta: np.ndarray) -> EffectKind:
        """An effect as it acts in the region of theta (P, G)."""
        region = self.region(kind, theta[:, None])
        return (
            kind
            if region is None or region is kind.only
            else local_kind(effect_kinds()[kind.name], region, kind.bodies)
        )

    def _stated(self, stack: ArcStack) -> list[ActingEffect]:
        out = []
        for effect in self.stated:
            acts = np.array([effect.objects is None or self.objects[o] in effect.objects for o in stack.object])
            values = {name: np.array(value, float)[None, None] for name, value in effect.parameters}
            out.append(ActingEffect(effect_kind(effect), values, acts))
        return out

    @property
    def camera_columns(self) -> list[int]:
        """Indices of the camera's numbers."""
        return [i for i, u in enumerate(self.unknowns) if u.owner == CAMERA]

    def as_measured(self, stack: ArcStack, position: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Positions (P, A, n, 3) m as the camera of theta (P, G) would measure them."""
        if stack.camera_error is None:
            return position
        return position + stack.camera_error.shift(position, theta[:, self.camera_columns])

    def friction(self, stack: ArcStack, theta: np.ndarray) -> GroundFriction | None:
        """The frictions of theta (P, G) and of the scene, for bodies on the ground; None in the air."""
        if not stack.grounded:
            return None
        shape = (len(theta), len(stack))
        sliding, rolling = (np.array(np.broadcast_to(v, shape)) for v in (stack.friction, stack.rolling))
        torsional = np.full(shape, TORSIONAL_FRICTION)
        for name, values in (("sliding_friction", sliding), ("rolling_friction", rolling), ("torsional", torsional)):
            for number in np.unique(stack.object):
                column = self.column(f"{OBJECT}{number}", name)
                if column is not None:
                    values[:, stack.object == number] = theta[:, column, None]
        return GroundFriction(sliding, rolling, torsional)


def known_model(known: KnownScene, stacks: Sequence[ArcStack]) -> Model:
    """The model without effects: the parameters under `fit` of the objects that are on the ground at some time."""
    unknowns = []
    for stack in stacks:
        if stack.grounded:
            for number in np.unique(stack.object):
                mine = stack.object == number
                unknowns += _frictions(known, int(number), bool((stack.spin_weight[mine] > 0).any()))
    unknowns += _camera_numbers(stacks)
    model = Model((), tuple(unknowns), known.scene.effects, tuple(o.name for o in known.scene.objects))
    for parameter in SCENE_FITTABLE:
        kind = kind_of_scene_parameter(parameter)
        if parameter in known.fit and kind is not None:
            model = with_effect(model, kind, known)
    return model


def _camera_numbers(stacks: Sequence[ArcStack]) -> list[Unknown]:
    """The unknowns of the camera, by which positions were measured."""
    count = max((s.camera_error.count for s in stacks if s.camera_error is not None), default=0)
    names = (f"deviation_{k}" for k in range(count))
    return [
        Unknown(CAMERA, name, 0, "-", start=0.0, low=-MOST_SIGMAS, high=MOST_SIGMAS, step=0.05, sigma=1.0)
        for name in names
    ]


def _frictions(known: KnownScene, number: int, spins: bool) -> list[Unknown]:
    """The unknown frictions of an object. spins: whether its spin was measured on the ground."""
    obj, owner, out = known.scene.objects[number], f"{OBJECT}{number}", []
    ball = obj.shape == "sphere"
    if "sliding_friction" in known.fit:
        least = LEAST_BALL_FRICTION if ball else 0.0
        start = max(obj.sliding_friction, least)
        out.append(Unknown(owner, "sliding_friction", 0, "-", start=start, low=least, high=10, step=0.01, sigma=1.0))
    if ball and "rolling_friction" in known.fit:
        start = obj.rolling_friction
        out.append(Unknown(owner, "rolling_friction", 0, "m", start=start, low=0, high=1, step=1e-4, sigma=0.05))
    if ball and spins:  # MuJoCo's own torsional friction, or less
        most = TORSIONAL_FRICTION
        out.append(Unknown(owner, "torsional", 0, "m", start=most, low=0, high=most, step=2e-4, sigma=0.01))
    return out


def without_effect(model: Model, name: str) -> tuple[Model, np.ndarray]:
    """The model without one of its effects, and the indices of the remaining unknowns in the longer vector."""
    kept = np.array([i for i, u in enumerate(model.unknowns) if u.owner not in (name, f"{REGION}{name}")], int)
    effects = tuple(e for e in model.effects if e.name != name)
    return replace(model, effects=effects, unknowns=tuple(model.unknowns[i] for i in kept)), kept


def with_free_region(model: Model, region: Region) -> Model:
    """The model whose last effect acts in a region of which each number is fitted, from where it is."""
    owner = f"{REGION}{model.names[-1]}"
    more = [
        Unknown(owner, name, 0, unit, start=value, low=-np.inf, high=np.inf, step=REGION_STEP, sigma=REGION_SIGMA)
        for name, (value, unit) in region.free.items()
    ]
    return replace(model, unknowns=(*model.unknowns, *more))


def with_effect(
    model: Model,
    kind: EffectKind,
    known: KnownScene,
    values: Mapping[str, np.ndarray] | None = None,
    bodies: Sequence[int | None] = (None,),
) -> Model:
    """The model with one more effect.

    Args:
        model: Without the effect.
        kind: Of the effect.
        known: The known scene.
        values: Where fits begin, by default at no effect.
        bodies: Indices of the objects that have their own numbers; (None,): all share them. An effect that acts on
            some objects only has numbers of each.
    """
    more = []
    bodies = bodies if kind.bodies is None else kind.bodies
    for body, p in itertools.product(bodies, kind.parameters):
        neutral = np.full(p.length, neutral_value(p, known))
        start = neutral if values is None else np.broadcast_to(values[p.name], (p.length,))
        for c in range(p.length):
            more.append(
                Unknown(
                    owner=kind.name,
                    name=p.name,
                    component=c,
                    unit=p.unit,
                    start=float(np.clip(start[c], p.low, p.high)),
                    low=p.low,
                    high=p.high,
                    step=2e-3 * p.scale,
                    sigma=300 * p.scale,
                    body=body,
                )
            )
    return replace(model, effects=(*model.effects, kind), unknowns=(*model.unknowns, *more))


def neutral_value(parameter: Parameter, known: KnownScene) -> float:
    """The value of an effect's parameter without effect, which may depend on the scene."""
    return parameter.neutral if parameter.stated is None else parameter.stated(known.scene)
