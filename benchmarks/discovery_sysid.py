"""MuJoCo's own system identification on the same tracks: the gap that is left with parameters alone.

`mujoco.sysid.optimize` (the extra `mujoco[sysid]`) fits initial states of every clip and the scene's free contact
numbers to rollouts of whole clips, impacts included, from straight-line starts; then, with these numbers, the initial
states of the held-out clips.
"""

from __future__ import annotations

import io
import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.tracks.stack import ArcStack
from pipeline.discovery.tracks.track import Track
from pipeline.errors import SimulationError
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene

NUMBERS = {"sliding_friction": (0.5, 0.0, 2.0), "rolling_friction": (1e-4, 0.0, 0.05), "damping": (0.5, 0.02, 2.0)}
"""Contact number -> where the fit begins, and its bounds."""
STATE_LOW, STATE_HIGH = np.array([-50.0] * 6 + [-300.0] * 3), np.array([50.0] * 6 + [300.0] * 3)
ITERATIONS = 20
STEP = 1e-4  # of finite differences: a scene's text has no more digits
FAR = 1.0  # m: residual of a simulation that fails


def sysid_gap(problem: Problem, tracks: Sequence[Track], known: KnownScene) -> float:
    """Root mean square residual of the held-out clips of a world with one object, m.

    It is of the samples in arcs, with the degrees of freedom of the initial states subtracted as in our gap. Raises
    ImportError where the extra is not installed.
    """
    from mujoco import sysid

    if not hasattr(sysid, "optimize"):  # without the extra it imports, and is empty
        raise ImportError("mujoco.sysid is empty: install the extra `benchmark`")
    logging.getLogger().setLevel(logging.ERROR)
    free = [k for k in NUMBERS if k in known.fit]
    by_clip = {t.clip: t for t in tracks}
    used = {c: _used(problem, by_clip[c]) for c in by_clip}

    def fitted(clips: Sequence[str], numbers: np.ndarray | None) -> tuple[np.ndarray, list[np.ndarray]]:
        """Contact numbers, and residuals (n, 3) m of each clip. numbers: known contact numbers; None: fit them."""
        clips = [c for c in clips if len(used[c])]
        begin = {c: _start(by_clip[c], used[c], known.of_clip(c)) for c in clips}
        parameters = sysid.ParameterDict()
        for clip, state in begin.items():
            parameters.add(sysid.Parameter(clip, state, STATE_LOW[: len(state)], STATE_HIGH[: len(state)]))
        if numbers is None:
            for key in free:
                parameters.add(sysid.Parameter(key, *NUMBERS[key]))

        def residuals(x: np.ndarray, _: object) -> tuple[list[np.ndarray], None, None]:
            columns = np.atleast_2d(x.T).T if x.ndim == 1 else x  # (parameters, candidates)
            rows = [_rows(column) for column in columns.T]
            return [np.array(rows).T if x.ndim == 2 else rows[0]], None, None

        def _rows(x: np.ndarray) -> np.ndarray:
            shared = x[sum(map(len, begin.values())) :] if numbers is None else numbers
            place, out = 0, []
            for clip, state in begin.items():
                own = x[place : place + len(state)]
                place += len(state)
                out.append(left(clip, own.tobytes(), np.ascontiguousarray(shared).tobytes()).ravel())
            return np.concatenate(out)

        found, _ = sysid.optimize(
            parameters,
            residuals,
            optimizer="mujoco",
            verbose=False,
            max_iters=ITERATIONS,
            eps=STEP,
            output=io.StringIO(),
        )
        x = found.as_vector()
        shared = x[len(x) - len(free) :] if numbers is None else numbers
        end = _rows(x)
        sizes = np.cumsum([3 * len(used[c]) for c in clips])[:-1]
        return shared, [r.reshape(-1, 3) for r in np.split(end, sizes)]

    @lru_cache(maxsize=4096)
    def left(clip: str, own: bytes, shared: bytes) -> np.ndarray:
        numbers = dict(zip(free, np.frombuffer(shared), strict=True))
        return _left(by_clip[clip], used[clip], known.of_clip(clip), np.frombuffer(own), numbers)

    numbers, rest = fitted(problem.fitted, None)
    if problem.held_out:
        _, rest = fitted(problem.held_out, numbers)
    squares, count = sum(float((r**2).sum()) for r in rest), sum(r.size - 6 for r in rest)
    return float(np.sqrt(squares / max(count, 1)))


def _used(problem: Problem, track: Track) -> np.ndarray:
    """The rows of a track that our arcs use, without outliers."""
    rows = [np.zeros(0, int)]
    for stack in problem.stacks:
        for i in range(len(stack)):
            arc = problem.arcs[stack.index[i]]
            if arc.clip == track.clip:
                rows.append(arc.row[_there(stack, i)[: len(arc.row)]])
    return np.sort(np.concatenate(rows))


def _there(stack: ArcStack, i: int) -> np.ndarray:
    there: np.ndarray = stack.weight[i].max(1) > 0
    return there


def _start(track: Track, used: np.ndarray, scene: Scene) -> np.ndarray:
    """Position and velocity at a track's first row, and the spin where it was not measured."""
    first = used[:10]
    t, x = track.time[first] - track.time[0], track.position[first]
    fall = 0.5 * np.array(scene.gravity) * (t * t)[:, None]
    if x[:, 2].max() < 3 * scene.objects[0].size[-1]:  # on the ground
        fall = 0 * fall
    beta, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(t), t]), x - fall, rcond=None)
    state = np.concatenate([beta[0], beta[1]])
    if track.angular_velocity is not None:
        return state
    radius = scene.objects[0].size[0]
    rolls = scene.objects[0].shape == "sphere"
    return np.concatenate([state, [-state[4] / radius, state[3] / radius, 0.0] if rolls else np.zeros(3)])


def _left(track: Track, used: np.ndarray, scene: Scene, state: np.ndarray, numbers: dict[str, float]) -> np.ndarray:
    """Measured minus simulated positions at the rows used, (n, 3) m."""
    spin = state[6:] if len(state) > 6 else np.nanmean(track.angular_velocity[:3], axis=0)  # type: ignore[index]
    body = replace(
        scene.objects[0], position=tuple(state[:3]), velocity=tuple(state[3:6]), angular_velocity=tuple(spin)
    )
    body = replace(body, **numbers)  # type: ignore[arg-type]
    if track.quaternion is not None:
        body = replace(body, orientation=tuple(track.quaternion[0]))
    times = track.time[used] - track.time[0]
    try:
        trace = simulate(replace(scene, objects=(body,)), float(times[-1]) + 2 / 240)
    except SimulationError:
        return np.full((len(used), 3), FAR)
    shown = np.stack([np.interp(times, trace.times, c) for c in trace.position[:, 0].T], 1)
    return np.clip(track.position[used] - shown, -FAR, FAR)
