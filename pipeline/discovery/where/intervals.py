"""Intervals of a path in which something unknown acts: change points of a force that is zero outside of them.

A path here is a measured one minus the twice integrated acceleration of a model. Where the model holds it is straight;
in an interval from a to b with a constant force it gains half of (t - a)² - (t - b)², cut off at zero. So the gain of
every interval is that of the difference of two columns of one design, and all pairs of ends are compared at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.tracks.arc import Arc

BLOW = 1  # sample
BLOW_SAMPLES = 2.5  # a shorter interval is a blow, which has no region
MOST = 12  # intervals of one path, before those that touch are made one
LEAST_SQUARE = 1e-9  # of a column, relative: what a straight line explains cannot be told


@dataclass(frozen=True)
class Interval:
    """A part of a path in which something unknown acts.

    Attributes:
        start: s.
        end: s.
        acceleration: (3,) m/s², the mean of what is missing; 0 in coordinates that are not measured.
        error: m/s², standard error of each component.
        gain: By which chi squared falls with it.
    """

    start: float
    end: float
    acceleration: np.ndarray
    error: float
    gain: float


@dataclass(frozen=True)
class Explained:
    """A path explained by intervals in which something unknown acts.

    Attributes:
        intervals: In the order of time; those that touch are one.
        count: Of intervals with a constant acceleration each, before those that touch were made one.
        chi2: What they leave.
        basis: (T, K) orthonormal columns of what they and a straight line explain, in units of the noise; rows of
            samples that are not measured are 0.
    """

    intervals: tuple[Interval, ...]
    count: int
    chi2: float
    basis: np.ndarray


def find_intervals(time: np.ndarray, path: np.ndarray, weight: np.ndarray, price: float) -> Explained:
    """The intervals of a path.

    Args:
        time: (T,) s, increasing.
        path: (T, 3) m.
        weight: (T, 3) 1/m, inverse standard deviations of independent samples; 0 where a coordinate is not measured.
            At least three samples are measured.
        price: By which chi squared has to fall with each interval.
    """
    rows = _rows(time, path, weight)
    chosen: list[tuple[int, int]] = []
    while len(chosen) < MOST:
        best, gain = _best_pair(rows, chosen)
        if gain < price:
            break
        chosen = _refined(rows, [*chosen, best])
    chosen = _worth_their_price(rows, chosen, price)
    chosen = _up_to_the_ends(rows, _as_blows(rows, chosen, price / 10), price / 4)
    return _explained(rows, _worth_their_price(rows, chosen, price))


def intervals_where(
    time: np.ndarray, path: np.ndarray, weight: np.ndarray, acts: np.ndarray, beside: Sequence[Interval], price: float
) -> Explained:
    """The intervals in which a known law acts and shows, and others.

    Args:
        time: As `find_intervals` has it.
        path: As `find_intervals` has it.
        weight: As `find_intervals` has it.
        acts: (T,) bool, the samples at which the law acts.
        beside: Intervals of which those are kept that lie outside of that.
        price: By which chi squared has to fall with each number of an acceleration.
    """
    rows = _rows(time, path, weight)
    changes = np.flatnonzero(np.diff(np.concatenate([[False], acts[rows.there], [False]]).astype(int)))
    chosen = list(zip(changes[::2].tolist(), changes[1::2].tolist(), strict=True))
    chosen = _worth_their_price(rows, chosen, price * int(rows.shown.sum()))
    for v in beside:
        pair = int(np.abs(rows.edges - v.start).argmin()), int(np.abs(rows.edges - v.end).argmin())
        if pair[0] < pair[1] and not any(pair[0] < end and start < pair[1] for start, end in chosen):
            chosen.append(pair)
    return _explained(rows, chosen)


@dataclass(frozen=True)
class _Rows:
    """A path in units of its noise.

    Attributes:
        there: (T,) bool, the n samples that are measured.
        shown: (3,) bool, the C coordinates that are measured.
        edges: (n + 1,) s, about the samples.
        bends: (n, n + 1), columns of accelerations that begin at each edge.
        straight: (n, 2), columns of a straight line.
        y: (n, C).
    """

    there: np.ndarray
    shown: np.ndarray
    edges: np.ndarray
    bends: np.ndarray
    straight: np.ndarray
    y: np.ndarray

    @property
    def last(self) -> int:
        """Index of the last edge."""
        return len(self.edges) - 1


def _rows(time: np.ndarray, path: np.ndarray, weight: np.ndarray) -> _Rows:
    shown, there = weight.max(0) > 0, weight.max(1) > 0
    t, w = time[there], weight[there].max(1)[:, None]
    edges, bends = bends_at(t)
    straight = np.column_stack([np.ones_like(t), t - t.mean()])
    return _Rows(there, shown, edges, w * bends, w * straight, w * path[there][:, shown])


def _explained(rows: _Rows, chosen: list[tuple[int, int]]) -> Explained:
    """A path explained by the intervals between these edges."""
    basis = np.zeros((len(rows.there), 2 + len(chosen)))
    basis[rows.there], _ = np.linalg.qr(_design(rows, chosen))
    found = tuple(_interval(pair, rows, chosen) for pair in _merged(chosen))
    return Explained(found, len(chosen), _chi2(rows, chosen), basis)


def bends_at(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (T + 1,) s about samples at times (T,) s, and how a path bends there (T, T + 1) s²: by the twice integrated
    unit acceleration that begins at each edge."""
    edges = np.concatenate([time[:1], (time[1:] + time[:-1]) / 2, time[-1:]])
    return edges, 0.5 * np.maximum(time[:, None] - edges, 0) ** 2


def _design(rows: _Rows, chosen: list[tuple[int, int]]) -> np.ndarray:
    """(n, 2 + K) columns of a straight line and of K intervals."""
    return np.column_stack([rows.straight, *(rows.bends[:, start] - rows.bends[:, end] for start, end in chosen)])


def _best_pair(rows: _Rows, chosen: list[tuple[int, int]], most: int | None = None) -> tuple[tuple[int, int], float]:
    """The ends of the interval that explains most of what the chosen ones leave, and by how much chi squared falls.

    most: samples of the interval; None: any number.
    """
    basis, _ = np.linalg.qr(_design(rows, chosen))
    free = rows.bends - basis @ (basis.T @ rows.bends)
    left = rows.y - basis @ (basis.T @ rows.y)
    reach, gram = free.T @ left, free.T @ free
    square = np.diag(gram)[:, None] + np.diag(gram) - 2 * gram
    scale = float((rows.bends**2).sum(0).max()) * LEAST_SQUARE
    gains = np.triu(((reach[:, None] - reach[None]) ** 2).sum(-1) / np.maximum(square, scale), 1)
    if most is not None:
        gains -= np.triu(gains, most + 1)
    i, j = np.unravel_index(int(gains.argmax()), gains.shape)
    return (int(i), int(j)), float(gains[i, j])


def _refined(rows: _Rows, chosen: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The intervals, each moved once to where it explains most beside the others."""
    for k in range(len(chosen)):
        others = [*chosen[:k], *chosen[k + 1 :]]
        chosen = [*chosen[:k], _best_pair(rows, others)[0], *chosen[k + 1 :]]
    return chosen


def _chi2(rows: _Rows, chosen: list[tuple[int, int]]) -> float:
    basis, _ = np.linalg.qr(_design(rows, chosen))
    return float((rows.y**2).sum() - ((basis.T @ rows.y) ** 2).sum())


def _worth_their_price(rows: _Rows, chosen: list[tuple[int, int]], price: float) -> list[tuple[int, int]]:
    """The intervals without those that chi squared falls too little with, the least first."""
    while chosen:
        whole = _chi2(rows, chosen)
        gains = [_chi2(rows, [*chosen[:k], *chosen[k + 1 :]]) - whole for k in range(len(chosen))]
        worst = int(np.argmin(gains))
        if gains[worst] >= price:
            break
        chosen = [*chosen[:worst], *chosen[worst + 1 :]]
    return chosen


def _as_blows(rows: _Rows, chosen: list[tuple[int, int]], price: float) -> list[tuple[int, int]]:
    """The intervals, of which each is a blow where that, which has a number less, explains about as much.

    price: Of one number.
    """
    for k in range(len(chosen)):
        others = [*chosen[:k], *chosen[k + 1 :]]
        blow = [*others, _best_pair(rows, others, BLOW)[0]]
        spared = 0.0 if 0 in chosen[k] or rows.last in chosen[k] else price  # an end of the path is no number
        if _chi2(rows, blow) < _chi2(rows, chosen) + spared:
            chosen = [*chosen[:k], blow[-1], *chosen[k + 1 :]]
    return chosen


def _up_to_the_ends(rows: _Rows, chosen: list[tuple[int, int]], price: float) -> list[tuple[int, int]]:
    """The intervals, of which the first begins and the last ends with the path where that spares the number of an end.

    price: Of one number.
    """
    for end in (0, rows.last):
        if not chosen:
            break
        k = chosen.index(min(chosen) if end == 0 else max(chosen, key=lambda c: c[1]))
        moved = (0, chosen[k][1]) if end == 0 else (chosen[k][0], rows.last)
        other = [*chosen[:k], moved, *chosen[k + 1 :]]
        if moved[1] - moved[0] > 2 * (chosen[k][1] - chosen[k][0]):  # what is short is no part of what is long
            continue
        if _chi2(rows, other) < _chi2(rows, chosen) + price:
            chosen = other
    return chosen


def _merged(chosen: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """Intervals in the order of time, those that touch or overlap as one."""
    out: list[tuple[int, int]] = []
    for start, end in sorted(chosen):
        if out and start <= out[-1][1]:
            out[-1] = (out[-1][0], max(out[-1][1], end))
        else:
            out.append((start, end))
    return out


def _interval(
    pair: tuple[int, int],
    rows: _Rows,
    chosen: list[tuple[int, int]],
) -> Interval:
    """An interval of one or several of the chosen ones, with its mean acceleration."""
    others = [c for c in chosen if not (pair[0] <= c[0] and c[1] <= pair[1])]
    gain = _chi2(rows, others) - _chi2(rows, chosen)
    design = _design(rows, [*others, pair])
    inverse = np.linalg.pinv(design.T @ design)
    acceleration = np.zeros(3)
    acceleration[rows.shown] = (inverse @ (design.T @ rows.y))[-1]
    start, end = (float(rows.edges[k]) for k in pair)
    return Interval(start, end, acceleration, float(inverse[-1, -1] ** 0.5), gain)


def is_blow(interval: Interval, arc: Arc) -> bool:
    """Whether an interval of an arc is so short that it has no extent."""
    return bool(interval.end - interval.start < BLOW_SAMPLES * np.median(np.diff(arc.time)))
