"""Everything that selection works on: arcs of the fitted and the held-out clips, cleaned, in units of their own
noise."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.arc import Arc, Cut, Impact, cut_tracks
from pipeline.discrepancy.fit import first_starts
from pipeline.discrepancy.frame_rate import frame_rate
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.smooth import NoiseFloor, Smooth, cleaned, noise_floor
from pipeline.discrepancy.stack import ArcStack, stack_arcs
from pipeline.discrepancy.track import Track
from pipeline.errors import MeasurementError

RULER = 0.03  # relative: how far the length scales of recordings may be apart


@dataclass(frozen=True)
class Problem:
    """fitted, held_out: names of clips. arcs: all; stacks: of flights and of motion on the ground, as far as there
    are any; chosen: per stack the fitted arcs (A,) bool. parts: the polynomials of the stacks. sigma: noise of a
    coordinate, m. frame_rate: samples a second where they are regular. broken: how many arcs were left out because
    nothing explains them. blunt: the noise is all that a model left, so that nothing can be left beyond it."""

    known: KnownScene
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    arcs: tuple[Arc, ...]
    impacts: tuple[Impact, ...]
    stacks: tuple[ArcStack, ...]
    chosen: tuple[np.ndarray, ...]
    parts: tuple[Smooth, ...]
    floor: NoiseFloor
    sigma: float
    outliers: int
    frame_rate: float | None = None
    broken: int = 0
    blunt: bool = False

    @property
    def held(self) -> tuple[np.ndarray, ...]:
        return tuple(~c for c in self.chosen)

    @property
    def rows(self) -> int:
        """Measured coordinates."""
        return sum(int((s.weight > 0).sum()) for s in self.stacks)

    @property
    def own(self) -> int:
        """Numbers that are the arcs' own and that positions show."""
        return sum(s.own * int((s.samples > 0).sum()) for s in self.stacks)

    @property
    def effective_rows(self) -> float:
        """Independent coordinates."""
        return max(self.rows * self.floor.information, 2.0)

    @property
    def jumps(self) -> int:
        """How many jumps of velocity nothing known explains."""
        return sum(len(a.jumps) for a in self.arcs)


def pose(tracks: Sequence[Track], known: KnownScene, held_out: float, rng: np.random.Generator) -> Problem:
    """The problem of some tracks; held_out: the share of clips that is not fitted. Raises `MeasurementError`."""
    clips = tuple(dict.fromkeys(t.clip for t in tracks))
    count = min(max(round(held_out * len(clips)), 1 if held_out > 0 else 0), len(clips) - 1)
    apart = frozenset(clips[i] for i in rng.permutation(len(clips))[:count])
    cut = cut_tracks(tracks, known)
    if not cut.arcs:
        raise MeasurementError("no clip has a smooth stretch of 6 samples in the air or level on the ground")
    return replace(_posed(cut, cut.arcs, known, clips, apart), frame_rate=frame_rate(tracks))


def split_at_jumps(problem: Problem) -> Problem:
    """The same with arcs cut in two where their velocity jumps, as if something had been hit there."""
    pieces: list[Arc] = []
    for arc in problem.arcs:
        edges = [-np.inf, *(b.time for b in arc.jumps), np.inf]
        for left, right in itertools.pairwise(edges):
            inside = (arc.time > left) & (arc.time < right)
            if inside.sum() >= 4:
                pieces.append(replace(
                    arc, time=arc.time[inside], position=arc.position[inside], sigma=arc.sigma[inside],
                    row=arc.row[inside], others=arc.others[inside], spin=None if arc.spin is None else arc.spin[inside],
                    quaternion=None if arc.quaternion is None else arc.quaternion[inside], jumps=(),
                ))  # fmt: skip
    clips = (*problem.fitted, *problem.held_out)
    cut = Cut(tuple(pieces), (), problem.sigma, frozenset())
    split = _posed(cut, cut.arcs, problem.known, clips, frozenset(problem.held_out), problem)
    return replace(split, outliers=problem.outliers, frame_rate=problem.frame_rate)


def _posed(
    cut: Cut, arcs: Sequence[Arc], known: KnownScene, clips: Sequence[str], apart: frozenset[str],
    like: Problem | None = None,
) -> Problem:  # fmt: skip
    """`like`: a problem whose noise is taken over."""
    stacks, parts, dropped = [], [], 0
    for grounded in (False, True):
        stack = stack_arcs(arcs, clips, known, grounded)
        if len(stack):
            stack, part, bad = cleaned(stack, [arcs[i].jumps for i in stack.index])
            stacks.append(stack)
            parts.append(part)
            dropped += bad
    floor = noise_floor(parts) if like is None else like.floor
    stacks = [replace(s, weight=s.weight / floor.scale) for s in stacks]
    parts = [replace(p, chi2=p.chi2 / floor.scale**2) for p in parts]
    chosen = tuple(np.array([clips[c] not in apart for c in s.clip]) for s in stacks)
    if not any(c.any() for c in chosen):  # what could be fitted is all in clips held out: fit it after all
        apart, chosen = frozenset(), tuple(np.ones(len(s), bool) for s in stacks)
    sigmas = np.concatenate([1 / s.weight[s.weight > 0] for s in stacks])
    return Problem(
        known, tuple(c for c in clips if c not in apart), tuple(c for c in clips if c in apart), tuple(arcs),
        cut.impacts, tuple(stacks), chosen, tuple(parts), floor, float(np.median(sigmas)), len(cut.outliers) + dropped,
    )  # fmt: skip


def with_rulers(problem: Problem) -> Problem:
    """The same where each arc may have a length scale of its own: recordings made at several distances."""
    return replace(problem, stacks=tuple(replace(s, ruler=RULER) for s in problem.stacks))


def blunted(problem: Problem, share: float) -> Problem:
    """The same with noise whose variance is larger by 1 / share."""
    weight = share**0.5
    return replace(
        problem, stacks=tuple(replace(s, weight=s.weight * weight) for s in problem.stacks),
        parts=tuple(replace(p, chi2=p.chi2 * share) for p in problem.parts),
        floor=replace(problem.floor, scale=problem.floor.scale / weight, correlation=0.0),
        blunt=True,
    )  # fmt: skip


def starts_of(problem: Problem) -> list[np.ndarray]:
    """Initial states to begin fits with."""
    return [first_starts(s) for s in problem.stacks]
