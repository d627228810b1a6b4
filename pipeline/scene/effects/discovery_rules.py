"""How an effect is discovered, where that differs from the default, and the plain data that these rules are given.

By default an effect's parameters start at no effect and are fitted by least squares to the motion along arcs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np

Number = float | list[float]
Numbers = dict[str, Number]
"""Parameter -> number, or list of the components of a vector."""


class Need(StrEnum):
    """What measurements must show for an effect to be testable."""

    SPIN = "spin"  # measured spins that are not zero
    GROUND_SPIN = "ground spin"  # spins measured on the ground
    ORIENTATION = "orientation"  # orientations in the air
    OTHERS = "others"  # several objects in a clip
    GROUND_BALL = "ground ball"  # a ball on the ground
    DIRECTIONS = "directions"  # more than one coordinate; vector parameters always need it


@dataclass(frozen=True)
class Observed:
    """Where and when bodies were measured: positions (n, 3) m; first, last: times, s."""

    positions: np.ndarray
    first: float
    last: float


@dataclass(frozen=True)
class Start:
    """Where a fit of an effect begins.

    centre (k,): the effect's numbers, in order, without effect. directions (d, k): small changes that switch the effect
    on, in which its force is linear.
    """

    centre: np.ndarray
    directions: np.ndarray


@dataclass(frozen=True)
class Hits:
    """Velocity jumps of h bodies as hits by something unseen.

    Attributes:
        position: (h, 3) m, centre of the body.
        normal: (h, 3) unit vector of the change of velocity.
        radius: (h,) m, of the body.
        position_error: (h,) m, standard error along the path.
        normal_error: (h,) rad, standard error.
    """

    position: np.ndarray
    normal: np.ndarray
    radius: np.ndarray
    position_error: np.ndarray
    normal_error: np.ndarray


@dataclass(frozen=True)
class HitFit:
    """An effect fitted to hits.

    Attributes:
        values: Of the parameters.
        errors: Standard errors; None where the hits do not determine the value.
        misfit: Root mean square distance of the contacts from the effect's surface, m.
        count: Number of hits that it explains.
    """

    values: Numbers
    errors: Mapping[str, Number | None]
    misfit: float
    count: int


@dataclass(frozen=True)
class GravityScale:
    """Of an effect that only scales the gravity that a free flight shows.

    weakens: whether the effect with these parameters makes gravity seem weaker; only_weakens: it can do nothing else.
    """

    weakens: Callable[[Mapping[str, Any]], bool]
    only_weakens: bool = False


@dataclass(frozen=True)
class Experiment:
    """In which kind of experiment an effect was hidden: in the air; with one body; with sliding pucks; clips."""

    in_the_air: bool
    one_body: bool
    sliding: bool
    clips: int


@dataclass(frozen=True)
class DiscoveryRules:
    """What is special about the discovery of an effect.

    Attributes:
        needs: What measurements must show.
        needs_known: Contact numbers of the scene that must be known: left free, they could stand for the effect.
        scene_parameter: The number of the scene that is the effect by another name.
        starts: Where fits begin, for a force that is not linear in the parameters near no effect.
        starts_apart: Whether fits begin at several places that are well apart (the first three numbers).
        fit_hits: Fits the effect to velocity jumps instead of to arcs; None where the hits do not allow it.
        of_a_body: Whether its numbers are a body's own: bodies that were recorded one by one may differ in them.
        unmeasured_spin: Radius of a ball, m -> the effect's parameters by convention, with which it is tried where no
            spin was measured. Each flight then has an unknown spin.
        local: Whether only a part of the world can show it: everywhere, a free number of the scene is the same.
        must_beat_shuffled_spins: Whether the measured spins must explain more than the spins of other clips.
        canonical: (values, errors, fitted scene parameters) -> the preferred one of equivalent descriptions.
        other_evidence: (values, errors, frame rate) -> 1 where something beside the motion speaks for the effect,
            -1 where it speaks against it, else 0.
        gravity_scale: Of an effect that only scales gravity.
        contains: Name of the effect that this one is, where the parameters that only this one has are neutral.
        equals: (parameters, experiment) -> names of effects that are the same law in that experiment.
    """

    needs: tuple[Need, ...] = ()
    needs_known: tuple[str, ...] = ()
    scene_parameter: str | None = None
    starts: Callable[[Observed], Sequence[Start]] | None = None
    starts_apart: bool = False
    fit_hits: Callable[[Hits], HitFit] | None = None
    of_a_body: bool = False
    unmeasured_spin: Callable[[float], Mapping[str, float]] | None = None
    local: bool = False
    must_beat_shuffled_spins: bool = False
    canonical: Callable[[Numbers, Numbers, Sequence[str]], tuple[Numbers, Numbers]] | None = None
    other_evidence: Callable[[Numbers, Numbers, float], int] | None = None
    gravity_scale: GravityScale | None = None
    contains: str | None = None
    equals: Callable[[Mapping[str, Any], Experiment], frozenset[str]] | None = None


DEFAULT = DiscoveryRules()
