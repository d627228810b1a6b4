"""Whether the effects of a model stay what they are when recordings are left out.

Beside a remainder the standard errors of a fit say little, since residuals are systematic: a second law then takes what
the first one leaves, and another amount of it in each recording. The jackknife over recordings sees that (Efron, The
Jackknife, the Bootstrap and Other Resampling Plans, 1982, chapter 3).
"""

from __future__ import annotations

import numpy as np

from pipeline.discovery.fitting.calibration import Calibration
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import estimates_by_body
from pipeline.discovery.fitting.other_split import hold_out_instead
from pipeline.scene.effects.registry import effect_kinds

LEAST_RATIO = 2.0  # of a number to its standard error: 95 % of a normal distribution
MOST_LEFT_OUT = 8  # recordings that are left out, one after the other


def is_stable(calibration: Calibration, found: Candidate) -> bool:
    """Whether each effect that is linear in its numbers differs from none by two standard errors of the jackknife."""
    clips = calibration.problem.clips[:MOST_LEFT_OUT]
    again = [hold_out_instead(calibration, (found,), clip) for clip in clips]
    models = [each[1][0] for each in again if each is not None]
    if len(models) < 2:
        return True
    return all(_differs(models, effect) for effect in found.effects)


def _differs(models: list[Candidate], effect: str) -> bool:
    kind = effect_kinds()[effect]
    if kind.discovery.starts is not None or not kind.fitted_to_arcs or effect not in models[0].fit.model.names:
        return True
    neutral = np.concatenate([np.full(p.length, p.neutral) for p in kind.parameters])
    rows = [
        [np.concatenate([np.atleast_1d(e.value) for e in own.values()]) - neutral for own in bodies.values()]
        for bodies in (estimates_by_body(model, effect) for model in models)
    ]
    values, count = np.array(rows), len(models)  # (clips, bodies, components)
    error = np.sqrt((count - 1) / count * ((values - values.mean(0)) ** 2).sum(0))
    return bool((np.abs(values.mean(0)) > LEAST_RATIO * error).any())
