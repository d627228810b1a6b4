"""Which effects may be asked for: by name, and by whether the measurements could show them at all."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import numpy as np

from pipeline.discovery.tracks.arc import FAR_AWAY
from pipeline.discovery.tracks.problem import Problem
from pipeline.errors import ParamsError, did_you_mean
from pipeline.scene.effects.discovery_rules import Need
from pipeline.scene.effects.kind import GROUNDED, EffectKind, Regime
from pipeline.scene.effects.registry import effect_kinds

LEAST_SPIN = 0.5  # rad/s


def names_of(text: str, place: str = "effects") -> tuple[str, ...]:
    """The effects that may be named.

    Args:
        text: "all", or names with commas between.
        place: What has this value, for the error.

    Raises:
        ParamsError: For another name.
    """
    return names_among(text, effect_kinds(), place)


def names_among(text: str, known: Collection[str], place: str) -> tuple[str, ...]:
    """As `names_of`, of the effects `known`."""
    if text == "all":
        return tuple(known)
    names = [n.strip() for n in text.split(",") if n.strip()]
    for name in names:
        if name not in known:
            near = did_you_mean(name, known)
            raise ParamsError(f"{place}: unknown effect {name!r}{near}; valid: all, {', '.join(known)}")
    return tuple(dict.fromkeys(names))


def testable_kinds(effects: Sequence[str], problem: Problem, *, any_spin: bool, local: bool) -> list[EffectKind]:
    """The effects, of those named, that the measurements could show.

    any_spin: also effects of spins where none was measured (`DiscoveryRules.unmeasured_spin`). local: also effects that
    only a part of the world can show.
    """
    regimes, shown = _regimes(problem), _shown(problem)
    spinning = any_spin and _shows_unmeasured_spin(problem)
    kinds = [kind for kind in map(effect_kinds().__getitem__, effects) if local or not kind.discovery.local]
    return [
        kind
        for kind in kinds
        if (spinning and kind.discovery.unmeasured_spin is not None) or _is_testable(kind, problem, regimes, shown)
    ]


def _shows_unmeasured_spin(problem: Problem) -> bool:
    """Whether balls fly whose spins were not measured, and none was, in more than one coordinate."""
    unmeasured = any(s.unmeasured_spin.any() for s in problem.stacks)
    return unmeasured and not _shown(problem) & {Need.SPIN, Need.GROUND_SPIN} and Need.DIRECTIONS in _shown(problem)


def _is_testable(kind: EffectKind, problem: Problem, regimes: frozenset[Regime], shown: frozenset[Need]) -> bool:
    if kind.discovery.fit_hits is not None:
        return problem.jumps > 0
    if any(name in problem.known.fit for name in kind.discovery.needs_known):
        return False
    if any(p.length > 1 for p in kind.parameters) and Need.DIRECTIONS not in shown:
        return False
    if kind.bounce_ratio is not None:
        return True
    return bool(regimes & set(kind.regimes)) and shown >= set(kind.discovery.needs)


def _regimes(problem: Problem) -> frozenset[Regime]:
    """The regimes that may occur in the arcs."""
    air = {Regime.FLIGHT} if any(not s.grounded for s in problem.stacks) else set()
    return frozenset(air | (set(GROUNDED) if any(s.grounded for s in problem.stacks) else set()))


def _shown(problem: Problem) -> frozenset[Need]:
    """What the measurements show."""
    stacks, ground = problem.stacks, [s for s in problem.stacks if s.grounded]
    coordinates = np.array([(s.weight > 0).any((0, 1)) for s in stacks]).any(0).sum()
    shows = {
        Need.SPIN: any((s.has_spin & (np.linalg.norm(s.spin, axis=1) > LEAST_SPIN)).any() for s in stacks),
        Need.GROUND_SPIN: any((s.spin_weight > 0).any() for s in ground),
        Need.ORIENTATION: any(a.quaternion is not None and not a.grounded for a in problem.arcs),
        Need.OTHERS: any((a.others < FAR_AWAY).any() for a in problem.arcs),
        Need.GROUND_BALL: any((s.radius > 0).any() for s in ground),
        Need.DIRECTIONS: coordinates >= 2,  # a height alone has no directions
    }
    return frozenset(need for need, shown in shows.items() if shown)
