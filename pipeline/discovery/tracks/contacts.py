"""When a body touches the ground or another body, by velocity jumps and by distances."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.tracks.arc import GROUND
from pipeline.discovery.tracks.velocity_jumps import VelocityJump
from pipeline.scene.scene import Scene, SceneObject, half_extents

UPWARDS = 0.8  # least share of the change of velocity that is upwards in a bounce on the ground
MOST_FRICTION = 1.2  # of bodies on the ground: rubber on concrete has about 1
SIDEWAYS = 0.5  # largest share that is vertical in a hit by another body from the side
TOUCH = 3.5  # standard deviations of a coordinate: how much wider than 0 the gap between touching balls may seem
LEAST_APPROACH = 0.08  # m/s: bodies that approach each other more slowly may lie side by side
SIDE = 4  # samples before and after a contact that its speeds are taken from
ROUNDED = 0.4  # a Gaussian filter rounds a kink off by this, times the change of slope, times the filter's width


@dataclass(frozen=True)
class Surroundings:
    """One object's track without outliers, and what the object may touch.

    Attributes:
        scene: Of the clip.
        index: The object's index in the scene.
        time: (T,) s.
        position: (T, 3) m.
        gap: (T,) m, height of the object's lowest point over the ground; inf without a ground.
        others: (T, M, 3) m, centres of the scene's other objects, in the order of the scene.
        sigma: Standard deviation of a coordinate, m.
        blur: Standard deviation of the filter that smoothed positions, s; 0 without one.
    """

    scene: Scene
    index: int
    time: np.ndarray
    position: np.ndarray
    gap: np.ndarray
    others: np.ndarray
    sigma: float
    blur: float = 0.0

    @property
    def object(self) -> SceneObject:
        return self.scene.objects[self.index]

    def other_objects(self) -> Iterator[tuple[int, SceneObject, np.ndarray]]:
        """Index, object and distance between the centres (T,) m of each other object."""
        present = ((i, o) for i, o in enumerate(self.scene.objects) if i != self.index)
        for column, (number, other) in zip(range(self.others.shape[1]), present, strict=False):
            yield number, other, np.linalg.norm(self.others[:, column] - self.position, axis=1)


Contact = tuple[VelocityJump, int]
"""A jump, possibly of unknown size, and what was touched: `GROUND` or the index of an object."""


def hit_object(jump: VelocityJump, around: Surroundings) -> int | None:
    """What a velocity jump is an impact with: `GROUND`, the index of another object, or None."""
    time, gap, sigma = around.time, around.gap, around.sigma
    near = int(np.argmin(np.abs(time - jump.time)))
    low = slice(max(0, near - 1), near + 2)
    size = float(max(half_extents(around.object)))
    met: int | None = None
    for number, other, distance in around.other_objects():
        reach = size + float(max(half_extents(other)))
        if met is None and distance[low].min() < 1.3 * reach + 4 * sigma:
            met = number
    if met is not None and abs(jump.change[2]) < SIDEWAYS * np.linalg.norm(jump.change):
        return met  # the ground would push upwards
    if np.isfinite(gap[near]):
        at_jump = jump.position[2] - around.position[near, 2] + gap[near]
        intervals = np.diff(time[max(0, near - 2) : near + 3])
        missed = ROUNDED * around.blur * abs(float(jump.change[2]))
        # and how far the body may have fallen and risen again while rows are missing
        rows_missing = len(intervals) and intervals.max() > 1.5 * np.median(np.diff(time))
        if is_upwards(jump) and rows_missing:
            missed += 0.5 * float(jump.change[2]) * float(intervals.max())
        if min(at_jump, gap[low].min()) < 0.25 * size + 0.01 + 4 * sigma + missed and ground_may_push(jump):
            return GROUND
    return met


def ground_may_push(jump: VelocityJump) -> bool:
    """Whether a level ground may have caused a velocity jump: it pushes upwards, and sideways by friction alone."""
    error = 2 * float(np.linalg.norm(jump.change)) / max(jump.z, 1.0)
    return bool(np.hypot(*jump.change[:2]) <= MOST_FRICTION * (jump.change[2] + error) + error)


def is_upwards(jump: VelocityJump) -> bool:
    """Whether a velocity jump has the direction of a bounce on the ground."""
    return bool(jump.change[2] > UPWARDS * np.linalg.norm(jump.change))


def collisions_by_distance(around: Surroundings, found: Sequence[VelocityJump]) -> list[Contact]:
    """Impacts between balls that the distance shows and the velocity does not. found: the velocity jumps."""
    out: list[Contact] = []
    if around.object.shape != "sphere":
        return out
    for number, other, distance in around.other_objects():
        if other.shape != "sphere":
            continue
        reach = float(half_extents(around.object)[0] + half_extents(other)[0])
        for when in closest_approaches(around.time, distance, reach, around.sigma):
            step = float(np.median(np.diff(around.time)))
            if all(abs(when - jump.time) > 2.5 * step for jump in (*found, *(jump for jump, _ in out))):
                at = around.position[int(np.argmin(np.abs(around.time - when)))]
                out.append((VelocityJump(when, at, np.zeros(3), 0.0), number))
    return out


def touching_samples(around: Surroundings) -> list[Contact]:
    """The samples at which a ball touches another one: however gently, they push and rub each other."""
    out: list[Contact] = []
    if around.object.shape != "sphere":
        return out
    for number, other, distance in around.other_objects():
        if other.shape == "sphere":
            reach = sum(float(half_extents(o)[0]) for o in (around.object, other))
            for k in np.flatnonzero(distance < reach + TOUCH * around.sigma):
                out.append((VelocityJump(float(around.time[k]), around.position[k], np.zeros(3), 0.0), number))
    return out


def closest_approaches(time: np.ndarray, distance: np.ndarray, reach: float, sigma: float) -> list[float]:
    """Times, s, at which the distance between two centres stops shrinking while the bodies touch.

    The touch may lie between two samples, so that half of a sample's approach is allowed for.

    Args:
        time: (T,) s.
        distance: (T,) m.
        reach: Distance at which the bodies touch, m.
        sigma: Standard deviation of a coordinate, m.
    """
    out: list[float] = []
    for k in range(1, len(time) - 1):
        before, after = slice(max(0, k - SIDE), k + 1), slice(k, k + SIDE + 1)
        if distance[k] > distance[before].min() or distance[k] > distance[after].min():
            continue
        approach, leave = (_slope(time[s], distance[s]) for s in (before, after))
        error = 2 * sigma / max(time[k] - time[before][0], 1e-9)
        if -approach < LEAST_APPROACH + 2 * error or leave < 0.3 * approach:
            continue
        gap = max(time[k] - time[k - 1], time[k + 1] - time[k])
        if distance[k] < reach - 0.5 * approach * gap + 4 * sigma:
            out.append(float(time[k]))
    return out


def _slope(t: np.ndarray, y: np.ndarray) -> float:
    t = t - t.mean()
    return float((t @ y) / max(t @ t, 1e-12))
