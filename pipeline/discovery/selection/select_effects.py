"""Which effects the measurements support, as a sequence of steps from a problem to a selection.

The model with the lowest score wins (pipeline/discovery/fitting/candidate.py), if it wins by more than chance would
where nothing is hidden (`CLAIM`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from pipeline.discovery.fitting.calibration import Calibration, calibrate, rescale_noise, rescored
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import CLAIM, Progress, extend, recalibrated, refitted
from pipeline.discovery.selection.arc_search import ArcSearch
from pipeline.discovery.selection.comparison import (
    forecasts_better,
    likeliest,
    other_evidence,
    with_other_evidence,
)
from pipeline.discovery.selection.equivalence import Sets, absorbed_laws, alike_each, alike_single
from pipeline.discovery.selection.established import with_established
from pipeline.discovery.selection.forecast import forecast_error
from pipeline.discovery.selection.forward_selection import CLAIM_MORE, ForwardSelection, forward_selection
from pipeline.discovery.selection.local_effect import (
    Where,
    find_where,
    intervals_left,
    local_effects,
    where_hit,
    where_with,
)
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.selection.testable import testable_kinds
from pipeline.discovery.selection.unexplained import (
    UNEXPLAINED_Z,
    drop_unexplained_arcs,
    excess,
    has_few_clips,
    independent_share,
    is_unexplained,
)
from pipeline.discovery.tracks.problem import (
    Problem,
    hold_out,
    inflate_noise,
    with_friction_nuisance,
    with_length_scale_nuisance,
)
from pipeline.scene.effects.kind import EffectKind

NEAR = 25.0  # difference of scores within which candidates are fitted again from the best one's initial states
RESTARTS = 3  # best models of one effect from whose ends the calibrated one is fitted again
MOST_DROPS = 2  # times that arcs are dropped by the best model


@dataclass(frozen=True)
class _Singles:
    """Models of one effect each.

    Attributes:
        calibration: Of the problem, without arcs that the best of them misses by far.
        kinds: The effects that the measurements could show.
        models: The best first.
    """

    calibration: Calibration
    kinds: Sequence[EffectKind]
    models: Sequence[Candidate]


def select_effects(problem: Problem, effects: Sequence[str], progress: Progress) -> Selection:
    """The selection for a problem: of an effect in a part of the world, or of effects everywhere.

    Where the known scene fails in a part only, an effect that acts there wins if it explains the measurements, and more
    than any one that acts everywhere; where it fails in every recording, also more than several that do.

    Args:
        problem: What is fitted.
        effects: Names of the effects that may be answered.
        progress: Called with the name of each effect that is fitted.
    """
    calibration = _calibrate(problem)
    where = find_where(calibration.none)
    other = hold_out(problem, problem.fitted[: len(problem.held_out)])
    swapped = bool(where.disagreeing) and not where.disagreeing & set(problem.fitted)
    if swapped:  # nothing was fitted to what is held out
        calibration = _calibrate(other)
        where = find_where(calibration.none)
    if problem.one_camera or has_few_clips(problem):  # slow errors of a camera, or of one clip, look like a force
        found = select_once(calibration, effects, progress)
        return replace(_with_nuisances(calibration, found, effects, progress), where=where)
    singles = _fit_singles(calibration, effects, progress)
    local = None
    if where.local and not _is_enough(singles):
        local = _select_local(calibration, where, singles, effects, progress)
        if local is None and problem.held_out and not swapped:  # the fitted clips may not tell where a region ends
            again = _calibrate(other)
            local = _select_local(again, find_where(again.none), singles, effects, progress)
    everywhere = where.in_all(problem.clips)  # laws that act everywhere would show in every recording
    if local is not None and not everywhere:
        return replace(local, where=where_with(local.chosen, where))
    sparing = where.mostly_clean and not everywhere
    found = select_once(calibration, effects, progress, sparing=sparing, singles=singles)
    if local is not None and not _explains_more(found, local):
        return replace(local, where=where_with(local.chosen, where))
    if local is None and not where.mostly_clean:
        found = _with_nuisances(calibration, found, effects, progress)
    # What an interval shows is listed, and then something is missing.
    missing = bool(where.intervals) and not found.chosen.effects
    if found.chosen.hits is not None and not found.unknown:
        where = where_hit(found.chosen, found.problem, where)
    return replace(found, where=where, unknown=found.unknown or missing)


def _is_enough(singles: _Singles) -> bool:
    """Whether a single effect explains the measurements everywhere."""
    best = _select_model(singles.calibration, singles.models, ()).chosen
    return bool(best.effects) and not is_unexplained(singles.calibration, best) and not intervals_left(best)


def _explains_more(found: Selection, other: Selection) -> bool:
    """Whether a selection explains what another one does, by a better score."""
    return not found.unknown and found.problem.rows == other.problem.rows and found.chosen.score < other.chosen.score


def _calibrate(problem: Problem) -> Calibration:
    """The calibration without arcs at impacts that the calibrated model misses by far."""
    calibration = calibrate(problem)
    left = drop_unexplained_arcs(calibration, calibration.none, only_at_impacts=True)
    return calibration if left is None else calibrate(left)


def _select_local(
    calibration: Calibration, where: Where, everywhere: _Singles, effects: Sequence[str], progress: Progress
) -> Selection | None:
    """The selection of one effect that acts where the known scene fails; None where that is not the answer.

    Args:
        calibration: Of the problem.
        where: Where the known scene fails.
        everywhere: Models of effects that act everywhere. They are rivals if they explain the same measurements.
        effects: Names of the effects that may be answered.
        progress: Called with the name of each effect that is fitted.
    """
    kinds = testable_kinds(effects, calibration.problem, any_spin=False, local=True)
    models = local_effects(calibration, where, kinds, progress)
    if not models:
        return None
    chosen = models[0]
    if is_unexplained(calibration, chosen):
        return None
    same = everywhere.calibration.problem.rows == calibration.problem.rows
    best = min([calibration.none.score, *(c.score for c in everywhere.models if same)])
    if chosen.score > best - CLAIM_MORE:
        return None
    singles = [c for c in models if len(c.effects) == 1]
    alike = alike_single(chosen, singles) if len(chosen.effects) == 1 else ()
    return _outcome(_Singles(calibration, kinds, singles), effects, ForwardSelection(chosen, ()), alike, unknown=False)


def _with_nuisances(
    calibration: Calibration, found: Selection, effects: Sequence[str], progress: Progress
) -> Selection:
    """The selection with nuisances, where no listed effect explains the measurements; else as it is.

    If the residuals of several clips exceed the noise, the selection is repeated with a length scale for each arc, and
    counts if at most one effect is enough then, or if several explain all: beside a remainder any second effect wins by
    its score. Clips of one camera have one length scale, which is among the camera's errors already. Else, with one or
    two fitted clips, or with tracks from video, which may have slow tracking errors, the residuals count as noise, and
    the selection is repeated once more. With more clips, where no effect or only several together come near, those are
    named that are established, of balls in the air also those of an unknown spin. Where the friction of single slides
    differs, each has its own then.

    Args:
        calibration: Of the problem.
        found: Its selection.
        effects: Names of the effects that may be answered.
        progress: Called with the name of each effect that is fitted.
    """
    problem = calibration.problem
    if found.excess_z <= UNEXPLAINED_Z or len(problem.clips) == 1:
        return found
    scaled = found
    if not problem.one_camera:
        scaled = select_once(_calibrate(with_length_scale_nuisance(problem)), effects, progress)
    if (has_few_clips(problem) or problem.one_camera) and scaled.excess_z > UNEXPLAINED_Z:
        return _select_beside_remainder(scaled, found.none, effects, progress)
    enough = len(scaled.chosen.effects) < 2 or scaled.excess_z <= UNEXPLAINED_Z
    if enough and not scaled.unknown and scaled.chosen.score < found.chosen.score - CLAIM_MORE:
        return replace(scaled, baseline=found.none)
    if not found.unknown and len(found.chosen.effects) < 2:
        return found
    own_frictions = _select_with_own_frictions(problem, found, effects, progress)
    if own_frictions is not None:
        return own_frictions
    return (
        with_established(found, testable_kinds(effects, found.problem, any_spin=True, local=False), progress) or found
    )


def _select_with_own_frictions(
    problem: Problem, found: Selection, effects: Sequence[str], progress: Progress
) -> Selection | None:
    """The selection in which each slide has its own friction; None where that explains little, or nothing is named.

    Args:
        problem: What is fitted.
        found: Its selection.
        effects: Names of the effects that may be answered.
        progress: Called with the name of each effect that is fitted.
    """
    if not any(stack.slides.any() for stack in problem.stacks) or not problem.held_out:
        return None
    without, own = found.none, calibrate(with_friction_nuisance(found.problem)).none
    if own.score > without.score - CLAIM_MORE or forecast_error(own) >= forecast_error(without):
        return None
    again = select_once(_calibrate(with_friction_nuisance(problem)), effects, progress)
    again = replace(again, baseline=found.none)
    if again.excess_z > UNEXPLAINED_Z:
        return with_established(again, testable_kinds(effects, again.problem, any_spin=True, local=False), progress)
    return again if again.chosen.effects else None


def _select_beside_remainder(
    first: Selection, baseline: Candidate, effects: Sequence[str], progress: Progress
) -> Selection:
    """The selection in which the residuals of another one's best model of at most one effect count as noise."""
    best = min((first.none, *first.singles), key=lambda c: c.score)
    noisy = inflate_noise(first.problem, independent_share(best))
    return replace(select_once(_calibrate(noisy), effects, progress), baseline=baseline, first=first)


def select_once(
    calibration: Calibration,
    effects: Sequence[str],
    progress: Progress = lambda _: None,
    sparing: bool = False,
    singles: _Singles | None = None,
) -> Selection:
    """The selection for a problem as it is, but for arcs that its best model misses by far.

    Args:
        calibration: Of the problem.
        effects: Names of the effects that may be answered.
        progress: Called with the name of each effect that is fitted.
        sparing: Several effects are answered only where no single one explains the measurements, and they do.
        singles: Of the problem, if they are fitted already.
    """
    singles = singles or _fit_singles(calibration, effects, progress)
    found = _select_among(singles, effects, progress, sparing)
    left = drop_unexplained_arcs(found.calibration, found.chosen) if len(found.chosen.effects) > 1 else None
    if left is None:
        return found
    return _select_among(_fit_singles(calibrate(left), effects, progress), effects, progress, sparing)


def _select_among(singles: _Singles, effects: Sequence[str], progress: Progress, sparing: bool) -> Selection:
    """The selection from models of one effect and what is added to them; arguments as those of `select_once`."""
    calibration, kinds, models = singles.calibration, singles.kinds, singles.models
    found = _select_model(calibration, models, () if sparing else kinds, progress)
    if sparing and is_unexplained(calibration, found.chosen):
        both = _select_model(calibration, models, kinds, progress)
        few = drop_unexplained_arcs(calibration, both.chosen) is not None
        found = both if few or not is_unexplained(calibration, both.chosen) else found
    chosen, inflated = found.chosen, calibration.problem.noise_inflated
    alike = (
        alike_each(chosen, found.tried, with_other_evidence)
        if len(chosen.effects) > 1
        else alike_single(chosen, models)
    )
    absorbed = absorbed_laws(calibration, chosen, models) if inflated else ()
    unexplained = is_unexplained(calibration, chosen) and not inflated
    if unexplained:
        alike = ()
    elif absorbed and alike:
        alike = ((*alike[0], *absorbed),)
    return _outcome(singles, effects, found, alike, unknown=unexplained or len(absorbed) > 0)


def _outcome(
    singles: _Singles, effects: Sequence[str], found: ForwardSelection, alike: Sets, *, unknown: bool
) -> Selection:
    """The selection of a model.

    Args:
        singles: All models of one effect.
        effects: Names of the effects that may be answered.
        found: The model, and those of several effects that were tried.
        alike: Sets of effects that cannot be told from one of the model's.
        unknown: Whether it leaves too much.
    """
    calibration = singles.calibration
    z, share = excess(calibration, found.chosen)
    testable = {kind.name for kind in singles.kinds}
    return Selection(
        calibration=calibration,
        singles=tuple(singles.models),
        chosen=found.chosen,
        alike=alike,
        excess_share=share,
        excess_z=z,
        unknown=unknown,
        untestable=tuple(name for name in effects if name not in testable),
        ruled_out=tuple(c.name for c in singles.models if other_evidence(c) < 0),
        baseline=calibration.none,
        tried=found.tried,
    )


def _fit_singles(calibration: Calibration, effects: Sequence[str], progress: Progress) -> _Singles:
    """Fit each effect alone, again without the arcs that the best one misses by far."""
    kinds = testable_kinds(effects, calibration.problem, any_spin=False, local=False)
    for _ in range(MOST_DROPS):
        models = extend(calibration, calibration.none, kinds, progress)
        left = drop_unexplained_arcs(calibration, likeliest([calibration.none, *models], calibration.none))
        if left is None:
            break
        calibration = calibrate(left)
    else:
        models = extend(calibration, calibration.none, kinds, progress)
    best = likeliest([calibration.none, *models], calibration.none)
    if best.effects:
        calibration = recalibrated(calibration, models[:RESTARTS])
    models = _refit_near_best(calibration, best, models)
    calibration = rescale_noise(calibration, best)
    models = sorted((rescored(calibration, c) for c in models), key=lambda c: c.score)
    return _Singles(calibration, kinds, models)


def _refit_near_best(calibration: Calibration, best: Candidate, singles: Sequence[Candidate]) -> list[Candidate]:
    """The candidates, of which those near the best are fitted again from where it ended; of tracks from video all.

    On the ground the times at which bodies stop cause local minima, which would tell effects apart that are one law.
    """
    out = list(singles)
    if not best.effects or best.hits is not None or not any(s.grounded for s in best.problem.stacks):
        return out
    for i, c in enumerate(out):
        of_arcs = c.effects != best.effects and c.restitution is None and c.hits is None
        if of_arcs and c.problem is best.problem and (best.problem.one_camera or c.score < best.score + NEAR):
            again = refitted(calibration, c, best)
            out[i] = again if again.score < c.score else c
    return out


def _select_model(
    calibration: Calibration,
    singles: Sequence[Candidate],
    kinds: Sequence[EffectKind],
    progress: Progress = lambda _: None,
) -> ForwardSelection:
    """The calibrated model, or the best model of one or more effects if it wins by enough."""
    none = calibration.none
    best = likeliest([none, *(c for c in singles if forecasts_better(c, none))], none)
    claim = CLAIM_MORE if calibration.problem.noise_inflated else CLAIM
    if not best.effects or best.score >= none.score - claim:
        return ForwardSelection(none, ())
    return forward_selection(ArcSearch(calibration, kinds, progress), none, best, singles)
