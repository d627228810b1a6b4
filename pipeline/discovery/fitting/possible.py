"""Whether the numbers of a model's effects are possible: a fit that ends at a bound wants what cannot be."""

from __future__ import annotations

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import estimates_by_body
from pipeline.scene.effects.kind import Parameter
from pipeline.scene.effects.registry import effect_kinds

ROUNDING = 1e-6  # of a bound, within which a fit has ended there


def is_possible(found: Candidate) -> bool:
    """Whether each determined number is inside its physical range, or means no effect."""
    for effect in found.effects:
        parameters = {p.name: p for p in effect_kinds()[effect].parameters}
        for estimates in estimates_by_body(found, effect).values():
            for name, estimate in estimates.items():
                if estimate.stderr is not None and not _inside(parameters[name], np.atleast_1d(estimate.value)):
                    return False
    return True


def _inside(parameter: Parameter, values: np.ndarray) -> bool:
    if parameter.period is not None:
        return True  # a direction has no bound
    low, high = parameter.possible
    edge = ROUNDING * max([1.0, *(abs(bound) for bound in (low, high) if np.isfinite(bound))])
    inside = (values > low + edge) & (values < high - edge)
    return bool((inside | (np.abs(values - parameter.neutral) <= edge)).all())
