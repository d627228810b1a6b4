"""The planar scene whose simulated motion follows the tracks: least squares on the bodies' centres in the picture."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.physics.batch import BatchSimulator, fixed_kinds, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.worlds.parameters import Parameter, changed
from pipeline.worlds.plane import Plane
from pipeline.worlds.robust_descent import DAMPINGS, POPULATION, Residuals, robust_descent
from pipeline.worlds.tilt import LEAST_SIGMA, SYSTEMATIC

AFTER = 0.35  # of the time to the next impact, up to which the fit looks after one
LEAST_PART = 0.1  # of the tracks' time, that a first fit needs
MOST_CMA_S = 2000.0  # that CMA-ES simulates at most, so that long clips do not take minutes
LOST_PX = 1e3  # of a body whose simulation became unstable


@dataclass(frozen=True)
class PlanarFit:
    """The fitted scene.

    Attributes:
        scene: The best.
        rms_px: Of the centres, px.
        simulations: That the fit took.
    """

    scene: Scene
    rms_px: float
    simulations: int


def fit_planar(
    scene: Scene,
    tracks: Sequence[ImageTrack],
    plane: Plane,
    parameters: Sequence[Parameter],
    impacts: Sequence[float] = (),
    threads: int = 1,
    quick: bool = False,
) -> PlanarFit:
    """Fit the parameters so that the simulated centres follow the tracks.

    Args:
        scene: The start; object i is the body of track i, from time 0 of the tracks on.
        tracks: Times from 0, s.
        plane: In which bodies move.
        parameters: Of `planar_parameters`.
        impacts: Times, s, at which velocities jump: a fit goes beyond one when it follows the tracks up to it.
        threads: For simulations.
        quick: Descents alone, without CMA-ES.
    """
    size = max(len(parameters), len(DAMPINGS), POPULATION)
    simulator = BatchSimulator(scene.shapes, scene.ground is not None, size, threads, fixed_kinds(scene))
    weights = [t.whole[:, None] / np.sqrt(t.sigma**2 + LEAST_SIGMA**2 + (SYSTEMATIC * t.radius) ** 2) for t in tracks]

    def residuals(end: float) -> Residuals:
        """Those of the tracks up to a time, s; only so much is simulated."""
        which = [t.times <= end for t in tracks]
        begun = [i for i, seen in enumerate(which) if seen.any()]
        first = {i: tracks[i].part(which[i]) for i in begun}

        def of(x: np.ndarray) -> np.ndarray:
            off = centre_errors(simulator, [changed(scene, parameters, row) for row in x], first, plane)
            return np.concatenate([(weights[i][which[i]] * off[i]).reshape(len(x), -1) for i in begun], 1)

        return of

    steps, prior = np.array([p.step for p in parameters]), np.array([p.prior for p in parameters])
    end = max(float(t.times[-1]) for t in tracks)
    parts = [residuals(until) for until in first_ends(impacts, end)]
    jumps = len(tracks) > 1 or bool(impacts)
    cma_evaluations = int(MOST_CMA_S / end) if jumps and not quick else 0
    found = robust_descent(residuals(end), steps, prior, parts=parts, cma_evaluations=cma_evaluations)
    best = changed(scene, parameters, found.x)
    off = centre_errors(simulator, [best], dict(enumerate(tracks)), plane)
    whole = [np.linalg.norm(off[i][0][t.whole, :2], axis=1) for i, t in enumerate(tracks)]
    return PlanarFit(
        scene=best,
        rms_px=float(np.sqrt((np.concatenate(whole) ** 2).mean() / 2)),
        simulations=found.evaluations,
    )


def first_ends(impacts: Sequence[float], end: float) -> list[float]:
    """Times, s, up to which a fit counts first: each impact, and a while after it. end: s, of the tracks."""
    ends: list[float] = []
    for now, after in itertools.pairwise([*sorted(impacts), end]):
        ends += [now, now + AFTER * (after - now)]
    return [e for k, e in enumerate(ends) if LEAST_PART * end < e < end and e not in ends[:k]]


def centre_errors(
    simulator: BatchSimulator, scenes: list[Scene], tracks: Mapping[int, ImageTrack], plane: Plane
) -> dict[int, np.ndarray]:
    """(B, T, 2 or 3) px of each object that has a track: its simulated centre in the picture minus that of its track.

    Seen from above, a body that rises would grow, or show its side: the third is how far it rises.
    """
    last = max(int(np.ceil(t.times[-1] * STEPS_PER_SECOND)) for t in tracks.values()) + 1
    states = simulator.run(stack_scenes(scenes), np.arange(last + 1))
    out = {}
    for i, track in tracks.items():
        step = track.times * STEPS_PER_SECOND
        low = step.astype(int)
        share = (step - low)[:, None]
        place = (1 - share) * states.position[:, low, i] + share * states.position[:, low + 1, i]
        off = plane.to_picture(plane.in_plane(place)) - track.centre
        if plane.level:
            rise = plane.px_per_m * (place[..., 2:] - states.position[:, :1, i, 2:])
            off = np.concatenate([off, rise], -1)
        off[~states.valid] = LOST_PX
        out[i] = off
    return out
