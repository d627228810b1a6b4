"""Models with one effect more, and with one effect less."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discovery.fitting.calibration import (
    LEAST_BETTER,
    Calibration,
    fit_model,
    with_bounces,
    with_free_bounces,
)
from pipeline.discovery.fitting.candidate import Candidate, with_hits
from pipeline.discovery.fitting.initial_states import initial_states
from pipeline.discovery.fitting.least_squares import Fit, fit_initial_states
from pipeline.discovery.fitting.model import CAMERA, OBJECT, Model, with_effect, without_effect
from pipeline.discovery.fitting.possible import is_possible
from pipeline.discovery.fitting.screening import Guess, ScreeningRegression
from pipeline.discovery.fitting.velocity_jump_hits import velocity_jump_hits
from pipeline.discovery.tracks.problem import recorded_alone, split_at_jumps, with_unmeasured_spins
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Effect, half_extents

CLAIM = 8.0  # by how much the score of a first effect must win; frozen on development worlds (benchmarks/discovery.py)
WORTH_FITTING = 0.5  # share of the best screening gain that makes a further fit worthwhile
STARTS, STARTS_APART = 2, 5  # starts of an effect that are fitted; the same of one that acts from a place
SHUFFLED_SHARE = 0.5  # of the gain with measured spins, which the spins of other clips must not reach
SAME_SPINS = 0.2  # relative scatter of spins below which shuffling them says nothing
LARGEST_MISFIT = 0.1  # m; friction of a hit turns its direction
HIT_PARAMETERS = 5  # of an effect fitted to hits, with how bodies rebound from it
MOST_WORSE = 4.0  # of BIC beside its price, by which a first effect may fit worse than none before its fit begins again
PIECE_PRICE = 6  # of an initial state of each additional piece of an arc
EQUALS = 5  # further effects that are fitted because they promise nearly as much as the best
MOST_FITTED = 9  # effects that are fitted at a time: the most promising in the screening regression
Progress = Callable[[str], None]


def extend(
    calibration: Calibration,
    base: Candidate,
    kinds: Sequence[EffectKind],
    progress: Progress,
    most: int = MOST_FITTED,
) -> list[Candidate]:
    """`base` with one effect more, the best first, without those whose numbers are not possible.

    Args:
        calibration: Of the problem.
        base: The model to extend.
        kinds: The effects that may be added.
        progress: Called with the name of each effect that is fitted to the arcs.
        most: Number of effects that are fitted, beside those that promise nearly as much as the best.
    """
    out, in_arcs = [], []
    for kind in kinds:
        if kind.name in base.effects:
            continue
        fit_effect = _special_fit(calibration, kind)
        if fit_effect is None:
            in_arcs.append(kind)
            continue
        progress(kind.name)
        found = fit_effect(calibration, kind, base)
        if found is not None:
            out.append(found)
    promising: dict[str, tuple[EffectKind, list[Guess]]] = {}
    for fit in _fits_to_screen(base):
        screening = ScreeningRegression(base.problem, fit)
        for kind, guesses in _most_promising([(kind, screening.guesses(kind)) for kind in in_arcs], most):
            promising.setdefault(kind.name, (kind, guesses))
    for kind, guesses in promising.values():
        progress(kind.name)
        found = with_arc_effect(calibration, kind, base, guesses)
        if found is not None:
            out.append(found)
    return sorted(filter(is_possible, out), key=lambda c: c.score)


def _most_promising(
    screened: Sequence[tuple[EffectKind, list[Guess]]], most: int
) -> list[tuple[EffectKind, list[Guess]]]:
    """The effects of largest gain, with their guesses; so many, and EQUALS more that promise nearly as much."""
    ranked = sorted(screened, key=lambda pair: -pair[1][0].gain)
    enough = ranked[0][1][0].gain * WORTH_FITTING if ranked else 0.0
    return ranked[:most] + [pair for pair in ranked[most : most + EQUALS] if pair[1][0].gain > enough]


def _special_fit(
    calibration: Calibration, kind: EffectKind
) -> Callable[[Calibration, EffectKind, Candidate], Candidate | None] | None:
    """How an effect is fitted that has no parameters of its own in the arcs; None for all others."""
    if kind.bounce_ratio is not None:
        return _with_bounce_effect
    if kind.discovery.fit_hits is not None:
        return _with_hit_effect
    spins_measured = any(s.has_spin.any() for s in calibration.problem.stacks)
    return None if kind.discovery.unmeasured_spin is None or spins_measured else _with_unmeasured_spins


def with_arc_effect(
    calibration: Calibration, kind: EffectKind, base: Candidate, guesses: Sequence[Guess]
) -> Candidate | None:
    """`base` with an effect fitted to the arcs, the best of the fits from several guesses."""
    ends: list[Candidate] = []
    apart = kind.discovery.starts_apart and not base.effects
    grounded = [s for s in base.problem.stacks if s.grounded]
    has_minima = any((s.radius > 0).any() or s.camera_error is not None for s in grounded)
    may_stick = has_minima and not base.effects
    model = with_effect(base.fit.model, kind, calibration.problem.known)
    low, high = (np.array([getattr(u, k) for u in model.unknowns[base.fit.model.size :]]) for k in ("low", "high"))
    effects = (*base.effects, kind.name)
    for guess in _well_apart(guesses) if apart else guesses[:STARTS]:
        if guess is not guesses[0] and guess.gain < WORTH_FITTING / 2 * guesses[0].gain:
            continue
        theta = np.concatenate([base.fit.theta, np.clip(guess.values, low, high)])
        found = fit_model(calibration, base.problem, model, theta, base.fit.starts, effects=effects)
        if found.fit.slipping or may_stick:
            stated, begin = _as_stated(model, theta), initial_states(base.problem)
            again = fit_model(calibration, base.problem, model, stated, begin, effects=effects)
            found = min(found, again, key=lambda c: c.score)
        ends.append(completed(calibration, found, base))
    worst = base.bic + kind.size * np.log(calibration.problem.effective_rows) + MOST_WORSE
    if may_stick and any(end.bic > worst for end in ends):
        theta = np.concatenate([base.fit.theta, model.start[base.fit.model.size :]])
        found = fit_model(calibration, base.problem, model, theta, base.fit.starts, effects=effects)
        ends.append(completed(calibration, found, base))
    best = min((end for end in ends if np.isfinite(end.score)), key=lambda c: c.score, default=None)
    if best is not None and kind.discovery.of_a_body and kind.bodies is None:
        best = _with_own_numbers(calibration, kind, base, best)
    if best is not None and kind.discovery.must_beat_shuffled_spins and not _beats_shuffled(calibration, base, best):
        return None
    return best


def _with_own_numbers(calibration: Calibration, kind: EffectKind, base: Candidate, found: Candidate) -> Candidate:
    """`found`, or the same effect with each body's own numbers where bodies were recorded one by one and that wins.

    found: `base` with the effect, whose numbers all bodies share.
    """
    bodies = recorded_alone(base.problem)
    if len(bodies) < 2:
        return found
    shared = base.fit.model.size
    model = with_effect(base.fit.model, kind, calibration.problem.known, bodies=bodies)
    theta = np.concatenate([found.fit.theta[:shared], np.tile(found.fit.theta[shared:], len(bodies))])
    own = fit_model(calibration, base.problem, model, theta, found.fit.starts, effects=found.effects)
    return min(found, completed(calibration, own, base), key=lambda c: c.score)


def completed(calibration: Calibration, found: Candidate, base: Candidate) -> Candidate:
    """A fitted model with the parts of the score that are not of arcs, for the same effects as `base` has."""
    found = with_bounces(calibration, found, base.restitution is not None)
    return with_hits(found, base.hits, base.hits_price)


def _with_bounce_effect(calibration: Calibration, kind: EffectKind, base: Candidate) -> Candidate | None:
    """`base` with an effect that gives the bounces a restitution of their own; None where no bounce tells it."""
    if calibration.restitution is None:
        return None
    return replace(with_free_bounces(calibration, base), effects=(*base.effects, kind.name))


def _with_hit_effect(calibration: Calibration, kind: EffectKind, base: Candidate) -> Candidate | None:
    """`base` with an effect that explains most of the velocity jumps, at which the arcs are then split."""
    hits = velocity_jump_hits(calibration.problem)
    if hits is None or base.hits is not None or kind.discovery.fit_hits is None:
        return None
    found_hits = kind.discovery.fit_hits(hits)
    if found_hits.misfit > LARGEST_MISFIT or 2 * found_hits.count < calibration.problem.jumps:
        return None
    split = split_at_jumps(base.problem)  # also at jumps of outliers, whose pieces have their price
    effects = (*base.effects, kind.name)
    found = fit_model(calibration, split, base.fit.model, base.fit.theta, initial_states(split), effects=effects)
    lost = max(base.problem.rows - split.rows, 0)
    added = sum(map(len, split.stacks)) - sum(map(len, base.problem.stacks))
    price = HIT_PARAMETERS * np.log(calibration.problem.effective_rows) + PIECE_PRICE * added + lost
    found = with_hits(found, found_hits, price)
    return with_bounces(calibration, found, base.restitution is not None)


def _with_unmeasured_spins(calibration: Calibration, kind: EffectKind, base: Candidate) -> Candidate:
    """`base` with an effect of spins, of which each flight has an unknown one."""
    assert kind.discovery.unmeasured_spin is not None
    spinning = with_unmeasured_spins(base.problem)
    balls = [o for o in calibration.problem.known.scene.objects if o.shape == "sphere"]
    acting = tuple(
        Effect(kind.name, tuple(kind.discovery.unmeasured_spin(float(half_extents(o)[0])).items()), objects=(o.name,))
        for o in balls
    )
    model = replace(base.fit.model, stated=(*base.fit.model.stated, *acting))
    effects = (*base.effects, kind.name)
    found = fit_model(calibration, spinning, model, base.fit.theta, base.fit.starts, effects=effects)
    return completed(calibration, found, base)


def _beats_shuffled(calibration: Calibration, base: Candidate, found: Candidate) -> bool:
    """Whether the measured spins explain more than the spins of other clips in their places."""
    stacks = found.problem.stacks
    spins = np.concatenate([s.spin for s in stacks])
    if np.linalg.norm(spins - spins.mean(0), axis=1).mean() < SAME_SPINS * np.linalg.norm(spins, axis=1).mean():
        return True
    gain = base.score - found.score
    if gain < CLAIM:
        return True
    shuffled = [replace(s, spin=np.roll(s.spin, max(1, len(s) // 2), axis=0)) for s in stacks]
    begin = [
        np.concatenate([b[:, :6], s.spin, b[:, 9:]], 1) if not s.grounded else b
        for b, s in zip(found.fit.starts, shuffled, strict=True)
    ]
    problem = replace(found.problem, stacks=tuple(shuffled))
    other = fit_model(calibration, problem, found.fit.model, found.fit.theta, begin, effects=found.effects)
    other = with_bounces(calibration, other, base.restitution is not None)
    return base.score - other.score < SHUFFLED_SHARE * gain


def without_one(calibration: Calibration, found: Candidate) -> list[Candidate]:
    """`found` without each one of its effects, fitted from where `found` ended.

    An effect that stood in for later ones is no longer needed with them, and the last one may only have freed the fit
    from a local minimum. Effects that are not fitted to arcs stay.
    """
    out = []
    for name in found.effects:
        if name not in found.fit.model.names:
            continue
        model, kept = without_effect(found.fit.model, name)
        effects = tuple(e for e in found.effects if e != name)
        shorter = fit_model(calibration, found.problem, model, found.fit.theta[kept], found.fit.starts, effects=effects)
        out.append(completed(calibration, shorter, found))
    return out


def with_special_cases(calibration: Calibration, found: Candidate) -> list[Candidate]:
    """`found` with one of its effects replaced by the simpler one that it contains, fitted from where `found` ended.

    The larger effect may have stood in for a law that was added later: wind explains drag and a part of a tilt.
    """
    out = []
    for name, special in ((n, effect_kinds()[n].discovery.contains) for n in found.effects):
        if special is None or special in found.effects or name not in found.fit.model.names:
            continue
        kind, (rest, kept) = effect_kinds()[special], without_effect(found.fit.model, name)
        columns = {p.name: found.fit.model.columns(name, p, found.fit.model.bodies(name)[0]) for p in kind.parameters}
        values = {parameter: found.fit.theta[own] for parameter, own in columns.items()}
        model = with_effect(rest, kind, calibration.problem.known, values)
        theta = np.concatenate([found.fit.theta[kept], *values.values()])
        effects = (*(e for e in found.effects if e != name), special)
        simpler = fit_model(calibration, found.problem, model, theta, found.fit.starts, effects=effects)
        out.append(completed(calibration, simpler, found))
    return out


def recalibrated(calibration: Calibration, singles: Sequence[Candidate]) -> Calibration:
    """The calibration, its model fitted again from where models of one effect ended, if that is better.

    Friction causes local minima, from which any effect may free a fit.

    Args:
        calibration: Of the problem.
        singles: Models of one effect.
    """
    none = calibration.none
    for longer in (c for c in singles if c.problem is calibration.problem):
        for found in without_one(calibration, longer):
            none = found if found.score < none.score - LEAST_BETTER else none
    return replace(calibration, none=none)


def refitted(calibration: Calibration, found: Candidate, best: Candidate) -> Candidate:
    """A candidate of arcs alone, fitted again from the initial states and the camera of another one."""
    theta = found.fit.theta.copy()
    theta[found.fit.model.camera_columns] = best.fit.theta[best.fit.model.camera_columns]
    model, effects = found.fit.model, found.effects
    again = fit_model(calibration, found.problem, model, theta, best.fit.starts, effects=effects)
    return with_bounces(calibration, again, False)


def has_promising_extension(
    calibration: Calibration, base: Candidate, kinds: Sequence[EffectKind], least: float
) -> bool:
    """Whether a further effect would win by `least` in the screening regression.

    Where the noise is taken from the best model's residuals, these cannot show that an effect is missing.
    """
    screening = ScreeningRegression(base.problem, base.fit)
    for kind in kinds:
        if kind.fitted_to_arcs and kind.name not in base.effects:
            gain = screening.guesses(kind)[0].gain * calibration.information
            if gain > least + kind.size * np.log(calibration.problem.effective_rows):
                return True
    return False


def _as_stated(model: Model, theta: np.ndarray) -> np.ndarray:
    """theta with frictions and camera as stated: without the effect they may have been far off to make up for it."""
    stated = [u.owner.startswith(OBJECT) or u.owner == CAMERA for u in model.unknowns]
    return np.where(stated, model.start, theta)


def _fits_to_screen(base: Candidate) -> list[Fit]:
    """The fits whose residuals effects are screened on.

    That of a model; and, where the camera is fitted, too, and may have made up for a missing first effect, that with
    camera and frictions as stated.
    """
    if base.effects or not base.problem.one_camera:
        return [base.fit]
    model, stated = base.fit.model, _as_stated(base.fit.model, base.fit.theta)
    pairs = zip(base.problem.stacks, initial_states(base.problem), strict=True)
    starts = [fit_initial_states(stack, model, stated, begin)[0] for stack, begin in pairs]
    return [base.fit, replace(base.fit, theta=stated, starts=starts)]


def _well_apart(guesses: Sequence[Guess]) -> list[Guess]:
    """The best guesses whose places (the first three numbers) are well apart from each other."""
    places = np.array([g.values[:3] for g in guesses])
    spacing = float(np.ptp(places, axis=0).max()) / 3
    out: list[Guess] = []
    for guess in guesses:
        if all(np.linalg.norm(guess.values[:3] - other.values[:3]) > spacing for other in out):
            out.append(guess)
    return out[:STARTS_APART]
