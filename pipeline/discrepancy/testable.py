"""Which effects may be asked for: by name, and by whether the measurements could show them at all."""

from __future__ import annotations

import numpy as np

from pipeline.discrepancy.arc import FAR_AWAY
from pipeline.discrepancy.problem import Problem
from pipeline.scene.effects.kind import EffectKind, Regime
from pipeline.scene.effects.registry import effect_kinds


def names_of(text: str) -> tuple[str, ...]:
    """The effects that `--effects` names. Raises ValueError with what is valid."""
    known = effect_kinds()
    if text == "all":
        return tuple(known)
    names = [n.strip() for n in text.split(",") if n.strip()]
    for name in names:
        if name not in known:
            raise ValueError(f"unknown effect {name!r}; valid: all, {', '.join(known)}")
    return tuple(dict.fromkeys(names))


def testable(kind: EffectKind, problem: Problem) -> bool:
    """Whether the measurements could show the effect at all."""
    regimes = {Regime.FLIGHT} if any(not s.grounded for s in problem.stacks) else set()
    if any(s.grounded for s in problem.stacks):
        regimes |= {Regime.SLIDING, Regime.ROLLING, Regime.SPINNING, Regime.RESTING}
    if kind.name == "hidden_obstacle":
        return problem.jumps > 0
    coordinates = np.array([(s.weight > 0).any((0, 1)) for s in problem.stacks]).any(0).sum()
    if coordinates < 2 and (kind.name == "rotating_frame" or any(p.length > 1 for p in kind.parameters)):
        return False  # a height alone has no directions
    if kind.name == "restitution":
        return "damping" not in problem.known.fit
    if not regimes & set(kind.regimes):
        return False
    ground = [s for s in problem.stacks if s.grounded]
    if kind.name == "rolling_resistance":  # the same law as the rolling friction that is fitted
        return "rolling_friction" not in problem.known.fit and any((s.radius > 0).any() for s in ground)
    if kind.name == "spin_friction":
        return any((s.spin_weight > 0).any() for s in ground)
    if kind.name == "adhesion":  # presses like a greater friction, which must be known to tell
        return "sliding_friction" not in problem.known.fit
    if "spin" in kind.needs:
        return any((s.has_spin & (np.linalg.norm(s.spin, axis=1) > 0.5)).any() for s in problem.stacks)
    if "others" in kind.needs:
        return any((a.others < FAR_AWAY).any() for a in problem.arcs)
    if "orientation" in kind.needs:
        return any(a.quaternion is not None and not a.grounded for a in problem.arcs)
    return True
