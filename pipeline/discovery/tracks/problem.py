"""The problem that models are fitted to: the arcs of the fitted and the held-out clips in units of their noise."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discovery.tracks.arc import FAR_AWAY, Arc, Cut, Impact
from pipeline.discovery.tracks.cutting import cut_tracks
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.noise_floor import ArcPolynomials, NoiseFloor, noise_floor, without_outliers
from pipeline.discovery.tracks.smoothing import UNFILTERED, TrackNoise
from pipeline.discovery.tracks.stack import ArcStack, stack_arcs
from pipeline.discovery.tracks.track import Track, frame_rate
from pipeline.errors import MeasurementError

LENGTH_SCALE_SIGMA = 0.03  # relative: how much the length scales of recordings may differ
FRICTION_SIGMA = 0.1  # relative: how much the sliding friction of single slides may differ
SPIN_SIGMA = 100.0  # rad/s, of spins that were not measured: balls are thrown and hit with up to some 30 turns a second
LEAST_PIECE = 4  # samples of a piece of an arc that is split


@dataclass(frozen=True)
class Problem:
    """Arcs of the fitted and the held-out clips, without outliers.

    Attributes:
        known: The known scene.
        fitted: Names of the clips that are fitted.
        held_out: Names of the clips that are not.
        arcs: All arcs.
        impacts: Between the arcs.
        stacks: The arcs in the air and those on the ground, where there are any.
        chosen: Per stack (A,) bool, the arcs of the fitted clips.
        polynomials: Of each stack.
        floor: The noise of all arcs.
        sigma: Standard deviation of a coordinate, m.
        outliers: Number of samples that were removed.
        frame_rate: Samples per second, where they are regular.
        dropped: Number of arcs that were removed because the best model does not explain them.
        noise_inflated: Whether the residuals of a model count as noise (`inflate_noise`).
    """

    known: KnownScene
    fitted: tuple[str, ...]
    held_out: tuple[str, ...]
    arcs: tuple[Arc, ...]
    impacts: tuple[Impact, ...]
    stacks: tuple[ArcStack, ...]
    chosen: tuple[np.ndarray, ...]
    polynomials: tuple[ArcPolynomials, ...]
    floor: NoiseFloor
    sigma: float
    outliers: int
    frame_rate: float | None = None
    dropped: int = 0
    noise_inflated: bool = False

    @property
    def clips(self) -> tuple[str, ...]:
        """Names of all clips."""
        return (*self.fitted, *self.held_out)

    @property
    def held(self) -> tuple[np.ndarray, ...]:
        """Per stack (A,) bool, the arcs of the held-out clips."""
        return tuple(~c for c in self.chosen)

    @property
    def rows(self) -> int:
        """Number of measured coordinates."""
        return sum(int((s.weight > 0).sum()) for s in self.stacks)

    @property
    def own(self) -> int:
        """Number of the arcs' own parameters that positions determine."""
        return sum(s.own * int((s.samples > 0).sum()) for s in self.stacks)

    @property
    def effective_rows(self) -> float:
        """Number of independent coordinates."""
        return max(self.rows * self.floor.information, 2.0)

    @property
    def one_camera(self) -> bool:
        """Whether one camera measured all positions, of which not all is known."""
        return any(s.camera_error is not None for s in self.stacks)

    @property
    def jumps(self) -> int:
        """Number of velocity jumps that no known impact explains."""
        return sum(len(a.jumps) for a in self.arcs)


def build_problem(tracks: Sequence[Track], known: KnownScene, held_out: float, rng: np.random.Generator) -> Problem:
    """The problem of some tracks.

    Args:
        tracks: Of all clips.
        known: The known scene.
        held_out: Share of the clips that is not fitted.
        rng: Chooses these clips.

    Raises:
        MeasurementError: For tracks that do not fit the scene, or that have nothing to be fitted.
    """
    clips = tuple(dict.fromkeys(t.clip for t in tracks))
    count = min(max(round(held_out * len(clips)), 1 if held_out > 0 else 0), len(clips) - 1)
    held = _held_out(tracks, [clips[i] for i in rng.permutation(len(clips))], count)
    cut = cut_tracks(tracks, known)
    if not cut.arcs:
        raise MeasurementError("no clip has a smooth stretch of 6 samples in the air or level on the ground")
    if all(np.ptp(a.position, axis=0).max() == 0 for a in cut.arcs):
        raise MeasurementError("no body moves: every position of each object is the same")
    return replace(_stacked(cut, known, clips, held), frame_rate=frame_rate(tracks))


def _held_out(tracks: Sequence[Track], clips: Sequence[str], count: int) -> frozenset[str]:
    """The first `count` of the clips without which each object is still in another clip."""
    shown = {clip: {t.object for t in tracks if t.clip == clip} for clip in clips}
    held: list[str] = []
    for clip in clips:
        rest = [shown[c] for c in clips if c != clip and c not in held]
        if len(held) < count and shown[clip] <= set().union(*rest):
            held.append(clip)
    return frozenset(held)


def hold_out(problem: Problem, clips: Sequence[str]) -> Problem:
    """The problem in which some clips are held out and all others are fitted."""
    chosen = tuple(~np.isin(s.clip, clips) for s in problem.stacks)
    return replace(
        problem, fitted=tuple(c for c in problem.clips if c not in clips), held_out=tuple(clips), chosen=chosen
    )


def recorded_alone(problem: Problem) -> tuple[int, ...]:
    """The objects, where no clip shows more than one of them; else none."""
    objects = {clip: {a.object for a in problem.arcs if a.clip == clip} for clip in problem.clips}
    together = any(len(o) > 1 for o in objects.values()) or any((a.others < FAR_AWAY).any() for a in problem.arcs)
    return () if together else tuple(sorted(set().union(*objects.values())))


def split_at_jumps(problem: Problem) -> Problem:
    """The problem with arcs cut where their velocity jumps, as if something had been hit there."""
    reach = problem.floor.smoothing.reach

    def parts(arc: Arc) -> list[np.ndarray]:
        edges = [-np.inf, *(jump.time for jump in arc.jumps), np.inf]
        inside = [(arc.time > a + reach) & (arc.time < b - reach) for a, b in itertools.pairwise(edges)]
        return [i for i in inside if i.sum() >= LEAST_PIECE]

    return _split(problem, parts)


def short_pieces(problem: Problem, seconds: float, least: int) -> Problem:
    """The problem with arcs cut into pieces of about so many seconds, each of at least so many samples."""

    def parts(arc: Arc) -> list[np.ndarray]:
        count = max(1, min(round((arc.time[-1] - arc.time[0]) / seconds), len(arc.time) // least))
        rows = np.arange(len(arc.time))
        return [np.isin(rows, part) for part in np.array_split(rows, count)]

    return _split(problem, parts)


def _split(problem: Problem, parts: Callable[[Arc], list[np.ndarray]]) -> Problem:
    """The problem with each arc cut into the parts, each (T,) bool, that a function tells."""
    pieces = [
        replace(
            arc,
            time=arc.time[inside],
            position=arc.position[inside],
            sigma=arc.sigma[inside],
            row=arc.row[inside],
            others=arc.others[inside],
            spin=None if arc.spin is None else arc.spin[inside],
            quaternion=None if arc.quaternion is None else arc.quaternion[inside],
            jumps=(),
        )
        for arc in problem.arcs
        for inside in parts(arc)
    ]
    cut = Cut(tuple(pieces), (), TrackNoise(problem.sigma, problem.floor.smoothing), frozenset())
    split = _stacked(cut, problem.known, problem.clips, frozenset(problem.held_out), problem.floor)
    return replace(split, outliers=problem.outliers, frame_rate=problem.frame_rate)


def _stacked(
    cut: Cut, known: KnownScene, clips: Sequence[str], held: frozenset[str], floor: NoiseFloor | None = None
) -> Problem:
    """The problem of cut tracks. floor: the noise, where it is known already."""
    share = cut.noise.smoothing.information
    stacks, polynomials, dropped = [], [], 0
    for grounded in (False, True):
        stack = stack_arcs(cut.arcs, known, grounded)
        if len(stack):
            stack, part, bad = without_outliers(stack, [cut.arcs[i].jumps for i in stack.index], share)
            stacks.append(stack)
            polynomials.append(part)
            dropped += bad
    if floor is None:
        floor = _floor_of_filtered(cut) if cut.noise.smoothing.width else noise_floor(polynomials)
    stacks = [replace(s, weight=s.weight / floor.scale) for s in stacks]
    polynomials = [replace(p, chi2=p.chi2 / floor.scale**2) for p in polynomials]
    chosen = tuple(np.array([c not in held for c in s.clip]) for s in stacks)
    if not any(c.any() for c in chosen):  # all arcs are in held-out clips: fit them after all
        held, chosen = frozenset(), tuple(np.ones(len(s), bool) for s in stacks)
    sigmas = np.concatenate([1 / s.weight[s.weight > 0] for s in stacks])
    return Problem(
        known=known,
        fitted=tuple(c for c in clips if c not in held),
        held_out=tuple(c for c in clips if c in held),
        arcs=cut.arcs,
        impacts=cut.impacts,
        stacks=tuple(stacks),
        chosen=chosen,
        polynomials=tuple(polynomials),
        floor=floor,
        sigma=float(np.median(sigmas)),
        outliers=len(cut.outliers) + dropped,
    )


def _floor_of_filtered(cut: Cut) -> NoiseFloor:
    """The noise floor of smoothed positions. Polynomials do not tell it: in a short arc they fit filtered noise."""
    noise, stated = cut.noise, float(np.median(np.concatenate([a.sigma for a in cut.arcs])))
    return NoiseFloor(noise.sigma * noise.smoothing.information**0.5 / stated, 0.0, noise.smoothing)


def with_length_scale_nuisance(problem: Problem) -> Problem:
    """The problem in which each arc has a length scale of its own: recordings made at several distances."""
    return replace(problem, stacks=tuple(replace(s, length_scale_sigma=LENGTH_SCALE_SIGMA) for s in problem.stacks))


def with_friction_nuisance(problem: Problem) -> Problem:
    """The problem in which each slide has a friction of its own: surfaces differ from place to place."""
    slides = (replace(s, friction_sigma=FRICTION_SIGMA) if s.slides.any() else s for s in problem.stacks)
    return replace(problem, stacks=tuple(slides))


def with_unmeasured_spins(problem: Problem) -> Problem:
    """The problem in which each ball in the air whose spin was not measured has an unknown one in each arc."""
    spinning = (replace(s, spin_sigma=SPIN_SIGMA) if s.unmeasured_spin.any() else s for s in problem.stacks)
    return replace(problem, stacks=tuple(spinning))


def inflate_noise(problem: Problem, share: float) -> Problem:
    """The problem with a noise variance that is larger by 1 / share, so that a model's residuals count as noise."""
    weight = share**0.5
    return replace(
        problem,
        stacks=tuple(replace(s, weight=s.weight * weight) for s in problem.stacks),
        polynomials=tuple(replace(p, chi2=p.chi2 * share) for p in problem.polynomials),
        floor=replace(problem.floor, scale=problem.floor.scale / weight, correlation=0.0, smoothing=UNFILTERED),
        noise_inflated=True,
    )
