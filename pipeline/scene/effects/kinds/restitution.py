"""Restitution: the ratio of normal speeds after and before an impact, as MuJoCo's contact damping that gives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.contact_damping import SCATTER, damping_of, restitution_of
from pipeline.scene.effects.discovery_rules import DiscoveryRules
from pipeline.scene.effects.hiding import DETECTION_ERRORS, Hiding, Launches
from pipeline.scene.effects.kind import EffectKind, Parameter, Regime, Values
from pipeline.scene.scene import Scene


def bounce_ratio(values: Values) -> np.ndarray:
    return values["coefficient"]


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    from pipeline.scene.mjcf import solref

    for name in objects:
        root.find("geom", name).solref = solref(np.array(damping_of(values["coefficient"])))


def draw(launches: Launches, strength: float, sign: float, rng: np.random.Generator) -> dict[str, Any]:
    """A restitution that differs from that of the known damping by `strength` detection limits, at most by 0.35."""
    before = restitution_of(launches[0][0].damping)
    step = min(strength * DETECTION_ERRORS * SCATTER / np.sqrt(2.0 * len(launches)), 0.35)
    value = before - step if before - step > 0.15 and (sign < 0 or before + step > 0.93) else before + step
    return {"coefficient": float(np.clip(value, 0.1, 0.95))}


EFFECT = EffectKind(
    name="restitution",
    formula="v_n after = -e v_n before",
    parameters=(Parameter("coefficient", "-", low=0, high=1, scale=0.1, neutral=0.5),),
    regimes=(Regime.IMPACT,),
    experiment="drop it from several heights: with adhesion slow impacts lose the larger share",
    bounce_ratio=bounce_ratio,
    edit=edit,
    discovery=DiscoveryRules(needs_known=("damping",), scene_parameter="damping"),
    hiding=Hiding(draw=draw, scenarios=("bounce",), engines=("mujoco", "events")),
)
