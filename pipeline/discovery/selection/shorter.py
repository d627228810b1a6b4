"""Selections with one effect less than another one, or with an effect of fewer numbers."""

from __future__ import annotations

from dataclasses import replace

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import without_one
from pipeline.discovery.selection.comparison import with_other_evidence
from pipeline.discovery.selection.equivalence import alike_each, alike_single
from pipeline.discovery.selection.established import MOST_LEFT, MOST_LEFT_BY_MORE, left_of_gap, models_without
from pipeline.discovery.selection.gap import measure_gap
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.selection.unexplained import excess

LEAST_REMAINDER = 1.5  # noise floors: what leaves less may be explained but for noise


def leaves_noise(found: Selection, model: Candidate) -> bool:
    """Whether what a model leaves of held-out clips may be noise."""
    gap = measure_gap(found.measured, found.baseline, model)
    return gap.after <= LEAST_REMAINDER * gap.noise_floor


def simpler_selection(found: Selection) -> Selection:
    """The selection, in which an effect of fewer numbers takes the place of a single one that is hardly better.

    It has to leave what may be noise, or less than four times as much as the other one; and at most half of the gap.
    """
    if len(found.chosen.effects) != 1 or found.chosen.restitution is not None or found.chosen.hits is not None:
        return found
    left = {c.effects: left_of_gap(found, c) for c in found.singles}
    simpler = [
        c
        for c in found.singles
        if c.parameters < found.chosen.parameters
        and c.restitution is None
        and c.hits is None
        and left[c.effects] <= MOST_LEFT
        and (leaves_noise(found, c) or MOST_LEFT_BY_MORE * left[c.effects] < left[found.chosen.effects])
    ]
    if not simpler:
        return found
    return with_single(found, min(simpler, key=lambda c: (c.parameters, left[c.effects])))


def shorter_selections(found: Selection) -> dict[str, Selection]:
    """For each of the chosen model's two or more effects, the selection without it, the best one first.

    The model without an effect is fitted again from where the chosen one ended. For effects that are not fitted to arcs
    there is none where it was not fitted before.
    """
    names = found.chosen.effects
    if len(names) < 2:
        return {}
    models = models_without(found)
    for model in without_one(found.calibration, found.chosen):
        (name,) = set(names) - set(model.effects)
        models[name] = min(models.get(name, model), model, key=lambda c: c.score)
    out = {}
    for name, model in sorted(models.items(), key=lambda pair: pair[1].score):
        if len(model.effects) == 1:
            out[name] = with_single(found, model)
        else:
            tried = (*(c for c in found.tried if set(c.effects) != set(model.effects)), model)
            out[name] = _with(replace(found, tried=tried, alike=alike_each(model, tried, with_other_evidence)), model)
    return out


def with_single(found: Selection, model: Candidate) -> Selection:
    """The selection that chooses a model of one effect."""
    rest = [c for c in found.singles if c.effects != model.effects]
    singles = tuple(sorted((model, *rest), key=lambda c: c.score))
    return _with(replace(found, singles=singles, alike=alike_single(model, singles)), model)


def _with(found: Selection, model: Candidate) -> Selection:
    z, share = excess(found.calibration, model)
    return replace(found, chosen=model, excess_z=z, excess_share=share)
