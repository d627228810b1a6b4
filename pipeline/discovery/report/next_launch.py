"""The most informative next recording: the launch in this scene that best tells the remaining explanations apart.

Each remaining explanation is simulated from each launch. The difference of two explanations is that of their paths,
after the start and the numbers of both have been adjusted within their errors to make it small. From these differences
follows a lower bound on the information about which explanation is right (Kolchinsky and Tracey, "Estimating mixture
entropy with pairwise distances", 2017). The launch with the largest bound is proposed.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.estimates import effect_estimates, estimates_by_body
from pipeline.discovery.fitting.extension import CLAIM
from pipeline.discovery.report.augmented_scene import augmented_scene, first_arc, scene_of
from pipeline.discovery.selection.confidence import TEMPERATURE
from pipeline.discovery.selection.selection import Selection
from pipeline.errors import SimulationError
from pipeline.physics.effect_forces import ApplyForces, effect_forces
from pipeline.physics.simulate import compile_xml, simulate_model
from pipeline.physics.trace import Trace
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.joint import joint_velocity
from pipeline.scene.mjcf import initial_qpos, scene_xml
from pipeline.scene.scene import Scene, SceneObject

LEAST_WEIGHT = 0.02  # of an explanation that is compared
LEAST_BITS = 0.1  # of information, below which no launch is proposed: none tells a wrong ruler from a wrong clock
SURE = 0.9  # confidence from which a verdict needs no further recording
MOST_EXPLANATIONS = 4
SPEEDS, TURNS_DEG = (0.5, 1.0, 2.0), (0.0, 90.0, 180.0, 270.0)  # of the first recording's launch
SAMPLES = 40  # of a path, at which explanations are compared
SAMPLES_PER_SECOND = 60.0  # of a recording
STATES = ("position", "orientation", "velocity", "angular_velocity")  # of a body, that a launch sets


@dataclass(frozen=True)
class NextLaunch:
    """A launch, and what is expected of its recording.

    Attributes:
        scene: The known scene with the likeliest explanation, launched so.
        object: Index of the body that is launched.
        seconds: Of the recording.
        between: The two explanations that it tells apart best, in words.
        apart: m, the largest distance between their paths, once the start is adjusted.
        information: bits, a lower bound on what the recording tells about which explanation is right.
    """

    scene: Scene
    object: int
    seconds: float
    between: tuple[str, str]
    apart: float
    information: float

    @property
    def body(self) -> SceneObject:
        """The body that is launched, with its place and velocities."""
        return self.scene.objects[self.object]

    @property
    def sentence(self) -> str:
        """What to do, and what it tells."""
        b = self.body
        at, speed = ", ".join(f"{v:.3g}" for v in b.position), float(np.linalg.norm(b.velocity))
        way = ", ".join(f"{v:.3g}" for v in b.velocity)
        spin = f", spin ({', '.join(f'{v:.3g}' for v in b.angular_velocity)}) rad/s" if any(b.angular_velocity) else ""
        how = f"with {speed:.3g} m/s, ({way}) m/s{spin}" if speed else f"at rest{spin}"
        one, other = self.between
        return (
            f"launch {b.name} from ({at}) m {how}, and record {self.seconds:.2g} s: {one} and {other} then differ by "
            f"{1e3 * self.apart:.3g} mm"
        )

    def as_dict(self) -> dict[str, Any]:
        """For a report."""
        b = self.body
        return {
            "object": b.name,
            "position": list(b.position),
            "velocity": list(b.velocity),
            "angular_velocity": list(b.angular_velocity),
            "seconds": self.seconds,
            "between": list(self.between),
            "apart_m": self.apart,
            "information_bits": self.information,
        }


@dataclass(frozen=True)
class _Simulated:
    """A scene that is compiled once for all launches."""

    scene: Scene
    model: mujoco.MjModel
    forces: ApplyForces | None

    def trace(self, bodies: Sequence[SceneObject], seconds: float) -> Trace:
        """Its motion from the initial states of bodies."""
        objects = _as_launched(self.scene.objects, bodies)
        self.model.key_qpos[0] = initial_qpos(objects)
        scene = replace(self.scene, objects=objects)
        self.model.key_qvel[0] = np.concatenate([joint_velocity(scene, o) for o in objects])
        return simulate_model(self.model, seconds, self.forces)


def next_launch(found: Selection, confidence: float) -> NextLaunch | None:
    """The most informative launch; None where the verdict is sure, or no launch tells explanations apart.

    Args:
        found: The models.
        confidence: Of the verdict.
    """
    if found.unknown or (confidence > SURE and not found.alike):
        return None
    models, weights = explanations(found, confidence)
    if len(models) < 2:
        return None
    scenes = [[scene, *_varied(scene, m)] for m in models for scene in [scene_of(found, m)]]
    own = [[_Simulated(s, compile_xml(scene_xml(s)), effect_forces(s)) for s in of] for of in scenes]
    seconds = _seconds(found)
    sigma = found.measured.sigma / max(found.measured.floor.information, 1e-3) ** 0.5
    best: NextLaunch | None = None
    for index, bodies in launches(found):
        try:
            apart, chi2 = _differences(own, models, bodies, index, seconds, sigma)
        except SimulationError:  # a launch that cannot be simulated cannot be proposed
            continue
        bits = information(weights, chi2)
        if best is None or bits > best.information:
            separation = np.outer(weights, weights) * (1 - np.exp(-chi2 / 8))
            i, j = np.unravel_index(int(separation.argmax()), chi2.shape)
            launched = replace(scenes[0][0], objects=_as_launched(scenes[0][0].objects, bodies))
            pair = (_name(models[i]), _name(models[j]))
            best = NextLaunch(launched, index, seconds, pair, float(apart[i, j]), bits)
    return best if best is not None and best.information >= LEAST_BITS else None


def explanations(found: Selection, confidence: float) -> tuple[list[Candidate], np.ndarray]:
    """The verdict's model and its likeliest rivals, and the probability of each.

    Models that are not told apart from the verdict's share its confidence; the others share the rest.
    """
    own = found.chosen
    pool = {frozenset(c.effects): c for c in (*found.tried, *found.singles, found.none) if c.effects != own.effects}
    rivals = [
        c for c in pool.values() if not set(c.effects) & set(found.ruled_out) and not set(c.effects) > set(own.effects)
    ]
    rivals = sorted(rivals, key=_score)[: MOST_EXPLANATIONS - 1]
    models = [own, *rivals]
    score, weight = np.array([_score(c) for c in models]), np.zeros(len(models))
    equal = {n for group in found.alike for n in group} | set(own.effects)
    known = np.array([set(c.effects) <= equal and bool(c.effects) == bool(own.effects) for c in models])
    for group, share in ((known, confidence), (~known, 1 - confidence)):
        if group.any():
            weight[group] = np.exp(-(score[group] - score[group].min()) / 2 / TEMPERATURE)
            weight[group] *= share / weight[group].sum()
    kept = np.flatnonzero(weight >= LEAST_WEIGHT)
    return [models[k] for k in kept], weight[kept] / weight[kept].sum()


def _score(model: Candidate) -> float:
    return model.score - (0.0 if model.effects else CLAIM)


def launches(found: Selection) -> list[tuple[int, tuple[SceneObject, ...]]]:
    """What may be tried: the index of the body that is launched otherwise, and the bodies with their initial states.

    Bodies begin where they began in the first recording, at half, once and twice its speed, in four directions; at
    rest; straight up, where they fly; and with the spin reversed, where spins were measured.
    """
    start = augmented_scene(found).objects
    spins = any(a.spin is not None for a in found.problem.arcs)
    out = []
    for index, body in enumerate(start):
        first = first_arc(found.problem, index)
        velocity, speed = np.array(body.velocity), float(np.linalg.norm(body.velocity))
        if first is None or not speed:
            continue
        turns = [Rotation.from_euler("z", t, degrees=True).apply(velocity) for t in TURNS_DEG]
        ways = [s * w for s in SPEEDS for w in turns] + [np.zeros(3)]
        if not first[1].grounded:
            ways.append(np.array([0.0, 0.0, speed]))
        tried = [replace(body, velocity=tuple(w)) for w in ways]
        if spins and any(body.angular_velocity):
            tried.append(replace(body, angular_velocity=tuple(-w for w in body.angular_velocity)))
        out += [(index, (*start[:index], b, *start[index + 1 :])) for b in tried]
    return out


def information(weights: np.ndarray, chi2: np.ndarray) -> float:
    """bits: a lower bound on what a recording tells about which of N explanations is right.

    Args:
        weights: (N,) their probabilities.
        chi2: (N, N) squared differences of what they predict, in units of the noise.
    """
    return float(-(weights * np.log2(np.exp(-chi2 / 8) @ weights)).sum())


def _varied(scene: Scene, model: Candidate) -> list[Scene]:
    """The scene with each number of a model's effects larger by its standard error."""
    names, out = [o.name for o in scene.objects], []
    for k, effect in enumerate(scene.effects):
        if effect.name not in model.effects:
            continue
        estimates = estimates_by_body(model, effect.name)[names.index(effect.objects[0]) if effect.objects else None]
        for key, e in estimates.items():
            if isinstance(e.value, str) or e.stderr is None:
                continue
            value, error = np.atleast_1d(np.asarray(e.value, float)), np.atleast_1d(np.asarray(e.stderr, float))
            for step in np.diag(error):
                moved = (value + step).tolist()
                values = effect.values | {key: tuple(moved) if isinstance(e.value, list) else moved[0]}
                changed = replace(effect, parameters=tuple(values.items()))
                out.append(replace(scene, effects=(*scene.effects[:k], changed, *scene.effects[k + 1 :])))
    return out


def _differences(
    scenes: Sequence[Sequence[_Simulated]],
    models: Sequence[Candidate],
    bodies: Sequence[SceneObject],
    index: int,
    seconds: float,
    sigma: float,
) -> tuple[np.ndarray, np.ndarray]:
    """By how much explanations differ.

    Args:
        scenes: Of each explanation, with its numbers, and with each of them larger by its error.
        models: The explanations.
        bodies: As launched.
        index: Of the body that is compared.
        seconds: Of the recording.
        sigma: m, of a coordinate.

    Returns:
        (N, N) m: the largest difference of the paths of two explanations; and chi squared of what their errors leave.
    """
    traces = [[s.trace(bodies, seconds) for s in own] for own in scenes]
    stop = min(_first_touch(t, index) for own in traces for t in own)
    time = np.linspace(0, stop, SAMPLES) / traces[0][0].rate
    start = np.linalg.qr(np.stack([np.ones(SAMPLES), time - time.mean()], 1))[0]  # another place and velocity

    def beyond_start(path: np.ndarray) -> np.ndarray:
        return np.asarray(path - start @ (start.T @ path)).ravel()

    paths = [[beyond_start(_recorded(t, m, index, time)) for t in own] for own, m in zip(traces, models, strict=True)]
    per_sample = stop / traces[0][0].rate * SAMPLES_PER_SECOND / SAMPLES
    apart, chi2 = np.zeros((2, len(models), len(models)))
    for i, j in itertools.combinations(range(len(models)), 2):
        off = paths[i][0] - paths[j][0]
        errors = np.stack([p - own[0] for own in (paths[i], paths[j]) for p in own[1:]] or [0 * off])
        errors, scaled = errors * (per_sample**0.5 / sigma), off * (per_sample**0.5 / sigma)
        along = errors @ scaled
        left = scaled @ scaled - along @ np.linalg.solve(np.eye(len(errors)) + errors @ errors.T, along)
        apart[i, j] = apart[j, i] = np.linalg.norm(off.reshape(SAMPLES, 3), axis=1).max()
        chi2[i, j] = chi2[j, i] = left
    return apart, chi2


def _first_touch(trace: Trace, index: int) -> int:
    """The step up to which a body that begins in the air touches nothing; the last one of others."""
    touches = trace.contacts.step[(trace.contacts.first == index) | (trace.contacts.second == index)]
    last = len(trace.position) - 1
    return int(touches[0]) if len(touches) and touches[0] > 2 else last


def _recorded(trace: Trace, model: Candidate, index: int, time: np.ndarray) -> np.ndarray:
    """(T, 3) m of a body at times (T,) s, as a recording has them by a model: some effects are of the recording."""
    shown, path = np.arange(len(trace.position)) / trace.rate, trace.position[:, index]
    for name in model.effects:
        recording = effect_kinds()[name].recording
        if recording is not None:
            values = {k: np.array(e.value, float) for k, e in effect_estimates(model, name).items()}
            shown, path = recording(values, shown, path)
    return np.stack([np.interp(time, shown, path[:, k]) for k in range(3)], -1)


def _as_launched(objects: Sequence[SceneObject], bodies: Sequence[SceneObject]) -> tuple[SceneObject, ...]:
    """The objects with the initial states of bodies."""
    return tuple(replace(o, **{key: getattr(b, key) for key in STATES}) for o, b in zip(objects, bodies, strict=True))


def _seconds(found: Selection) -> float:
    """Median length of the recordings, s."""
    spans = []
    for clip in found.problem.clips:
        times = np.concatenate([a.time[[0, -1]] for a in found.problem.arcs if a.clip == clip] or [np.zeros(1)])
        spans.append(float(np.ptp(times)))
    return float(np.median([s for s in spans if s] or [1.0]))


def _name(model: Candidate) -> str:
    return " with ".join(model.effects) or "nothing missing"
