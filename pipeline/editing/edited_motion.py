"""The motion of a clip's scene, and that of the edited scene, which is run on from the clip's state at each edit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import groupby

import numpy as np

from pipeline.editing.edit_list import Colour, Edit, added_object
from pipeline.editing.view import BodyMotion
from pipeline.errors import SceneError, did_you_mean
from pipeline.physics.overlap import ground_penetration, overlaps
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import FIRST_FIXED, Trace
from pipeline.scene.edited import edited
from pipeline.scene.joint import joints_after
from pipeline.scene.scene import Scene, SceneObject, half_extents
from pipeline.scene.text import scene_from_dict, write_scene
from pipeline.scene.time_step import STEPS_PER_SECOND, frame_steps
from pipeline.untrusted import parse_yaml

SOLID = 0.05  # of the smaller body's least half extent: bodies that an edit makes overlap by more cannot be so


@dataclass(frozen=True)
class EditedMotion:
    """An edited clip's motion.

    Attributes:
        motion: T frames, M bodies: every body that there ever is.
        origin: (M,) which object of the clip's scene each of them is; None for one that was added.
        scene: The scene after the last edit, with its state at that time.
        time: When that is, s.
        first: First frame that an edit concerns.
        colours: Colours of added bodies, RGB from 0 to 255, by name, as far as the edits say.
    """

    motion: BodyMotion
    origin: tuple[int | None, ...]
    scene: Scene
    time: float
    first: int
    colours: Mapping[str, Colour] = field(default_factory=dict)

    @property
    def colour_of(self) -> tuple[Colour | None, ...]:
        """(M,) the colours of new bodies, where they are known."""
        known = zip(self.motion.objects, self.origin, strict=True)
        return tuple(self.colours.get(o.name) if origin is None else None for o, origin in known)


def filmed_motion(scene: Scene, times: np.ndarray) -> tuple[BodyMotion, Trace]:
    """The motion of a scene at the frames of a clip, filmed at times (T,), s. Raises SimulationError where it becomes
    unstable."""
    steps = frame_steps(times)
    trace = simulate(scene, (steps[-1] + 1) / STEPS_PER_SECOND)
    shown = np.ones((len(steps), len(scene.objects)), bool)
    return BodyMotion(scene.objects, trace.position[steps], trace.quaternion[steps], shown), trace


@dataclass(frozen=True)
class Run:
    """A scene that is run from one edit to the next.

    Attributes:
        step: Simulation step of the whole motion at which it begins.
        scene: The scene, with its state then.
        trace: Its motion to the end of the whole motion; the next run goes on from a state within it.
    """

    step: int
    scene: Scene
    trace: Trace


def edited_runs(scene: Scene, trace: Trace, edits: Sequence[Edit]) -> tuple[tuple[Run, ...], dict[str, int]]:
    """Run a scene on from each of its edits.

    Args:
        scene: Without the edits.
        trace: Its motion.
        edits: By time, from `in_order`.

    Returns:
        The runs, that of the scene without edits first unless there are edits at its beginning; and which object of
        the scene each name still means, since a removed name may be given to another.

    Raises:
        SceneError: An edit does not fit the scene, or puts a body into another.
        SimulationError: The edited scene becomes unstable.
    """
    origins = {o.name: i for i, o in enumerate(scene.objects)}
    runs, steps = [Run(0, scene, trace)], len(trace.position) - 1
    for step, group in groupby(edits, key=lambda e: round(e.at * STEPS_PER_SECOND)):
        last = runs[-1]
        after = _applied(scene_at(last.scene, last.trace, step - last.step), list(group), origins)
        rest = max(steps - step, 1) / STEPS_PER_SECOND
        runs = runs[:-1] if last.step == step else runs
        runs.append(Run(step, after, simulate(after, rest) if after.objects else _nothing(last.trace, steps - step)))
    return tuple(runs), origins


def _nothing(trace: Trace, steps: int) -> Trace:
    """The motion of no bodies."""
    vector = np.zeros((steps + 1, 0, 3))
    contacts = replace(trace.contacts, **{f.name: getattr(trace.contacts, f.name)[:0] for f in fields(trace.contacts)})
    return Trace(trace.rate, vector, np.zeros((steps + 1, 0, 4)), vector, vector, contacts)


def run_edits(scene: Scene, trace: Trace, edits: Sequence[Edit], times: np.ndarray) -> EditedMotion:
    """The motion of a scene with edits, at the frames of its clip.

    Args:
        scene: The clip's scene.
        trace: Its motion.
        edits: By time, from `in_order`.
        times: (T,) s, when its frames were filmed.

    Raises:
        SceneError: An edit does not fit the scene, or puts a body into another.
        SimulationError: The edited scene becomes unstable.
    """
    steps, frames = frame_steps(times), len(times)
    runs, origins = edited_runs(scene, trace, edits)
    bodies: list[SceneObject] = list(scene.objects)
    origin: list[int | None] = list(range(len(bodies)))
    position = [trace.position[steps, i] for i in range(len(bodies))]
    quaternion = [trace.quaternion[steps, i] for i in range(len(bodies))]
    shown = [np.ones(frames, bool) for _ in bodies]
    first = frames
    for run in runs:
        if run.trace is trace:
            continue
        later = np.flatnonzero(steps >= run.step)
        first = min(first, int(later[0])) if len(later) else first
        for known in shown:
            known[later] = False
        for k, obj in enumerate(run.scene.objects):
            m = _entry(bodies, obj)
            if m is None:
                m = len(bodies)
                bodies.append(obj)
                origin.append(origins.get(obj.name))
                position.append(np.tile(np.array(obj.position, float), (frames, 1)))
                quaternion.append(np.tile(np.array(obj.orientation, float), (frames, 1)))
                shown.append(np.zeros(frames, bool))
            position[m][later] = run.trace.position[steps[later] - run.step, k]
            quaternion[m][later] = run.trace.quaternion[steps[later] - run.step, k]
            shown[m][later] = True
    motion = BodyMotion(tuple(bodies), np.stack(position, 1), np.stack(quaternion, 1), np.stack(shown, 1))
    added = [added_object(edit) for edit in edits if edit.add is not None]
    colours = {str(obj.get("name")): colour for obj, colour in added if colour is not None}
    last = runs[-1]
    return EditedMotion(motion, tuple(origin), last.scene, last.step / STEPS_PER_SECOND, first, colours)


def scene_at(scene: Scene, trace: Trace, step: int) -> Scene:
    """The scene with the state that it has after `step` steps of its trace."""
    if step == 0:
        return scene
    moved = (
        replace(
            o,
            position=tuple(trace.position[step, i]),
            velocity=tuple(trace.velocity[step, i]),
            angular_velocity=tuple(trace.angular_velocity[step, i]),
            orientation=tuple(trace.quaternion[step, i]),
        )
        for i, o in enumerate(scene.objects)
    )
    return joints_after(scene, replace(scene, objects=tuple(moved)))


def _applied(scene: Scene, edits: Sequence[Edit], origins: dict[str, int]) -> Scene:
    """The scene after edits of one time; a removed name is no longer one of the clip's bodies."""
    after = scene
    for edit in edits:
        if edit.set is not None:
            after = edited(after, [edit.set])
        elif edit.remove is not None:
            after = _without(after, edit)
            origins.pop(edit.remove, None)
        else:
            after = _with(after, edit)
    _check_solid(scene, after, edits)
    return after


def _without(scene: Scene, edit: Edit) -> Scene:
    names = [o.name for o in scene.objects]
    if edit.remove not in names:
        hint = did_you_mean(edit.remove, names)
        raise SceneError(f"{edit}: there is no such object then{hint}; valid: {', '.join(names) or 'none'}")
    effects = tuple(
        replace(e, objects=None if e.objects is None else tuple(n for n in e.objects if n != edit.remove))
        for e in scene.effects
    )
    left = (o for o in scene.objects if o.name != edit.remove)
    return replace(
        scene,  # what was joined to the removed object is free
        objects=tuple(replace(o, joint=None) if o.joint is not None and o.joint.to == edit.remove else o for o in left),
        effects=tuple(e for e in effects if e.objects is None or e.objects),
    )


def _with(scene: Scene, edit: Edit) -> Scene:
    data = parse_yaml(write_scene(scene), "the scene", SceneError)
    data["objects"] = [*data["objects"], added_object(edit)[0]]
    try:
        return scene_from_dict(data, "the edited scene")
    except SceneError as error:
        raise SceneError(f"{edit}: {error}") from None


def _check_solid(before: Scene, after: Scene, edits: Sequence[Edit]) -> None:
    """Raise SceneError where edits put a body into another one, or into the ground."""
    was = _depths(before)
    for (one, other), depth in _depths(after).items():
        extents = [half_extents(o).min() for o in after.objects if o.name in (one, other)]
        allowed = SOLID * float(min(extents))
        if depth > max(allowed, was.get((one, other), 0.0) + 0.2 * allowed):
            raise SceneError(
                f"{'; '.join(map(str, edits))}: {one} would be {1000 * depth:.0f} mm inside {other}; valid: places "
                "that are free"
            )


def _depths(scene: Scene) -> dict[tuple[str, str], float]:
    """How deep bodies are in each other, or in ground and fixed bodies, m, by name."""
    names = [o.name for o in scene.objects]
    found = {}
    for o in overlaps(scene):
        second = names[o.second] if o.second >= 0 else scene.fixed[FIRST_FIXED - o.second].name
        found[names[o.first], second] = o.depth
    deep = ground_penetration(scene)
    return found | {(name, "the ground"): float(d) for name, d in zip(names, deep, strict=True) if d > 0}


def _entry(bodies: Sequence[SceneObject], obj: SceneObject) -> int | None:
    """The entry of a body that looks the same: its name, shape and sizes."""
    for m, known in enumerate(bodies):
        if (known.name, known.shape, known.size) == (obj.name, obj.shape, obj.size):
            return m
    return None
