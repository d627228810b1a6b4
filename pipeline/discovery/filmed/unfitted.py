"""How well the scene before and after a discovery forecasts frames that were not fitted, in the picture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.clips.overlap import count, pair_iou, sequence_iou
from pipeline.discovery.filmed.measured_motion import MeasuredMotion
from pipeline.discovery.filmed.recorded_clip import RecordedClip
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.other_split import hold_out_instead
from pipeline.discovery.report.augmented_scene import scene_of
from pipeline.discovery.selection.forecast import SEEN
from pipeline.discovery.selection.selection import Selection
from pipeline.errors import SimulationError
from pipeline.physics.simulate import simulate
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import Scene
from pipeline.vision.flow.dis import DIS
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import rasterise

LEAST_FRAMES = 3  # of a clip that are forecast
LEAST_ERROR = 0.01  # of a clip's mean IoU: frames in which bodies rest have the same error, that of their masks


@dataclass(frozen=True)
class ForecastClip:
    """A clip of which a scene that was fitted to others forecasts the rest.

    Attributes:
        clip: With the masks of the scene's objects.
        first: Index of the first frame that was not fitted: the frames before told the initial state.
        scene: With the camera and the initial state.
        position: (T, N, 3) m of the objects, as forecast at the clip's times.
        quaternion: (T, N, 4) of the objects.
        shown: (T, H, W) uint8, masks of the forecast.
        frame_iou: (F,) mean IoU of the bodies in each frame from `first` on, NaN where none is seen or forecast.
        iou: Sequence IoU of these frames.
    """

    clip: RecordedClip
    first: int
    scene: Scene
    position: np.ndarray
    quaternion: np.ndarray
    shown: np.ndarray
    frame_iou: np.ndarray
    iou: float

    @cached_property
    def epe(self) -> float:
        """px, mean length of the difference to the flow measured in the clip, over pixels of bodies."""
        rest, scene, frames = slice(self.first, None), self.scene, self.clip.frames[self.first :]
        assert scene.camera is not None
        eye, (width, height) = pinhole(scene.camera), self.clip.size
        flow = exact_flow(scene.objects, self.position[rest], self.quaternion[rest], eye, width, height, scene.ground)
        bodies = ((self.shown > 0) | (self.clip.masks > 0))[rest][:-1]
        off = np.linalg.norm(flow - DIS().flow(frames[:-1], frames[1:]), axis=-1)
        return float(off[bodies].mean()) if bodies.any() else 0.0


@dataclass(frozen=True)
class Unfitted:
    """before, after: forecasts of the same clips, without and with what was named; empty where none can be forecast."""

    before: tuple[ForecastClip, ...]
    after: tuple[ForecastClip, ...]

    @property
    def rise(self) -> tuple[float, float]:
        """By how much IoU rises with what was named, and the standard error; both 0 where nothing is forecast.

        Neighbouring frames err alike, so that by their autocorrelation fewer count, and each clip errs by LEAST_ERROR.
        """
        means, squares = [], []
        for before, after in zip(self.before, self.after, strict=True):
            count_ = min(len(before.frame_iou), len(after.frame_iou))
            change = after.frame_iou[-count_:] - before.frame_iou[-count_:]
            change = change[np.isfinite(change)]
            if len(change) >= LEAST_FRAMES:
                means.append(float(change.mean()))
                squares.append(float(change.var() / _independent(change)) + LEAST_ERROR**2)
        if not means:
            return 0.0, 0.0
        return float(np.mean(means)), float(np.sqrt(np.sum(squares)) / len(means))

    def as_dict(self) -> dict[str, float | None]:
        """As in `gap` of report.json."""
        out: dict[str, float | None] = {}
        for name, forecasts in (("before", self.before), ("after", self.after)):
            out[f"sequence_iou_{name}"] = float(np.mean([f.iou for f in forecasts])) if forecasts else None
            out[f"epe_px_{name}"] = float(np.mean([f.epe for f in forecasts])) if forecasts else None
        return out


def _independent(values: np.ndarray) -> float:
    """How many independent values (F,) amount to, by their lag-one autocorrelation; at least 1."""
    off = values - values.mean()
    squares = float(off @ off)
    alike = float(np.clip(off[1:] @ off[:-1] / squares, 0.0, 1.0)) if squares > 0 else 0.0
    return max(len(values) * (1 - alike) / (1 + alike), 1.0)


def forecast_unfitted(found: Selection, motion: MeasuredMotion, before: Candidate | None = None) -> Unfitted:
    """Forecast each clip without and with the effects that were named, by models that were fitted to the other clips.

    Each clip's initial state is fitted to the first part of its first arc; the frames after that are forecast through
    all bounces by MuJoCo. A clip that one of the two scenes cannot forecast is left out of both. Where the selection
    held no clip out, the models are its own.

    Args:
        found: The selection of the effects.
        motion: What it was made from.
        before: The model to compare with; None: the one without effects.
    """
    models: tuple[Candidate, ...] = (before or found.none, found.answer)
    pairs = []
    for clip in motion.clips:
        selection, fitted = found, models
        if found.problem.held_out and found.problem.held_out != (clip.name,):
            again = hold_out_instead(found.calibration, models, clip.name)
            if again is None:
                continue
            selection, fitted = replace(found, calibration=again[0]), again[1]
        both = [_forecast(selection, model, motion, clip) for model in fitted]
        if both[0] is not None and both[1] is not None:
            pairs.append((both[0], both[1]))
    return Unfitted(tuple(p[0] for p in pairs), tuple(p[1] for p in pairs))


def _forecast(found: Selection, model: Candidate, motion: MeasuredMotion, clip: RecordedClip) -> ForecastClip | None:
    starts = _first_states(model, clip.name)
    scene = scene_of(found, model)
    if len(starts) < len(scene.objects):
        return None
    begin = max(time for time, _, _ in starts.values())
    last = max(until for _, until, _ in starts.values())
    first = int(np.searchsorted(clip.times, last, side="right"))
    if len(clip.times) - first < LEAST_FRAMES or any(abs(time - begin) > 1e-6 for time, _, _ in starts.values()):
        return None
    objects = []
    for number, obj in enumerate(scene.objects):
        state = starts[number][2]
        objects.append(
            replace(
                obj,
                position=tuple(map(float, state[:3])),
                velocity=tuple(map(float, state[3:6])),
                angular_velocity=tuple(map(float, state[6:9])),
            )
        )
    fit = model.fit
    camera = motion.camera.moved(fit.theta[fit.model.camera_columns]) if fit.model.camera_columns else motion.camera
    scene = replace(scene, objects=tuple(objects), camera=camera.camera)
    clock, length = _recorded_over_true(scene)
    times = np.maximum(clip.times - begin, 0.0) / clock
    try:
        trace = simulate(scene, float(times[-1]) + 2 / 240)
    except SimulationError:
        return None
    steps = np.minimum(np.rint(times * trace.rate).astype(int), len(trace.position) - 1)
    position, quaternion = trace.position[steps] * length, trace.quaternion[steps]
    eye, (width, height) = pinhole(camera.camera), clip.size
    shown = rasterise(scene.objects, position, quaternion, eye, width, height, scene.ground, ())
    count_ = len(scene.objects)
    counts = count(shown.mask[first:], clip.masks[first:], count_, count_)
    pairs = np.stack([np.arange(count_)] * 2, 1)
    each = pair_iou(counts)[:, pairs[:, 0], pairs[:, 1]]  # (F, N)
    seen = ~np.isnan(each)
    frame_iou = np.where(seen.any(1), np.where(seen, each, 0).sum(1) / np.maximum(seen.sum(1), 1), np.nan)
    iou = float(sequence_iou(counts, pairs))
    return ForecastClip(clip, first, scene, position, quaternion, shown.mask, frame_iou, iou)


def _recorded_over_true(scene: Scene) -> tuple[float, float]:
    """Recorded over true times, and lengths, by the scene's effects that change recordings."""
    time, length = np.ones(1), np.ones(1)
    for effect in scene.effects:
        kind = effect_kinds()[effect.name]
        if kind.recording is not None:
            values = {name: np.array(value, float) for name, value in effect.parameters}
            time, length = kind.recording(values, time, length)
    return float(time[0]), float(length[0])


def _first_states(model: Candidate, clip: str) -> Mapping[int, tuple[float, float, np.ndarray]]:
    """For each object of a clip: begin of its first arc, s; until when that was fitted, s; the state (10,) there."""
    out: dict[int, tuple[float, float, np.ndarray]] = {}
    problem = model.problem
    for stack, start in zip(problem.stacks, model.fit.starts, strict=True):
        late = stack.time > SEEN * stack.duration[:, None]
        early = replace(stack, weight=np.where(late[..., None], 0.0, stack.weight))
        states, _ = fit_initial_states(early, model.fit.model, model.fit.theta, start)
        for i, index in enumerate(stack.index):
            arc = problem.arcs[index]
            if arc.clip == clip and (arc.object not in out or arc.time[0] < out[arc.object][0]):
                until = float(stack.start[i] + SEEN * stack.duration[i])
                out[arc.object] = float(arc.time[0]), until, states[i]
    return out
