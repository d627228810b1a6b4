"""Selections with one effect less than another one."""

from __future__ import annotations

from dataclasses import replace

from pipeline.discrepancy.fitting.extension import without_one
from pipeline.discrepancy.selection.equivalence import alike_each, alike_single
from pipeline.discrepancy.selection.established import models_without
from pipeline.discrepancy.selection.selection import Selection
from pipeline.discrepancy.selection.unexplained import excess


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
            rest = [c for c in found.singles if c.effects != model.effects]
            singles = tuple(sorted((model, *rest), key=lambda c: c.score))
            shorter = replace(found, singles=singles, alike=alike_single(model, singles))
        else:
            tried = (*(c for c in found.tried if set(c.effects) != set(model.effects)), model)
            shorter = replace(found, tried=tried, alike=alike_each(model, tried))
        z, share = excess(found.calibration, model)
        out[name] = replace(shorter, chosen=model, excess_z=z, excess_share=share)
    return out
