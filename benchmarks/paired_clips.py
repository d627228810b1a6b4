"""Clips rendered twice by MuJoCo with a random appearance, before and after a true edit of their scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.editing.edit_list import Edit
from pipeline.editing.edited_motion import EditedMotion, filmed_motion, run_edits
from pipeline.editing.view import BodyMotion, view_of
from pipeline.errors import DynamicsError, SceneError
from pipeline.scene.scene import Scene, SceneObject
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.rendering.appearance import (
    Appearance,
    Material,
    Sensor,
    apply_sensor,
    plain_appearance,
    sample_appearance,
    sample_sensor,
)
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import Params
from training.drawn_scenes import drawn_scenes

SUITE = "paired_edits"
OBJECTS = {1: 1.0, 2: 1.0, 3: 1.0}
KINDS = ("mass", "friction", "velocity", "gravity", "remove", "add", "later")
LATER_S = 0.4  # when the edit of the kind `later` is made; the others are made at the beginning
TRIES = 5  # of an edit that puts a body into another, or changes nothing
MOST_SCENES = 200  # that are tried for one pair
LEAST_CHANGE_M = 0.05  # of a body's place, from which on an edit counts
LEAST_SEEN_PX = 30  # of each body, in the mean over the clip
SIZE = 480, 320
ADDED = "added"


@dataclass(frozen=True)
class Shown:
    """A clip and where it shows which body.

    Attributes:
        names: N bodies.
        frames: (T, H, W, 3) uint8.
        ids: (T, H, W) uint8: 0 background, i + 1 body i.
        centres_px: (T, N, 2), the projected centres.
    """

    names: tuple[str, ...]
    frames: np.ndarray
    ids: np.ndarray
    centres_px: np.ndarray

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self.ids.shape[2], self.ids.shape[1]

    def mask(self, name: str) -> np.ndarray:
        """(T, H, W) bool, where a body is seen; nowhere if there is none of that name."""
        return self.ids == self.names.index(name) + 1 if name in self.names else np.zeros(self.ids.shape, bool)

    def places(self, name: str) -> np.ndarray:
        """(T, 2) px, where a body is seen: the centroid of its mask, or its projected centre where it is hidden."""
        out, mask = self.centres_px[:, self.names.index(name)].copy(), self.mask(name)
        for t in np.flatnonzero(mask.any((1, 2))):
            rows, cols = np.nonzero(mask[t])
            out[t] = cols.mean() + 0.5, rows.mean() + 0.5
        return out


@dataclass(frozen=True)
class Pair:
    """A clip before and after an edit.

    Attributes:
        kind: One of `KINDS`.
        scene: Before the edit.
        edit: The edit.
        made: The true edited motion.
        before: The clip.
        after: The clip after the edit, with the same appearance and sensor.
        concerned: The bodies that the edit adds, removes, or moves elsewhere.
        moved: Those that it moves elsewhere.
        refused: Drawn edits before this one that did not fit their scene: a body would have been inside another.
    """

    kind: str
    scene: Scene
    edit: Edit
    made: EditedMotion
    before: Shown
    after: Shown
    concerned: tuple[str, ...]
    moved: tuple[str, ...]
    refused: int


def draw_edit(kind: str, scene: Scene, rng: np.random.Generator) -> Edit:
    """An edit of one kind with random numbers."""
    k = int(rng.integers(len(scene.objects)))
    obj = scene.objects[k]
    if kind == "mass":
        return Edit(0.0, set=f"objects[{k}].mass={obj.mass * rng.choice([0.1, 10]):g}")
    if kind == "friction":
        return Edit(0.0, set=f"objects[{k}].sliding_friction={rng.choice([0.0, 2.0]):g}")
    if kind == "gravity":
        return Edit(0.0, set=f"gravity={rng.uniform(1, 4):.3g}")
    if kind == "remove":
        return Edit(0.0, remove=obj.name)
    if kind == "add":
        place = [float(v) for v in (rng.uniform(-0.5, 0.5), rng.uniform(-0.5, 0.5), 0.6)]
        keys = {"mass": 0.5, "sliding_friction": 0.5, "rolling_friction": 0.001, "damping": 0.7}
        still = {"velocity": [0.0] * 3, "angular_velocity": [0.0] * 3, "orientation": [1.0, 0.0, 0.0, 0.0]}
        added = {"name": ADDED, "shape": "sphere", "radius": 0.1, **keys, "position": place, **still}
        return Edit(0.0, add=added)
    velocity = [round(float(v), 3) for v in (*rng.uniform(-1.5, 1.5, 2), rng.uniform(0, 2))]
    return Edit(LATER_S if kind == "later" else 0.0, set=f"objects[{k}].velocity={velocity}")


def shown_bodies(motion: BodyMotion) -> BodyMotion:
    """The bodies that are there in the last frame."""
    there = motion.shown[-1]
    return BodyMotion(
        tuple(o for o, kept in zip(motion.objects, there, strict=True) if kept),
        motion.position[:, there],
        motion.quaternion[:, there],
        motion.shown[:, there],
    )


def drawn_plain(scene: Scene, motion: BodyMotion, size: tuple[int, int]) -> Shown:
    """A motion in the colours of `dynamics simulate`."""
    look = plain_appearance(len(motion.objects), len(scene.fixed))
    return filmed(scene, motion, look, Sensor(), size, np.random.default_rng(0))


def filmed(
    scene: Scene, motion: BodyMotion, look: Appearance, sensor: Sensor, size: tuple[int, int], rng: np.random.Generator
) -> Shown:
    """A motion before a scene's camera.

    Args:
        scene: Its camera and ground are used.
        motion: Bodies that are there all the time.
        look: Their appearance, and that of the surroundings.
        sensor: The camera's.
        size: Width and height, px.
        rng: Of the sensor's noise.
    """
    assert scene.camera is not None
    bodies = replace(scene, objects=motion.objects)
    frames = render_rgb(bodies, motion.position, motion.quaternion, look, *size, "mujoco")
    pose = motion.position, motion.quaternion, pinhole(scene.camera)
    ids = rasterise(motion.objects, *pose, *size, scene.ground).mask
    names = tuple(o.name for o in motion.objects)
    return Shown(names, apply_sensor(frames, sensor, rng), ids, motion.centres_px(view_of(scene, *size)))


def draw_pair(params: Params, seed: int, number: int, size: tuple[int, int] = SIZE) -> Pair:
    """The pair of that number, whose kind follows from it: of the first scene that the drawn edit changes.

    Args:
        params: All parameters of the experiment, by which scenes are drawn.
        seed: Of scenes, appearances and edits.
        number: Names the pair.
        size: Width and height of the pictures, px.

    Raises:
        DynamicsError: No scene was changed by an edit of this kind.
    """
    kind, suite = KINDS[number % len(KINDS)], f"{SUITE} {number}"
    schedule, refused = Schedule(), 0
    for index in range(MOST_SCENES):
        (scene,) = drawn_scenes(params, seed, suite, range(index, index + 1), OBJECTS)
        rng = clip_rng(seed, suite, index, "edit")
        motion, trace = filmed_motion(scene, schedule.times)
        for _ in range(TRIES):
            edit = draw_edit(kind, scene, rng)
            try:
                made = run_edits(scene, trace, [edit], schedule.times)
            except SceneError:
                refused += 1
                continue
            moved, concerned = _concerned(motion, made.motion)
            if concerned:
                break
        else:
            continue
        look, sensor = sample_appearance(rng, len(scene.objects)), sample_sensor(rng)
        before = filmed(scene, motion, look, sensor, size, rng)
        seen = [before.mask(name).sum((1, 2)).mean() for name in before.names]
        if min(seen) < LEAST_SEEN_PX:
            continue
        changed, after = replace(scene, gravity=made.scene.gravity), shown_bodies(made.motion)
        new = Material(tuple(float(v) for v in rng.uniform(0.2, 0.9, 3)))  # type: ignore[arg-type]
        true = filmed(changed, after, _look_of(after.objects, before.names, look, new), sensor, size, rng)
        if edit.add is not None:
            edit = replace(edit, add=edit.add | {"colour": shown_colour(new, look, sensor)})
            made = run_edits(scene, trace, [edit], schedule.times)
        return Pair(kind, scene, edit, made, before, true, concerned, moved, refused)
    raise DynamicsError(f"no edit of kind {kind} changed any of {MOST_SCENES} scenes; {refused} did not fit")


def _concerned(before: BodyMotion, after: BodyMotion) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The bodies that an edit moves elsewhere, and those and the ones that it adds or removes."""
    moved, other = [], []
    for k, obj in enumerate(after.objects):
        if k >= len(before.objects) or not after.shown[-1, k]:
            other.append(obj.name)
        elif np.linalg.norm(after.position[:, k] - before.position[:, k], axis=-1).max() > LEAST_CHANGE_M:
            moved.append(obj.name)
    return tuple(moved), (*moved, *other)


def shown_colour(material: Material, look: Appearance, sensor: Sensor) -> list[int]:
    """The colour that a matt material has on open ground: what a person sees of it, RGB from 0 to 255."""
    light = np.full(3, look.ambient)
    for source in look.lights:
        towards = np.array(source.towards if source.position is None else source.position)
        light += np.array(source.colour) * towards[2] / np.linalg.norm(towards)
    tone = sensor.brightness * np.clip(light * np.array(material.colour), 0, 1) ** sensor.gamma
    return [int(v) for v in np.clip(np.rint(255 * tone), 0, 255)]


def _look_of(objects: Sequence[SceneObject], names: Sequence[str], look: Appearance, new: Material) -> Appearance:
    """The appearance of these objects; one that is not among `names` has the new material."""
    materials = tuple(look.materials[names.index(o.name)] if o.name in names else new for o in objects)
    return replace(look, materials=materials)
