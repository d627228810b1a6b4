"""Which effects promise to explain what a model leaves: one simulation each, and linear algebra."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.mechanisms.kind import MechanismEffect, Place
from pipeline.discovery.mechanisms.law_model import Acting, LawModel, with_effect
from pipeline.discovery.mechanisms.least_squares import Fit, derivatives
from pipeline.discovery.mechanisms.places import may_act
from pipeline.discovery.mechanisms.problem import Problem, predicted

AT_ONCE = 24  # variants that are simulated together
RIDGE = 1e-9
MOST_STEPS = 8000  # of the simulation, for each trial


@dataclass(frozen=True)
class Guess:
    """Where a fit of an effect begins.

    Attributes:
        places: On which it acts.
        values: Its numbers there, in order.
        gain: Decrease of chi squared that it promises.
    """

    places: tuple[Place, ...]
    values: np.ndarray
    gain: float


@dataclass(frozen=True)
class _Trial:
    """An effect at one place, with the numbers of one start."""

    acting: Acting
    start: np.ndarray
    neutral: np.ndarray

    def scaled(self, share: float) -> np.ndarray:
        """The numbers with that share of the effect."""
        out = self.start.copy()
        if self._linear is not None:
            part, low, high = self._linear
            out[part] = np.clip(self.neutral[part] + share * (self.start - self.neutral)[part], low, high)
        return out

    @property
    def largest_shares(self) -> tuple[float, float]:
        """The shares of the effect at which its number is at its bounds."""
        if self._linear is None:
            return 1.0, 1.0
        part, low, high = self._linear
        change, here = (self.start - self.neutral)[part], self.neutral[part]
        with np.errstate(divide="ignore"):
            ends = np.array([(low - here) / change, (high - here) / change])
        ends = ends[:, change != 0]
        return float(ends.min(0).max()), float(ends.max(0).min())

    @property
    def _linear(self) -> tuple[slice, float, float] | None:
        """Where the number in whose size the law is linear stands, and its bounds."""
        kind = self.acting.kind
        if kind.linear is None:
            return None
        low, high = next(self.acting.bounds(p) for p in kind.parameters if p.name == kind.linear)
        return LawModel((), (self.acting,)).columns(0)[kind.linear], low, high


def guesses(problem: Problem, found: Fit, kinds: Sequence[MechanismEffect], price: float) -> dict[str, list[Guess]]:
    """The guesses of each effect, the most promising first; none of an effect that could not act.

    A linear effect may act at several places at once: they are added one by one, as long as each promises more than its
    price.

    Args:
        problem: What was fitted.
        found: The model to which effects are added.
        kinds: The effects.
        price: Of one number, in units of chi squared.
    """
    trials = [
        trial
        for kind in kinds
        for place in problem.places[kind.target]
        if may_act(kind, problem.mechanism, problem.log, place)
        for trial in _trials(kind, place)
    ]
    if not trials:
        return {}
    gram, slope = _projected(problem, found, trials)
    out: dict[str, list[Guess]] = {}
    for kind in kinds:
        mine = [k for k, t in enumerate(trials) if t.acting.kind is kind]
        if mine:
            singles = [_single(trials[k], gram[k, k], slope[k]) for k in mine]
            ranked = sorted(singles, key=lambda g: -g.gain)
            several = _several(trials, mine, gram, slope, price * kind.size) if kind.linear else None
            out[kind.name] = ([several] if several is not None else []) + ranked
    return out


def _trials(kind: MechanismEffect, place: Place) -> list[_Trial]:
    acting = Acting(kind, place)
    neutral = np.concatenate([np.full(p.length, acting.neutral(p)) for p in kind.parameters])
    return [
        _Trial(acting, np.concatenate([start[p.name] for p in kind.parameters]), neutral)
        for start in kind.starts(place)
    ]


def _single(trial: _Trial, square: float, slope: float) -> Guess:
    """The guess of one trial: of a linear effect with the best share of it."""
    low, high = trial.largest_shares
    share = float(np.clip(slope / max(square, RIDGE), low, high))
    gain = 2 * share * slope - share * share * square
    return Guess((trial.acting.place,), trial.scaled(share), gain)


def _several(
    trials: Sequence[_Trial], mine: Sequence[int], gram: np.ndarray, slope: np.ndarray, price: float
) -> Guess | None:
    """The guess of a linear effect at several places; None where one place is enough.

    Args:
        trials: Of all effects.
        mine: Indices of those of the effect.
        gram: (trials, trials) products of their changes.
        slope: (trials,) products of their changes and the residuals.
        price: Of a place.
    """
    chosen: list[int] = []
    shares, best = np.zeros(0), 0.0
    while len(chosen) < len(mine):
        options = []
        for k in mine:
            if trials[k].acting.place in [trials[c].acting.place for c in chosen]:
                continue
            some = [*chosen, k]
            part = gram[np.ix_(some, some)]
            solved = np.linalg.solve(part + RIDGE * np.diag(np.diag(part) + 1), slope[some])
            limits = np.array([trials[c].largest_shares for c in some])
            solved = np.clip(solved, limits[:, 0], limits[:, 1])
            options.append((float(2 * solved @ slope[some] - solved @ part @ solved), k, solved))
        if not options:
            break
        gain, k, solved = max(options, key=lambda option: option[0])
        if gain - best < price:
            break
        chosen, shares, best = [*chosen, k], solved, gain
    if len(chosen) < 2:
        return None
    values = np.concatenate([trials[k].scaled(float(s)) for k, s in zip(chosen, shares, strict=True)])
    return Guess(tuple(trials[k].acting.place for k in chosen), values, best)


def _projected(problem: Problem, found: Fit, trials: Sequence[_Trial]) -> tuple[np.ndarray, np.ndarray]:
    """Products of the trials' changes with each other and with the residuals, without what initial states and the
    numbers of the model can do."""
    mechanism, simulator = problem.mechanism, problem.simulator
    windows = _screened(problem)
    screened, states = problem.cut(tuple(problem.windows[w] for w in windows)), found.states.of(windows)
    slopes = derivatives(screened, found.model, found.theta, states, [found.residual[w] for w in windows])
    shared = dict(zip(windows, slopes, strict=True))
    normal, pull = np.eye(found.model.size) * RIDGE, np.zeros(found.model.size)
    bases = {}
    for w in windows:
        jl = found.own[w]
        inverse = problem.state_covariance(jl)
        bases[w] = (jl, inverse)
        jg, r = _without(bases[w], shared[w]), found.residual[w]
        normal, pull = normal + jg @ shared[w].T, pull + jg @ r
    changes: dict[int, list[np.ndarray]] = {w: [] for w in windows}
    for first in range(0, len(trials), AT_ONCE):
        some = trials[first : first + AT_ONCE]
        variants = []
        for trial in some:
            model: LawModel = with_effect(found.model, trial.acting.kind, [trial.acting.place])
            variants.append(model.variant(mechanism, simulator.spec, np.concatenate([found.theta, trial.start])))
        jobs = [(w, v) for v in range(len(variants)) for w in windows]
        values = simulator.predict(problem.windows, variants, jobs, found.states.of([w for w, _ in jobs]))
        for (w, _), p in zip(jobs, predicted(problem, jobs, values), strict=True):
            change = p - (problem.targets[w] - found.residual[w])
            changes[w].append(np.clip(np.nan_to_num(change, nan=1e6), -1e6, 1e6))
    gram, slope = np.zeros((len(trials), len(trials))), np.zeros(len(trials))
    cross = np.zeros((len(trials), found.model.size))
    for w in windows:
        d = np.stack(changes[w])
        alone = _without(bases[w], d)
        gram += alone @ d.T
        slope += alone @ found.residual[w]
        cross += alone @ shared[w].T
    if found.model.size:
        solve = np.linalg.pinv(normal, hermitian=True)
        gram -= cross @ solve @ cross.T
        slope -= cross @ solve @ pull
    return gram, slope


def _screened(problem: Problem) -> list[int]:
    """The fitted windows on which effects are ranked: all, or as many, evenly spread, as the budget of steps allows."""
    fitted = [w for w in range(len(problem.windows)) if problem.chosen[w]]
    times = [problem.log.clips[problem.windows[w].clip].time[problem.windows[w].rows] for w in fitted]
    steps = sum(float(np.ptp(t)) for t in times) / problem.simulator.step
    return fitted[:: max(1, round(steps / MOST_STEPS))]


def _without(base: tuple[np.ndarray, np.ndarray], rows: np.ndarray) -> np.ndarray:
    """Rows (k, numbers) without their part that changes of the initial state can make."""
    jl, inverse = base
    return np.asarray(rows - (rows @ jl.T) @ inverse @ jl)
