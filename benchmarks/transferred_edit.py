"""An edit of a true scene, said for the scene that was found in its clip.

A clip does not tell scale, mass or gravity, so an edit of numbers is carried over as a person would say it: masses and
gravity as multiples of what they were, velocities and places as the camera sees them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace

import numpy as np

from pipeline.editing.edit_list import Edit
from pipeline.scene.scene import Scene, rounded
from pipeline.vision.rendering.camera import Pinhole, pinhole, project


@dataclass(frozen=True)
class Counterpart:
    """A found scene beside the true one.

    Attributes:
        true: The true scene.
        found: The found scene.
        pairs: (P, 2) found and true objects that are the same body.
    """

    true: Scene
    found: Scene
    pairs: np.ndarray

    def object_of(self, true: int) -> int | None:
        """The found object that is this true one."""
        return next((int(i) for i, j in self.pairs if j == true), None)

    @property
    def linear(self) -> np.ndarray:
        """(3, 3), which takes vectors of the true world to the found one: alike in the pictures of both cameras."""
        cameras = self._cameras
        depth = [
            project(np.array([s.objects[k].position for k in self.pairs[:, column]]), camera, 3, 2)[1]
            for column, (s, camera) in enumerate(zip((self.found, self.true), cameras, strict=True))
        ]
        along = float(np.exp(np.mean(np.log(depth[0] / depth[1]))))
        widths = [np.tan(np.radians(c.fov_y_deg) / 2) for c in cameras]
        aside = along * float(widths[0] / widths[1])
        return np.asarray(cameras[0].rotation_world @ np.diag([aside, aside, along]) @ cameras[1].rotation_world.T)

    def place(self, position: list[float]) -> list[float]:
        """A point of the true world in the found one."""
        found, true = self._cameras
        return _numbers(found.position_world + self.linear @ (np.array(position) - true.position_world))

    def velocity(self, velocity: list[float]) -> list[float]:
        """A velocity of the true world in the found one."""
        return _numbers(self.linear @ np.array(velocity))

    def length(self, metres: float) -> float:
        """A length of the true world in the found one."""
        return rounded(abs(np.linalg.det(self.linear)) ** (1 / 3) * metres)

    @property
    def mass_ratio(self) -> float:
        """Found masses as multiples of true ones, the geometric mean."""
        ratios = [self.found.objects[i].mass / self.true.objects[j].mass for i, j in self.pairs]
        return float(np.exp(np.mean(np.log(ratios))))

    @property
    def _cameras(self) -> tuple[Pinhole, Pinhole]:
        assert self.found.camera is not None and self.true.camera is not None
        return pinhole(self.found.camera), pinhole(self.true.camera)


def transferred(edit: Edit, both: Counterpart) -> Edit | None:
    """The edit for the found scene; None where the body that it concerns was not found."""
    true, found = both.true, both.found
    if edit.remove is not None:
        i = both.object_of([o.name for o in true.objects].index(edit.remove))
        return None if i is None else replace(edit, remove=found.objects[i].name)
    if edit.add is not None:
        if not len(both.pairs):
            return None
        added = edit.add | {
            "radius": both.length(edit.add["radius"]),
            "position": both.place(edit.add["position"]),
            "mass": rounded(edit.add["mass"] * both.mass_ratio),
        }
        return replace(edit, add=added)
    assert edit.set is not None
    path, _, text = edit.set.partition("=")
    value = json.loads(text)
    if path == "gravity":
        ratio = value / float(np.linalg.norm(true.gravity))
        return replace(edit, set=f"gravity={_numbers(ratio * np.array(found.gravity))}")
    place, _, key = path.partition("].")
    k = int(place.removeprefix("objects["))
    i = both.object_of(k)
    if i is None:
        return None
    if key == "mass":
        value = rounded(value / true.objects[k].mass * found.objects[i].mass)
    elif key == "velocity":
        value = both.velocity(value)
    return replace(edit, set=f"objects[{i}].{key}={value}")


def _numbers(values: np.ndarray) -> list[float]:
    return [rounded(v) for v in values]
