"""Intervals of a path in which something unknown acts: change points of a force that is zero outside of them.

A path here is a measured one minus the twice integrated acceleration of a model. Where the model holds it is straight;
in an interval from a to b with a constant force it gains half of (t - a)² - (t - b)², cut off at zero. So the gain of
every interval is that of the difference of two columns of one design, and all pairs of ends are compared at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

BLOW = 1  # sample
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
    shown = weight.max(0) > 0
    there = weight.max(1) > 0
    t, w = time[there], weight[there].max(1)
    edges = np.concatenate([[t[0]], (t[1:] + t[:-1]) / 2, [t[-1]]])
    bends = w[:, None] * 0.5 * np.maximum(t[:, None] - edges, 0) ** 2  # (n, E)
    straight = w[:, None] * np.column_stack([np.ones_like(t), t - t.mean()])
    y = w[:, None] * path[there][:, shown]
    chosen: list[tuple[int, int]] = []
    while len(chosen) < MOST:
        best, gain = _best_pair(bends, straight, y, chosen)
        if gain < price:
            break
        chosen = _refined(bends, straight, y, [*chosen, best])
    chosen = _worth_their_price(bends, straight, y, chosen, price)
    chosen = _up_to_the_ends(bends, straight, y, _as_blows(bends, straight, y, chosen, price / 10), price / 4)
    chosen = _worth_their_price(bends, straight, y, chosen, price)
    basis = np.zeros((len(time), 2 + len(chosen)))
    basis[there], _ = np.linalg.qr(_design(bends, straight, chosen))
    found = tuple(_interval(pair, edges, bends, straight, y, chosen, shown) for pair in _merged(chosen))
    return Explained(found, len(chosen), _chi2(bends, straight, y, chosen), basis)


def _column(bends: np.ndarray, pair: tuple[int, int]) -> np.ndarray:
    return np.asarray(bends[:, pair[0]] - bends[:, pair[1]])


def _design(bends: np.ndarray, straight: np.ndarray, chosen: list[tuple[int, int]]) -> np.ndarray:
    return np.column_stack([straight, *(_column(bends, p) for p in chosen)])


def _best_pair(
    bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]], most: int | None = None
) -> tuple[tuple[int, int], float]:
    """The ends of the interval that explains most of what the chosen ones leave, and by how much chi squared falls.

    most: samples of the interval; None: any number.
    """
    basis, _ = np.linalg.qr(_design(bends, straight, chosen))
    free = bends - basis @ (basis.T @ bends)
    left = y - basis @ (basis.T @ y)
    reach, gram = free.T @ left, free.T @ free
    square = np.diag(gram)[:, None] + np.diag(gram) - 2 * gram
    scale = float((bends * bends).sum(0).max()) * LEAST_SQUARE
    gains = np.triu(((reach[:, None] - reach[None]) ** 2).sum(-1) / np.maximum(square, scale), 1)
    if most is not None:
        gains -= np.triu(gains, most + 1)
    i, j = np.unravel_index(int(gains.argmax()), gains.shape)
    return (int(i), int(j)), float(gains[i, j])


def _refined(
    bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]]
) -> list[tuple[int, int]]:
    """The intervals, each moved once to where it explains most beside the others."""
    for k in range(len(chosen)):
        others = [*chosen[:k], *chosen[k + 1 :]]
        chosen = [*chosen[:k], _best_pair(bends, straight, y, others)[0], *chosen[k + 1 :]]
    return chosen


def _chi2(bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]]) -> float:
    basis, _ = np.linalg.qr(_design(bends, straight, chosen))
    return float((y * y).sum() - ((basis.T @ y) ** 2).sum())


def _worth_their_price(
    bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]], price: float
) -> list[tuple[int, int]]:
    """The intervals without those that chi squared falls too little with, the least first."""
    while chosen:
        whole = _chi2(bends, straight, y, chosen)
        gains = [_chi2(bends, straight, y, [*chosen[:k], *chosen[k + 1 :]]) - whole for k in range(len(chosen))]
        worst = int(np.argmin(gains))
        if gains[worst] >= price:
            break
        chosen = [*chosen[:worst], *chosen[worst + 1 :]]
    return chosen


def _as_blows(
    bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]], price: float
) -> list[tuple[int, int]]:
    """The intervals, of which each is a blow where that, which has a number less, explains about as much.

    price: Of one number.
    """
    for k in range(len(chosen)):
        others = [*chosen[:k], *chosen[k + 1 :]]
        blow = [*others, _best_pair(bends, straight, y, others, BLOW)[0]]
        spared = 0.0 if 0 in chosen[k] or bends.shape[1] - 1 in chosen[k] else price  # an end of the path is no number
        if _chi2(bends, straight, y, blow) < _chi2(bends, straight, y, chosen) + spared:
            chosen = [*chosen[:k], blow[-1], *chosen[k + 1 :]]
    return chosen


def _up_to_the_ends(
    bends: np.ndarray, straight: np.ndarray, y: np.ndarray, chosen: list[tuple[int, int]], price: float
) -> list[tuple[int, int]]:
    """The intervals, of which the first begins and the last ends with the path where that spares the number of an end.

    price: Of one number.
    """
    last = bends.shape[1] - 1
    for end in (0, last):
        if not chosen:
            break
        k = chosen.index(min(chosen) if end == 0 else max(chosen, key=lambda c: c[1]))
        moved = (0, chosen[k][1]) if end == 0 else (chosen[k][0], last)
        other = [*chosen[:k], moved, *chosen[k + 1 :]]
        if moved[1] - moved[0] > 2 * (chosen[k][1] - chosen[k][0]):  # what is short is no part of what is long
            continue
        if _chi2(bends, straight, y, other) < _chi2(bends, straight, y, chosen) + price:
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
    edges: np.ndarray,
    bends: np.ndarray,
    straight: np.ndarray,
    y: np.ndarray,
    chosen: list[tuple[int, int]],
    shown: np.ndarray,
) -> Interval:
    """An interval of one or several of the chosen ones, with its mean acceleration."""
    others = [c for c in chosen if not (pair[0] <= c[0] and c[1] <= pair[1])]
    gain = _chi2(bends, straight, y, others) - _chi2(bends, straight, y, chosen)
    design = _design(bends, straight, [*others, pair])
    inverse = np.linalg.pinv(design.T @ design)
    acceleration = np.zeros(3)
    acceleration[shown] = (inverse @ (design.T @ y))[-1]
    return Interval(float(edges[pair[0]]), float(edges[pair[1]]), acceleration, float(inverse[-1, -1] ** 0.5), gain)
