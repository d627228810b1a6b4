"""The ratio of normal speeds after and before an impact, as MuJoCo's contact damping that gives it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from pipeline.scene.effects.kind import EffectKind, Parameter, Regime
from pipeline.scene.scene import Scene

#: Contact damping ratio -> restitution of a ball that meets the ground at 1.5 to 3 m/s, mean over the phase of the
#: 1/240 s step, which moves single impacts by up to 0.09: measured with MuJoCo 3.17 (tests/scene/test_restitution.py).
DAMPING = np.array([0.005, 0.01, 0.02, 0.04, 0.06, 0.08, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3, 0.35, 0.4, 0.45, 0.5, 0.55,
                    0.6, 0.65, 0.7, 0.75, 0.8, 0.9])  # fmt: skip
RESTITUTION = np.array([0.9682, 0.9532, 0.9236, 0.8698, 0.8184, 0.7724, 0.7281, 0.6501, 0.5803, 0.5192, 0.4634,
                        0.4123, 0.3489, 0.3022, 0.255, 0.2152, 0.1761, 0.1391, 0.0985, 0.0578, 0.0294,
                        0.0097, 0.0])  # fmt: skip
SCATTER = 0.06  # standard deviation of single impacts about it


def restitution_of(damping: float) -> float:
    """What a contact damping ratio gives."""
    return float(np.interp(damping, DAMPING, RESTITUTION))


def damping_of(restitution: float) -> float:
    """The contact damping ratio that gives it; above 0.968 that of 0.968."""
    return float(np.interp(-restitution, -RESTITUTION, DAMPING))


def edit(root: Any, scene: Scene, values: Mapping[str, Any], objects: tuple[str, ...]) -> None:
    from pipeline.scene.mjcf import solref

    for name in objects:
        root.find("geom", name).solref = solref(np.array(damping_of(values["coefficient"])))


EFFECT = EffectKind(
    name="restitution",
    formula="v_n after = -e v_n before",
    parameters=(Parameter("coefficient", "-", low=0, high=1, scale=0.1, neutral=0.5),),
    regimes=(Regime.IMPACT,),
    experiment="drop it from several heights: with adhesion slow impacts lose the larger share",
    edit=edit,
)
