"""The part of the measurements that the known scene explains, its free numbers fitted there, and intervals of the rest.

What a path is, less the twice integrated acceleration of the model, is straight where the model holds. The acceleration
is that of short pieces of an arc with initial states of their own, which stay near the measured path whatever acts
beside the model. Free numbers and intervals are found in turn, from several starts; those numbers win with which
intervals explain the paths at the lowest price.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.fitting.initial_states import initial_states
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.model import Model
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.tracks.problem import Problem, short_pieces
from pipeline.discovery.where.intervals import Explained, find_intervals

PIECE_SECONDS, LEAST_SAMPLES = 0.25, 8
FINE = 4  # steps of an integration between two samples
QUANTILES = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the numbers that single arcs tell of, from which the search begins
ROUNDS = 4  # numbers and intervals in turn
SAME = 0.02  # standard errors: a smaller change ends the search
LEAST_SPEED = 0.03  # m/s of a body on the ground: a slower one rests
STOP_SAMPLES = 2  # on each side of a stop, that tell nothing of it
LEAST_PART = 5  # samples, from which an interval can be told
UNSEEN = 3.0  # price of a coordinate that belongs to no part
ENDS = 2  # numbers of an interval, beside its acceleration


@dataclass(frozen=True)
class Leftover:
    """What the known scene leaves of a part of a path: straight, but for what acts beside the scene.

    Attributes:
        path: (T, 3) m.
        slope: (G, T, 3) how it changes with each free number.
        weight: (T, 3) 1/m, of independent samples; 0 outside of the part, and of what is not measured.
    """

    path: np.ndarray
    slope: np.ndarray
    weight: np.ndarray


@dataclass(frozen=True)
class CleanPart:
    """Where the known scene holds.

    Attributes:
        model: Of the known scene, without effects.
        theta: (G,) its free numbers, as fitted outside of the intervals.
        covariance: (G, G).
        leftovers: Per arc of the problem, of each part in which its body moves, or rests, what is left of its path.
        explained: What explains each of these.
        cost: Chi squared of the paths, plus the price of their parts, of the intervals, and of what is in neither.
        chi2: Of all measured coordinates, those in no part taken for noise, plus the price of the intervals.
    """

    model: Model
    theta: np.ndarray
    covariance: np.ndarray
    leftovers: tuple[tuple[Leftover, ...], ...]
    explained: tuple[tuple[Explained, ...], ...]
    cost: float
    chi2: float

    @property
    def without_intervals(self) -> CleanPart:
        """The same numbers, with nothing that disagrees with them."""
        explained = tuple(tuple(replace(e, intervals=(), count=0) for e in own) for own in self.explained)
        return replace(self, explained=explained)


@dataclass(frozen=True)
class Motion:
    """What a model makes of an arc: at times (K,) s its acceleration (K, 3) m/s² and speed (K,) m/s."""

    time: np.ndarray
    acceleration: np.ndarray
    speed: np.ndarray

    def at(self, times: np.ndarray) -> np.ndarray:
        """Its acceleration (T, 3) at times (T,) s."""
        return np.stack([np.interp(times, self.time, a) for a in self.acceleration.T], 1)


@dataclass(frozen=True)
class _Paths:
    """The arcs of a problem with what is needed to tell what a model leaves of them.

    Attributes:
        problem: What was measured.
        pieces: The same in short pieces.
        starts: Per stack of the pieces (A, 11), initial states where their fits begin.
        model: Of the known scene.
        weights: Per arc (T, 3) 1/m, of independent samples; 0 of what is not measured.
        price: Of an interval.
    """

    problem: Problem
    pieces: Problem
    starts: list[np.ndarray]
    model: Model
    weights: tuple[np.ndarray, ...]
    price: float

    def motion(self, theta: np.ndarray) -> list[Motion]:
        """Of each arc, as the model has it."""
        pairs = zip(self.pieces.stacks, self.starts, strict=True)
        starts = [fit_initial_states(stack, self.model, theta, begin)[0] for stack, begin in pairs]
        return [own[0] for own in short_motions(self.problem, self.pieces, starts, self.model, theta[None])]

    def left(self, theta: np.ndarray, motions: Sequence[Motion]) -> list[np.ndarray]:
        """Per arc (T, 3) m: its positions, as the camera shows them, minus the twice integrated acceleration of its
        motion at theta."""
        positions = [arc.position for arc in self.problem.arcs]
        for stack in self.problem.stacks:
            off = self.model.as_measured(stack, stack.position[None], theta[None])[0] - stack.position
            for i, k in enumerate(stack.index):
                positions[k] = positions[k] - off[i, : len(positions[k])]
        triples = zip(self.problem.arcs, positions, motions, strict=True)
        return [place - _integrated(arc, motion) for arc, place, motion in triples]

    def parts(self, motions: Sequence[Motion]) -> list[list[np.ndarray]]:
        """Per arc its weights (T, 3) in each part in which the body moves, or rests; 0 elsewhere.

        When it comes to rest is known less exactly than its velocity before and after, so no path leads through that.
        """
        out = []
        for arc, weight, motion in zip(self.problem.arcs, self.weights, motions, strict=True):
            rests = np.interp(arc.time, motion.time, motion.speed) < LEAST_SPEED
            edges = np.flatnonzero(np.diff(rests)) + 1 if arc.grounded else np.zeros(0, int)
            rows = np.arange(len(arc.time))
            inner = [np.isin(rows, p) for p in np.split(rows, edges)]
            near = np.abs(rows[:, None] - edges + 0.5).min(1, initial=np.inf) < STOP_SAMPLES
            found = [np.where((own & ~near)[:, None], weight, 0.0) for own in inner]
            out.append([w for w in found if (w.max(1) > 0).sum() >= LEAST_PART])
        return out

    def unseen(self, parts: list[list[np.ndarray]]) -> int:
        """How many measured coordinates are in none of the parts."""
        shown = sum(int((w > 0).sum()) for own in parts for w in own)
        return sum(int((w > 0).sum()) for w in self.weights) - shown

    def slopes(self, theta: np.ndarray, paths: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Per arc (G, T, 3): how the paths at theta change with each number."""
        out = [np.zeros((self.model.size, *p.shape)) for p in paths]
        for g, unknown in enumerate(self.model.unknowns):
            step = unknown.step if theta[g] + unknown.step <= unknown.high else -unknown.step
            there = theta + step * np.eye(len(theta))[g]
            moved = self.left(there, self.motion(there))
            for own, new, path in zip(out, moved, paths, strict=True):
                own[g] = (new - path) / step
        return out


def find_clean_part(problem: Problem, model: Model, theta: np.ndarray, known: bool = False) -> CleanPart:
    """The clean part of a problem.

    Args:
        problem: What was measured.
        model: Of the known scene.
        theta: (G,) the free numbers, or one of the starts.
        known: The free numbers are known: they are not sought.
    """
    weights = [np.zeros_like(arc.position) for arc in problem.arcs]
    for stack in problem.stacks:
        for i, k in enumerate(stack.index):
            weights[k] = stack.weight[i, : len(weights[k])] * problem.floor.information**0.5
    shown = max((int((w.max(0) > 0).sum()) for w in weights), default=0)
    # BIC's price of an acceleration and two ends; and any two samples of an arc may be ends, in any of the arcs.
    choices = sum(len(w) ** 2 / 2 for w in weights)
    price = float((shown + ENDS) * np.log(problem.effective_rows) + 2 * np.log(max(choices, 1.0)))
    pieces = short_parts(problem)
    paths = _Paths(problem, pieces, initial_states(pieces), model, tuple(weights), price)
    if known:
        return _settled(paths, theta, rounds=1)
    found = [_settled(paths, start, ROUNDS) for start in _starts(paths, theta)]
    return min(found, key=lambda c: c.cost)


def _starts(paths: _Paths, theta: np.ndarray) -> list[np.ndarray]:
    """Free numbers from which the search begins: those given, and quantiles of those that single arcs tell of."""
    size = paths.model.size
    if size == 0:
        return [theta]
    motions = paths.motion(theta)
    left = paths.left(theta, motions)
    told: list[np.ndarray] = []
    slopes, parts = paths.slopes(theta, left), paths.parts(motions)
    for arc, path, slope, own in zip(paths.problem.arcs, left, slopes, parts, strict=True):
        for weight in own:
            for half in np.array_split(np.flatnonzero(weight.max(1) > 0), 2):
                if len(half) < LEAST_PART:
                    continue
                chosen = np.zeros_like(weight)
                chosen[half] = weight[half]
                straight = find_intervals(arc.time, path, chosen, np.inf)
                normal, reach = _normal(Leftover(path, slope, chosen), straight)
                change, known = np.full(size, np.nan), np.diag(normal) > 1e-6
                change[known] = np.linalg.lstsq(normal[np.ix_(known, known)], reach[known], rcond=None)[0]
                told.append(theta + change)
    quantiles = np.tile(theta, (len(QUANTILES), 1))
    for g, values in enumerate(np.array(told).reshape(-1, size).T):
        known = values[np.isfinite(values)]
        if len(known):
            quantiles[:, g] = np.quantile(known, QUANTILES)
    return [theta, *quantiles]


def _settled(paths: _Paths, theta: np.ndarray, rounds: int) -> CleanPart:
    """Numbers and intervals, found in turn."""
    model, problem = paths.model, paths.problem
    low, high = np.array([u.low for u in model.unknowns]), np.array([u.high for u in model.unknowns])
    prior = np.diag([1 / u.sigma**2 for u in model.unknowns]).reshape(model.size, model.size)
    theta = np.clip(theta, low, high)
    for turn in range(rounds):
        motions = paths.motion(theta)
        left, parts = paths.left(theta, motions), paths.parts(motions)
        explained = [
            tuple(find_intervals(arc.time, path, weight, paths.price) for weight in own)
            for arc, path, own in zip(problem.arcs, left, parts, strict=True)
        ]
        leftovers = [
            tuple(Leftover(path, slope, weight) for weight in own)
            for path, slope, own in zip(left, paths.slopes(theta, left), parts, strict=True)
        ]
        normal, reach = prior.copy(), -prior @ (theta - model.start)
        for own, found in zip(leftovers, explained, strict=True):
            for leftover, part in zip(own, found, strict=True):
                more, pull = _normal(leftover, part)
                normal, reach = normal + more, reach + pull
        covariance = np.linalg.pinv(normal)
        change = np.clip(theta + covariance @ reach, low, high) - theta
        if turn == rounds - 1 or (np.abs(change) <= SAME * np.sqrt(np.diag(covariance))).all():
            break
        theta = theta + change
    each = [e for own in explained for e in own]
    unseen, chi2 = paths.unseen(parts), sum(e.chi2 + paths.price * e.count for e in each)
    cost = chi2 + paths.price * len(each) + UNSEEN * unseen
    chi2 = float(chi2) + unseen
    return CleanPart(model, theta, covariance, tuple(leftovers), tuple(explained), float(cost), chi2)


def _normal(left: Leftover, own: Explained) -> tuple[np.ndarray, np.ndarray]:
    """Normal matrix (G, G) and right side (G,) of the free numbers in one part, beside its line and intervals."""
    y, x = left.weight * left.path, left.weight * left.slope
    y = y - own.basis @ (own.basis.T @ y)
    x = x - np.einsum("tk,sk,gsc->gtc", own.basis, own.basis, x, optimize=True)
    return np.einsum("gtc,htc->gh", x, x), -np.einsum("gtc,tc->g", x, y)


def short_parts(problem: Problem) -> Problem:
    """A problem in pieces so short that a model stays near the measured path."""
    return short_pieces(problem, PIECE_SECONDS, LEAST_SAMPLES)


def short_motions(
    problem: Problem, pieces: Problem, starts: Sequence[np.ndarray], model: Model, theta: np.ndarray
) -> list[list[Motion]]:
    """Per arc of a problem the motion at each of theta (P, G), from that of its pieces.

    starts: per stack of the pieces (A, 11), their initial states.
    """
    known: dict[tuple[str, int], list[list[Motion]]] = {}
    for stack, start in zip(pieces.stacks, starts, strict=True):
        _, nodes = run(stack, model, theta, np.broadcast_to(start, (len(theta), *start.shape)))
        for i in range(len(stack)):
            arc = pieces.arcs[stack.index[i]]
            times = arc.time[0] + np.linspace(0, stack.duration[i], stack.steps + 1)
            velocity = nodes.velocity[:, i]
            change = np.diff(velocity, axis=1) / np.diff(times)[:, None]
            speed = np.linalg.norm(velocity[:, 1:] + velocity[:, :-1], axis=2) / 2
            middle = (times[1:] + times[:-1]) / 2
            own = [Motion(middle, *pair) for pair in zip(change, speed, strict=True)]
            known.setdefault((arc.clip, arc.object), []).append(own)
    return [
        [_joined([own[p] for own in known.get((arc.clip, arc.object), [])], arc) for p in range(len(theta))]
        for arc in problem.arcs
    ]


def _joined(parts: list[Motion], arc: Arc) -> Motion:
    """The motion of an arc from that of its pieces; of an arc without any, at rest."""
    if not parts:
        return Motion(arc.time[:1], np.zeros((1, 3)), np.zeros(1))
    time = np.concatenate([p.time for p in parts])
    order = np.argsort(time)
    return Motion(
        time[order],
        np.concatenate([p.acceleration for p in parts])[order],
        np.concatenate([p.speed for p in parts])[order],
    )


def _integrated(arc: Arc, motion: Motion) -> np.ndarray:
    """(T, 3) m at an arc's samples: the acceleration, integrated twice from rest at 0."""
    fine = np.linspace(arc.time[0], arc.time[-1], FINE * len(arc.time))
    acceleration = motion.at(fine)
    step = fine[1] - fine[0]
    velocity = np.concatenate([np.zeros((1, 3)), np.cumsum((acceleration[1:] + acceleration[:-1]) * step / 2, axis=0)])
    path = np.concatenate([np.zeros((1, 3)), np.cumsum((velocity[1:] + velocity[:-1]) * step / 2, axis=0)])
    return np.stack([np.interp(arc.time, fine, p) for p in path.T], 1)
