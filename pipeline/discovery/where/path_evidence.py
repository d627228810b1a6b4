"""How much a force that acts in a region explains of what the known scene leaves of the paths.

The force is a sum of simple force fields with unknown coefficients. It bends the paths by its acceleration in the
region, integrated twice. Linear regression tells how much chi squared falls, beside straight lines, blows and the free
numbers of the known scene.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.discovery.tracks.arc import Arc
from pipeline.discovery.where.clean_part import CleanPart, Leftover
from pipeline.discovery.where.intervals import Explained, bends_at, is_blow

AXES = ("x", "y", "z")
FIELDS = ("direction", "velocity", "square", *AXES, "position")
"""Simple force fields: a unit vector along the motion, the velocity, speed times velocity, axes, and the position."""
LAWS = (("direction",), ("velocity",), ("square",), AXES, ("velocity", *AXES))
"""The fields of friction, slowing, drag, a push and a stream; in a ball a pull towards its centre is one more law."""
TINY = 1e-9  # of a column's square, relative: what the rest explains as well cannot be told
CHUNK = 256  # regions that are compared at once


@dataclass(frozen=True)
class Samples:
    """S samples of bodies.

    Attributes:
        time: (S,) s.
        position: (S, 3) m.
        velocity: (S, 3) m/s.
        clip: (S,) index of the recording.
        object: (S,) index of the object.
        inside: (S,) bool, in an interval.
    """

    time: np.ndarray
    position: np.ndarray
    velocity: np.ndarray
    clip: np.ndarray
    object: np.ndarray
    inside: np.ndarray

    def where(self, chosen: np.ndarray) -> Samples:
        """The samples chosen, (S,) bool or indices."""
        return Samples(*(getattr(self, k)[chosen] for k in self.__dataclass_fields__))


@dataclass(frozen=True)
class Part:
    """A part of a path in the regression of what is left of the paths on accelerations.

    Attributes:
        arc: Index of its arc.
        rows: (n,) indices of its samples, in `Samples`.
        shown: (3,) bool, the C coordinates that are measured.
        bend: (K, n) how accelerations at the samples change the rows of the regression.
        left: (K, C) what is left.
        slopes: (K, C, G) orthonormal, what free numbers of the scene change.
    """

    arc: int
    rows: np.ndarray
    shown: np.ndarray
    bend: np.ndarray
    left: np.ndarray
    slopes: np.ndarray


@dataclass(frozen=True)
class Paths:
    """What a clean part leaves of the paths, beside straight lines, blows and free numbers.

    Attributes:
        samples: Those at which a body moves.
        parts: Of the paths.
        price: By which chi squared has to fall with each number.
    """

    samples: Samples
    parts: tuple[Part, ...]
    price: float

    def normals(self, fields: Sequence[np.ndarray], inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Normal matrices (R, F, F) and right sides (R, F) of force fields in R regions.

        Args:
            fields: Per part (F, n, 3) m/s² at its samples.
            inside: (R, S) bool, the samples in each region.
        """
        count, free = len(inside), self.parts[0].slopes.shape[-1] if self.parts else 0
        size = len(fields[0]) if fields else 0
        normal, reach = np.zeros((count, size, size)), np.zeros((count, size))
        shared = np.zeros((count, size, free))
        for part, own in zip(self.parts, fields, strict=True):
            for chunk in (slice(k, k + CHUNK) for k in range(0, count, CHUNK)):
                acts = inside[chunk, part.rows]
                some = np.flatnonzero(acts.any(1))
                acting = acts[some][:, None, :, None] * own[:, :, part.shown]  # (r, F, n, C)
                columns = (part.bend @ acting).reshape(len(some), size, part.left.size)
                normal[chunk][some] += columns @ columns.transpose(0, 2, 1)
                reach[chunk][some] += columns @ part.left.ravel()
                shared[chunk][some] += columns @ part.slopes.reshape(part.left.size, free)
        return normal - shared @ shared.transpose(0, 2, 1), reach


@dataclass(frozen=True)
class SimpleForces:
    """The regression on sums of simple force fields (`LAWS`)."""

    paths: Paths

    def gains(self, inside: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(R,) by how much chi squared falls, less the price of coefficients, with the best law in each of R regions.

        Args:
            inside: (R, S) bool, the samples in each region.
            centres: (R, 3) m, to which a force may point; NaN of regions without a centre.
        """
        price = self.paths.price
        normal, reach = self.paths.normals(self._fields, inside)
        out = [explained(normal[:, own][:, :, own], reach[:, own]) - price * len(own) for own in map(_columns, LAWS)]
        field = np.zeros((len(inside), len(FIELDS), 1))
        field[:, _columns(AXES), 0], field[:, -1, 0] = np.nan_to_num(centres), -1.0
        square = field.transpose(0, 2, 1) @ normal @ field
        pull = explained(square, (field[..., 0] * reach).sum(1, keepdims=True)) - price
        return np.max([*out, np.where(np.isnan(centres[:, 0]), -np.inf, pull)], axis=0)

    def recordings(self) -> list[np.ndarray]:
        """For each law the recordings, as (clips,) bool, in which one force of this kind explains something."""
        clip = self.paths.samples.clip
        numbers = np.arange(clip.max(initial=-1) + 1)
        normal, reach = self.paths.normals(self._fields, clip == numbers[:, None])
        out = []
        for columns in map(_columns, LAWS):
            own, right = normal[:, columns][:, :, columns], reach[:, columns]
            chosen = np.arange(len(numbers)) == explained(own, right).argmax()
            for _ in range(len(numbers)):
                force = np.linalg.pinv(own[chosen].sum(0)) @ right[chosen].sum(0)
                again = 2 * right @ force - np.einsum("i,cij,j->c", force, own, force) > 0
                if not again.any() or (again == chosen).all():
                    break
                chosen = again
            out.append(chosen)
        return out

    @cached_property
    def _fields(self) -> list[np.ndarray]:
        samples, out = self.paths.samples, []
        for part in self.paths.parts:
            v, x = samples.velocity[part.rows], samples.position[part.rows]
            speed = np.maximum(np.linalg.norm(v, axis=1, keepdims=True), TINY)
            axes = np.broadcast_to(np.eye(3)[:, None], (3, len(v), 3))
            out.append(np.stack([v / speed, v, speed * v, *axes, x]))
        return out


def _columns(law: Sequence[str]) -> list[int]:
    return [FIELDS.index(name) for name in law]


def explained(normal: np.ndarray, reach: np.ndarray) -> np.ndarray:
    """(R,) by how much chi squared falls, of normal matrices (R, k, k) and right sides (R, k)."""
    size = np.sqrt(np.maximum(np.einsum("rii->ri", normal), TINY))
    scaled = normal / (size[:, :, None] * size[:, None]) + TINY * np.eye(normal.shape[-1])
    right = reach / size
    return np.asarray((np.linalg.solve(scaled, right[..., None])[..., 0] * right).sum(1))


def paths_of(
    arcs: tuple[Arc, ...], clean: CleanPart, clips: tuple[str, ...], least_speed: float, price: float
) -> Paths:
    """What a clean part leaves of the paths.

    Args:
        arcs: Of the problem.
        clean: The clean part.
        clips: Names of the recordings.
        least_speed: m/s; on a slower body no force shows.
        price: By which chi squared has to fall with each number.
    """
    samples, parts, place = [], [], 0
    for k, (arc, leftovers, explanations) in enumerate(zip(arcs, clean.leftovers, clean.explained, strict=True)):
        velocity = smooth_velocity(arc.time, arc.position)
        for left, own in zip(leftovers, explanations, strict=True):
            inside, blown = np.zeros((2, len(arc.time)), bool)
            for v in own.intervals:
                during = (arc.time >= v.start) & (arc.time <= v.end)
                inside |= during
                blown |= during & is_blow(v, arc)
            moves = np.linalg.norm(velocity, axis=1) > least_speed
            at = np.flatnonzero((left.weight.max(1) > 0) & (moves | inside) & ~blown)
            rows = np.arange(place, place + len(at))
            place += len(at)
            clip, number = np.full(len(at), clips.index(arc.clip)), np.full(len(at), arc.object)
            samples.append(Samples(arc.time[at], arc.position[at], velocity[at], clip, number, inside[at]))
            parts.append(_part(k, arc, left, own, rows, at))
    joined = Samples(*(np.concatenate([getattr(s, k) for s in samples]) for k in Samples.__dataclass_fields__))
    return Paths(joined, _beside_free_numbers([p for p in parts if len(p.rows)]), price)


def _part(number: int, arc: Arc, left: Leftover, own: Explained, rows: np.ndarray, at: np.ndarray) -> Part:
    """A part of an arc, beside its line and blows. rows: indices of its samples, of all; at: in the arc."""
    shown, there = left.weight.max(0) > 0, left.weight.max(1) > 0
    t, weight = arc.time[there], left.weight[there].max(1)
    blows = [np.maximum(t - end, 0) for v in own.intervals if is_blow(v, arc) for end in (v.start, v.end)]
    basis, _ = np.linalg.qr(weight[:, None] * np.column_stack([np.ones_like(t), t - t.mean(), *blows]))

    def beside(values: np.ndarray) -> np.ndarray:
        values = weight.reshape(-1, *[1] * (values.ndim - 1)) * values
        return np.asarray(values - np.tensordot(basis, np.tensordot(basis, values, (0, 0)), 1))

    bend = -np.diff(beside(bends_at(t)[1]), axis=1)[:, np.isin(np.flatnonzero(there), at)]
    slopes = beside(np.moveaxis(left.slope, 0, -1)[there][:, shown])
    return Part(number, rows, shown, bend, beside(left.path[there][:, shown]), slopes)


def _beside_free_numbers(parts: Sequence[Part]) -> tuple[Part, ...]:
    """The parts with orthonormal slopes of the free numbers, and without what these explain of what is left."""
    if not parts:
        return ()
    slopes = np.concatenate([p.slopes.reshape(p.left.size, p.slopes.shape[-1]) for p in parts])
    left = np.concatenate([p.left.ravel() for p in parts])
    unit, size, _ = np.linalg.svd(slopes, full_matrices=False)
    unit = unit[:, size > TINY * size.max(initial=1.0)]
    left = left - unit @ (unit.T @ left)
    out, place = [], 0
    for part in parts:
        here, shape = slice(place, place + part.left.size), part.left.shape
        out.append(replace(part, left=left[here].reshape(shape), slopes=unit[here].reshape(*shape, unit.shape[1])))
        place += part.left.size
    return tuple(out)


def smooth_velocity(time: np.ndarray, position: np.ndarray) -> np.ndarray:
    """(T, 3) m/s at times (T,) s and positions (T, 3) m, by parabolas through neighbouring samples."""
    count, half = len(time), 4
    out = np.empty_like(position)
    for k in range(count):
        near = slice(max(0, min(k - half, count - 2 * half - 1)), min(count, max(k + half + 1, 2 * half + 1)))
        t = time[near] - time[k]
        out[k] = np.linalg.lstsq(np.column_stack([np.ones_like(t), t, t * t]), position[near], rcond=None)[0][1]
    return out
