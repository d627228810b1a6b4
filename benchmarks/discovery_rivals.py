"""Other methods on the same tracks: MuJoCo's identification of parameters alone, PySINDy, and an oracle.

PySINDy gets the raw and the segmented tracks. The oracle knows the name of the effect.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from benchmarks.discovery_sysid import sysid_gap
from pipeline.discovery.fitting.calibration import calibrate
from pipeline.discovery.selection.gap import measure_gap
from pipeline.discovery.selection.select_effects import select_once
from pipeline.discovery.selection.testable import names_of
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.problem import Problem, build_problem
from pipeline.discovery.tracks.track import Track

TERMS = {
    "v": "linear_drag",
    "|v|v": "air_drag",
    "wxv": "magnus_lift",
    "ex": "tilted_gravity",
    "ey": "tilted_gravity",
    "ez": "gravity_error",
}
THRESHOLD = 0.05  # of PySINDy's thresholded least squares, m/s² at typical speeds


def rivals(tracks: Sequence[Track], known: KnownScene, truth: tuple[str, ...], sysid: bool) -> dict[str, Any]:
    """Gaps in m, and the effects that PySINDy's terms stand for.

    Args:
        tracks: Of a world.
        known: Its known scene.
        truth: The hidden effects.
        sysid: Whether to run MuJoCo's identification, too, on worlds with one object (minutes for twelve clips).
    """
    out: dict[str, Any] = {}
    problem = build_problem(tracks, known, 0.3, np.random.default_rng(0))
    if len(truth) == 1 and truth[0] in names_of("all"):
        found = select_once(calibrate(problem), truth)
        gap = measure_gap(found.problem, found.none, found.chosen)
        out["oracle"] = {
            "before": gap.before,
            "after": gap.after,
            "floor": gap.noise_floor,
            "claimed": bool(found.chosen.effects),
        }
    if sysid and len(known.scene.objects) == 1:
        began = perf_counter()
        out["sysid"] = {"after": sysid_gap(problem, tracks, known), "seconds": perf_counter() - began}
    for name, segments in (("pysindy_raw", _raw(tracks)), ("pysindy_segmented", _segmented(problem))):
        out[name] = sindy_names(segments, known)
    return out


def _raw(tracks: Sequence[Track]) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    out = []
    for t in tracks:
        there = np.isfinite(t.position).all(1)
        spin = np.zeros((there.sum(), 3)) if t.angular_velocity is None else t.angular_velocity[there]
        out.append((t.time[there], t.position[there], spin))
    return out


def _segmented(problem: Problem) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
    return [
        (a.time, a.position, np.zeros((len(a.time), 3)) if a.spin is None else a.spin)
        for a in problem.arcs
        if not a.grounded
    ]


def sindy_names(segments: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], known: KnownScene) -> list[str]:
    """The effects whose terms PySINDy keeps, from a library that has the right seven terms."""
    import pysindy

    features, targets = [], []
    for time, x, spin in segments:
        if len(time) < 9:
            continue
        smooth = pysindy.SmoothedFiniteDifference(smoother_kws={"window_length": 7, "polyorder": 3})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            v = smooth._differentiate(x, time)
            a = smooth._differentiate(v, time)
        speed = np.linalg.norm(v, axis=1, keepdims=True)
        columns = [v, speed * v, np.cross(spin, v), *(np.tile(np.eye(3)[i], (len(v), 1)) for i in range(3))]
        features.append(np.stack([c[2:-2].ravel() for c in columns], 1))
        targets.append((a - np.array(known.scene.gravity))[2:-2].ravel())
    if not features:
        return []
    design, target = np.concatenate(features), np.concatenate(targets)
    size = np.sqrt((design**2).mean(0))
    usable = size > 1e-9
    optimizer = pysindy.STLSQ(threshold=THRESHOLD, alpha=1e-6)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        optimizer.fit(design[:, usable] / size[usable], target[:, None])
    kept = np.abs(optimizer.coef_[0]) > 1e-12
    return sorted({TERMS[n] for n, k in zip(np.array(list(TERMS))[usable], kept, strict=True) if k})
