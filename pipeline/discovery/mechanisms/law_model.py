"""A model of the mechanism: the user's, with free numbers and effects, as one vector of unknowns."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from pipeline.discovery.mechanisms.free_numbers import FreeNumber, written
from pipeline.discovery.mechanisms.kind import MechanismEffect, Place, Values
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.scene.effects.kind import Parameter

FIT = "fit"
"""Owner of the unknowns that the user lists."""
STEP = 1e-6  # of a parameter's size: the step of finite differences
WEAK = 300.0  # sizes: standard deviation of the prior that keeps undetermined numbers bounded


@dataclass(frozen=True)
class Acting:
    """An effect at one place."""

    kind: MechanismEffect
    place: Place

    def bounds(self, parameter: Parameter) -> tuple[float, float]:
        """Limits of a parameter's components."""
        own = {} if self.kind.bounds is None else self.kind.bounds(self.place)
        return own.get(parameter.name, (parameter.low, parameter.high))

    def neutral(self, parameter: Parameter) -> float:
        """The value without effect."""
        own = {} if self.kind.neutral is None else self.kind.neutral(self.place)
        return own.get(parameter.name, parameter.neutral)


@dataclass(frozen=True)
class Unknown:
    """One fitted number; size: one that matters, 0 where it is not changed by fits."""

    owner: str
    name: str
    low: float
    high: float
    size: float
    start: float


@dataclass(frozen=True)
class Variant:
    """A model with its numbers, ready to be simulated.

    Attributes:
        model: Compiled.
        frictions: (index of the velocity, values, law) of dry frictions that change at each step.
        controls: (index of the actuator, values, law) that change the controls.
        measured: Name of a joint -> (values, law) of its sensor, in order.
        sensor_lag: Name of a joint -> s.
        clock: Recorded time over true time.
    """

    model: mujoco.MjModel
    frictions: tuple[tuple[int, Values, Callable[[Values, float, float], float]], ...] = ()
    controls: tuple[tuple[int, Values, Callable[..., np.ndarray]], ...] = ()
    measured: dict[str, list[tuple[Values, Callable[[Values, np.ndarray], np.ndarray]]]] = field(default_factory=dict)
    sensor_lag: dict[str, float] = field(default_factory=dict)
    clock: float = 1.0


@dataclass(frozen=True)
class LawModel:
    """The unknowns of the free numbers and of the effects that act."""

    numbers: tuple[FreeNumber, ...]
    acting: tuple[Acting, ...] = ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All numbers, in order."""
        out = []
        for n in self.numbers:
            size = n.attribute.size(n.place, n.stated)
            out.append(Unknown(FIT, n.name, n.attribute.low, np.inf, size, n.stated))
        for a in self.acting:
            sizes = a.kind.sizes(a.place)
            for p in a.kind.parameters:
                low, high = a.bounds(p)
                out += [Unknown(a.kind.name, p.name, low, high, sizes[p.name], a.neutral(p))] * p.length
        return tuple(out)

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return len(self.numbers) + sum(a.kind.size for a in self.acting)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the effects, in the order in which they were added."""
        return tuple(dict.fromkeys(a.kind.name for a in self.acting))

    def values(self, theta: np.ndarray) -> list[Values]:
        """The parameters of each acting effect."""
        return [{name: theta[part] for name, part in self.columns(k).items()} for k in range(len(self.acting))]

    def columns(self, acting: int) -> dict[str, slice]:
        """Where the parameters of an acting effect are in the vector."""
        k = len(self.numbers) + sum(a.kind.size for a in self.acting[:acting])
        out = {}
        for p in self.acting[acting].kind.parameters:
            out[p.name] = slice(k, k + p.length)
            k += p.length
        return out

    def document(self, spec: mujoco.MjSpec, theta: np.ndarray, *, with_controls: bool = True) -> mujoco.MjSpec:
        """A copy of an MJCF document with the numbers written into it.

        with_controls: also delays and lags of actuators, which our own simulation applies to the logged controls: it
        then knows them at the beginning of each window.
        """
        out = spec.copy()
        written(out, self.numbers, theta[: len(self.numbers)])
        for a, values in zip(self.acting, self.values(theta), strict=True):
            if a.kind.edit is not None and (with_controls or a.kind.controls is None):
                a.kind.edit(out, a.place.name, values)
        return out

    def variant(self, mechanism: Mechanism, spec: mujoco.MjSpec, theta: np.ndarray) -> Variant:
        """The model with the numbers theta (G,)."""
        model = self.document(spec, theta, with_controls=False).compile()
        frictions, controls, lag, clock = [], [], {}, 1.0
        measured: dict[str, list[tuple[Values, Callable[[Values, np.ndarray], np.ndarray]]]] = {}
        for a, values in zip(self.acting, self.values(theta), strict=True):
            kind, name = a.kind, a.place.name
            if kind.friction is not None:
                frictions.append((mechanism.joint(name).velocity, values, kind.friction))
            if kind.controls is not None:
                controls.append((mechanism.actuators.index(name), values, kind.controls))
            if kind.measured is not None:
                measured.setdefault(name, []).append((values, kind.measured))
            if kind.sensor_lag is not None:
                lag[name] = kind.sensor_lag(values)
            if kind.clock is not None:
                clock *= kind.clock(values)
        return Variant(model, tuple(frictions), tuple(controls), measured, lag, clock)


def with_effect(model: LawModel, kind: MechanismEffect, places: Sequence[Place]) -> LawModel:
    """The model with an effect at one place or more."""
    return LawModel(model.numbers, (*model.acting, *(Acting(kind, place) for place in places)))


def without_effect(model: LawModel, name: str) -> tuple[LawModel, np.ndarray]:
    """The model without an effect, and the indices of the remaining unknowns in the longer vector."""
    kept = np.array([i for i, u in enumerate(model.unknowns) if u.owner != name], int)
    return LawModel(model.numbers, tuple(a for a in model.acting if a.kind.name != name)), kept
