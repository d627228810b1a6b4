"""What an effect's module declares: its law, its parameters, and how it is discovered and hidden."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import numpy as np

from pipeline.scene.effects.body import Body
from pipeline.scene.effects.discovery_rules import DEFAULT, DiscoveryRules
from pipeline.scene.effects.fluid import Fluid
from pipeline.scene.effects.hiding import Hiding
from pipeline.scene.effects.region import Region, share_within
from pipeline.scene.scene import Scene

Values = Mapping[str, np.ndarray]
"""Parameters by name: numbers (...), vectors (..., 3), which broadcast against the leading shape of a `Body`."""
Law = Callable[[Values, Body], np.ndarray]
Edit = Callable[[Any, Scene, Mapping[str, Any], tuple[str, ...]], None]
Collide = Callable[[Values, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Regime(StrEnum):
    """What a body is doing."""

    FLIGHT = "flight"
    IMPACT = "impact"
    SLIDING = "sliding"
    ROLLING = "rolling"
    SPINNING = "spinning"
    RESTING = "resting"


GROUNDED = (Regime.SLIDING, Regime.ROLLING, Regime.SPINNING, Regime.RESTING)
EVERYWHERE = (Regime.FLIGHT, *GROUNDED)


@dataclass(frozen=True)
class Parameter:
    """A number or a vector of an effect.

    Attributes:
        name: As in a scene's YAML.
        unit: In plain text.
        length: Number of components; 1: a number.
        low: Lower bound of each component.
        high: Upper bound of each component.
        scale: A size that matters in everyday motion; fits take their steps from it.
        neutral: The value without effect.
        stated: The value without effect in a given scene, where it depends on the scene.
        physical: The range outside of which no such thing is, where it is narrower than the bounds; a fit that ends at
            an end of it, or at a bound, rejects the effect.
        period: By which a direction may be changed without changing the law.
    """

    name: str
    unit: str
    length: int = 1
    low: float = -math.inf
    high: float = math.inf
    scale: float = 1.0
    neutral: float = 0.0
    stated: Callable[[Scene], float] | None = None
    physical: tuple[float, float] | None = None
    period: float | None = None

    @property
    def possible(self) -> tuple[float, float]:
        """The physical range, else the bounds."""
        return self.physical or (self.low, self.high)


@dataclass(frozen=True)
class EffectKind:
    """A law with a name. The functions that are not None say what it does.

    Attributes:
        name: As in a scene's YAML; the name of the module.
        formula: The law as text.
        parameters: Of the law.
        regimes: In which it can be seen.
        experiment: What would tell it from effects that look the same.
        force: (values, body) -> (..., 3) N on the centre of mass.
        torque: (values, body) -> (..., 3) N m.
        air_velocity: (values, body) -> (..., 3) m/s.
        ground_velocity: (values, body) -> (..., 3) m/s.
        normal_force: (values, body) -> (...) N that presses the body on what it touches, beside its weight.
        rolling_friction: (values) -> (...) m, added to the body's own.
        bounce_ratio: (values) -> (...) normal speed after over before an impact with the ground. The effect is fitted
            to the bounces, and must have this ratio as its only parameter.
        collide: (values, positions, velocities, radii) -> velocities, after hits on what the effect puts in the way.
        mass_offset: (values) -> (..., 3) m, the centre of mass in the body's frame.
        edit: Writes the effect into an MJCF document, where MuJoCo has it; its force is then not applied.
        fluid: The effect as numbers of MuJoCo's fluid, where it has it so; its force is then not applied.
        patch_force: (values, body) -> (..., 3) N by which a simulation has the effect in a part of the world, where
            neither `force` nor `torque` says it.
        recording: (values, times, positions) -> those that a recording shows; such an effect is not physics.
        kick: (values) -> time (...) s and momentum (..., 3) N s of a blow.
        discovery: How it is discovered.
        hiding: How it is hidden in worlds for the blind benchmark; None: it is not.
        only: Where it acts; None: everywhere.
        bodies: Indices of the objects on which it acts; None: all.
    """

    name: str
    formula: str
    parameters: tuple[Parameter, ...]
    regimes: tuple[Regime, ...]
    experiment: str
    force: Law | None = None
    torque: Law | None = None
    air_velocity: Law | None = None
    ground_velocity: Law | None = None
    normal_force: Law | None = None
    rolling_friction: Callable[[Values], np.ndarray] | None = None
    bounce_ratio: Callable[[Values], np.ndarray] | None = None
    collide: Collide | None = None
    mass_offset: Callable[[Values], np.ndarray] | None = None
    edit: Edit | None = None
    fluid: Callable[[Mapping[str, Any]], Fluid] | None = None
    patch_force: Law | None = None
    recording: Callable[[Values, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None
    kick: Callable[[Values], tuple[np.ndarray, np.ndarray]] | None = None
    discovery: DiscoveryRules = DEFAULT
    hiding: Hiding | None = None
    only: Region | None = None
    bodies: tuple[int, ...] | None = None

    @property
    def size(self) -> int:
        """Number of components of all parameters."""
        return sum(p.length for p in self.parameters)

    @property
    def fitted_to_arcs(self) -> bool:
        """Whether its parameters are fitted to the motion along arcs, and not to bounces or hits."""
        return self.bounce_ratio is None and self.discovery.fit_hits is None

    @property
    def may_be_local(self) -> bool:
        """Whether it is a force, so that it may act in a part of the world."""
        others = (self.bounce_ratio, self.collide, self.mass_offset, self.recording, self.kick, self.rolling_friction)
        return all(law is None for law in others)

    @property
    def is_single_blow(self) -> bool:
        """Whether it may be a single blow, which only several blows tell from other such effects."""
        return self.kick is not None or self.discovery.fit_hits is not None


def local_kind(kind: EffectKind, region: Region, bodies: tuple[int, ...] | None = None) -> EffectKind:
    """The effect as it acts in a region only, on some bodies (None: all). MuJoCo has no such effect, so its force is
    applied."""
    edges = region.edges
    if not edges:
        return replace(kind, edit=None, fluid=None, only=region, bodies=bodies)
    assert kind.may_be_local

    def within(law: Law | None, vector: bool = True) -> Law | None:
        if law is None:
            return None

        def cut(values: Values, body: Body) -> np.ndarray:
            share = share_within(edges, body.time, body.position, body.velocity, body.step, body.gravity)
            return (share[..., None] if vector else share) * law(values, body)

        return cut

    return replace(
        kind,
        force=within(kind.force),
        torque=within(kind.torque),
        air_velocity=within(kind.air_velocity),
        ground_velocity=within(kind.ground_velocity),
        normal_force=within(kind.normal_force, vector=False),
        patch_force=within(kind.patch_force),
        edit=None,
        fluid=None,
        only=region,
        bodies=bodies,
    )
