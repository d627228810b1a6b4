"""The planar scene whose simulated motion follows the tracks: least squares on the bodies' centres in the picture."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from pipeline.errors import SimulationError
from pipeline.motion.image_track import ImageTrack
from pipeline.physics.simulate import compile_xml
from pipeline.planar.parameters import Parameter
from pipeline.planar.plane import Plane
from pipeline.planar.robust_descent import robust_descent
from pipeline.scene.mjcf import STEPS_PER_SECOND, scene_xml
from pipeline.scene.scene import Scene

SYSTEMATIC = 0.02  # radii: errors of outlines that are alike from frame to frame
LEAST_SIGMA = 0.3  # px
LOST_PX = 1e3  # of a body whose simulation became unstable


@dataclass(frozen=True)
class PlanarFit:
    """The fitted scene.

    Attributes:
        scene: The best.
        names: Of the parameters.
        values: Their differences from the start.
        sigma: Their standard errors.
        rms_px: Of the centres, px.
        residual_px: (N,) median distance of each body's centre from its track, px.
        simulations: That the fit took.
    """

    scene: Scene
    names: tuple[str, ...]
    values: np.ndarray
    sigma: np.ndarray
    rms_px: float
    residual_px: np.ndarray
    simulations: int


def fit_planar(scene: Scene, tracks: Sequence[ImageTrack], plane: Plane, parameters: Sequence[Parameter]) -> PlanarFit:
    """Fit the parameters so that the simulated centres follow the tracks.

    Args:
        scene: The start; object i is the body of track i, from time 0 of the tracks on.
        tracks: Times from 0, s.
        plane: In which bodies move.
        parameters: Of `planar_parameters`.
    """
    weights = [
        t.whole[:, None] / np.sqrt(t.sigma**2 + LEAST_SIGMA**2 + (SYSTEMATIC * t.radius) ** 2) for t in tracks
    ]
    steps, prior = np.array([p.step for p in parameters]), np.array([p.prior for p in parameters])

    def changed(x: np.ndarray) -> Scene:
        out = scene
        for value, parameter in zip(x, parameters, strict=True):
            if value:
                out = parameter.change(out, float(value))
        return out

    def residuals(x: np.ndarray) -> np.ndarray:
        off = centre_errors(changed(x), tracks, plane)
        return np.concatenate([(w * e).ravel() for w, e in zip(weights, off, strict=True)])

    found = robust_descent(residuals, steps, prior)
    best = changed(found.x)
    off = centre_errors(best, tracks, plane)
    whole = [np.linalg.norm(e[t.whole], axis=1) for e, t in zip(off, tracks, strict=True)]
    everything = np.concatenate(whole)
    return PlanarFit(
        scene=best,
        names=tuple(p.name for p in parameters),
        values=found.x,
        sigma=found.sigma,
        rms_px=float(np.sqrt((everything**2).mean() / 2)),
        residual_px=np.array([np.median(w) for w in whole]),
        simulations=found.evaluations,
    )


def centre_errors(scene: Scene, tracks: Sequence[ImageTrack], plane: Plane) -> list[np.ndarray]:
    """(T, 2) px of each body: the simulated centre in the picture minus that of the track."""
    last = max(float(t.times[-1]) for t in tracks)
    try:
        path = simulated_centres(scene, last)
    except SimulationError:
        return [np.full((len(t), 2), LOST_PX) for t in tracks]
    out = []
    for i, track in enumerate(tracks):
        step = track.times * STEPS_PER_SECOND
        low = np.minimum(step.astype(int), len(path) - 2)
        share = (step - low)[:, None]
        place = (1 - share) * path[low, i] + share * path[low + 1, i]
        out.append(plane.to_picture(plane.in_plane(place)) - track.centre)
    return out


def simulated_centres(scene: Scene, seconds: float) -> np.ndarray:
    """Positions (S + 1, N, 3) m of the objects at steps of 1/240 s. Raises SimulationError where it is unstable."""
    model = compile_xml(scene_xml(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("initial").id)
    count = int(np.ceil(seconds * STEPS_PER_SECOND)) + 1
    qpos = np.empty((count + 1, model.nq))
    for step in range(count):
        qpos[step] = data.qpos
        mujoco.mj_step(model, data)
    qpos[count] = data.qpos
    if not np.isfinite(qpos).all() or any(w.number for w in data.warning):
        raise SimulationError("the simulation became unstable")
    return qpos.reshape(count + 1, -1, 7)[:, :, :3]
