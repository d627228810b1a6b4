"""The part of the world in which an effect acts: after a time, above a speed, within a ball, beyond a plane."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

LIMITS = {"after": "s", "before": "s", "faster": "m/s", "slower": "m/s"}
"""Conditions that are one number each, with their units."""
LEAST = 1e-300  # so that an instant at an edge is outside


def depths(
    edges: Mapping[str, Any], time: np.ndarray, position: np.ndarray, velocity: np.ndarray
) -> dict[str, np.ndarray]:
    """How far inside of each edge a body is, (...) in the edge's unit; not positive outside.

    Args:
        edges: As `Region.edges`.
        time: (...) s.
        position: (..., 3) m.
        velocity: (..., 3) m/s.
    """
    inside = {
        "after": lambda limit: time - limit,
        "before": lambda limit: limit - time,
        "faster": lambda limit: np.sqrt((velocity * velocity).sum(-1)) - limit,
        "slower": lambda limit: limit - np.sqrt((velocity * velocity).sum(-1)),
        "within": lambda ball: ball[1] - np.sqrt(((position - ball[0]) ** 2).sum(-1)),
        "beyond": lambda plane: (position * plane[0]).sum(-1) - plane[1],
    }
    return {name: inside[name](edge) for name, edge in edges.items()}


def is_inside(edges: Mapping[str, Any], time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
    """(...) bool; arguments as those of `depths`."""
    return np.all(
        [np.ones(position.shape[:-1], bool), *(d > 0 for d in depths(edges, time, position, velocity).values())], axis=0
    )


def share_within(
    edges: Mapping[str, Any],
    time: np.ndarray,
    position: np.ndarray,
    velocity: np.ndarray,
    step: Any = 0.0,
    gravity: Any = 0.0,
) -> np.ndarray:
    """What share of a step about a moment is inside, (...) from 0 to 1.

    Args:
        edges: As `Region.edges`.
        time: (...) s.
        position: (..., 3) m.
        velocity: (..., 3) m/s.
        step: (...) s; of an instant, 0, the share is 0 or 1.
        gravity: (..., 3) m/s², by which speeds change.
    """
    inside = np.ones(position.shape[:-1])
    for name, depth in depths(edges, time, position, velocity).items():
        rate: Any = 1.0
        if name in ("faster", "slower"):
            rate = _along(gravity, velocity)
        elif name == "beyond":
            rate = (velocity * edges[name][0]).sum(-1)
        elif name == "within":
            rate = _along(velocity, position - edges[name][0])
        inside = inside * np.clip(0.5 + (depth - LEAST) / np.maximum(np.abs(rate) * step, LEAST), 0.0, 1.0)
    return inside


def _along(vector: np.ndarray, way: np.ndarray) -> np.ndarray:
    """(...) the component of vectors (..., 3) along others."""
    return (vector * way).sum(-1) / np.maximum(np.sqrt((way * way).sum(-1)), 1e-9)


@dataclass(frozen=True)
class Region:
    """Conditions that hold together; those that are None are not asked for.

    Attributes:
        after: s, from the clip's beginning.
        before: s.
        faster: m/s.
        slower: m/s.
        centre: (3,) m, and `radius`, m, of a ball.
        radius: m.
        normal: (3,) unit vector, and `offset`, m: where normal · x > offset.
        offset: m.
        clips: Names of recordings; a simulation is of all of them.
    """

    after: float | None = None
    before: float | None = None
    faster: float | None = None
    slower: float | None = None
    centre: tuple[float, ...] | None = None
    radius: float = 0.0
    normal: tuple[float, ...] | None = None
    offset: float = 0.0
    clips: tuple[str, ...] | None = None

    @property
    def numbers(self) -> int:
        """How many numbers it has, of a ball or a plane on a level ground; a recording is a choice among several, and
        counts as two."""
        plain = sum(getattr(self, name) is not None for name in LIMITS)
        return plain + 3 * (self.centre is not None) + 2 * (self.normal is not None) + 2 * len(self.clips or ())

    @property
    def conditions(self) -> int:
        """How many are asked for."""
        return len(self.edges) + (self.clips is not None)

    @property
    def free(self) -> dict[str, tuple[float, str]]:
        """Its numbers that may be fitted, with their units: of a ball those along the ground, of an upright plane the
        heading of its normal."""
        out = {name: (getattr(self, name), unit) for name, unit in LIMITS.items() if getattr(self, name) is not None}
        if self.centre is not None:
            out |= {"centre_x": (self.centre[0], "m"), "centre_y": (self.centre[1], "m"), "radius": (self.radius, "m")}
        if self.normal is not None:
            out["offset"] = (self.offset, "m")
            if self.normal[2] == 0:
                out["heading"] = (math.atan2(self.normal[1], self.normal[0]), "rad")
        return out

    def moved(self, numbers: Mapping[str, Any]) -> Region:
        """The region with these numbers, or arrays (...) of them, in place of the `free` ones."""
        changed: dict[str, Any] = {k: v for k, v in numbers.items() if k not in ("centre_x", "centre_y", "heading")}
        if self.centre is not None:
            changed["centre"] = (numbers["centre_x"], numbers["centre_y"], self.centre[2])
        if "heading" in numbers:
            changed["normal"] = (np.cos(numbers["heading"]), np.sin(numbers["heading"]), 0.0)
        return replace(self, **changed)

    @property
    def edges(self) -> dict[str, Any]:
        """The conditions that are asked for: a number each; of `within` centre and radius, of `beyond` normal and
        offset."""
        out: dict[str, Any] = {name: getattr(self, name) for name in LIMITS if getattr(self, name) is not None}
        if self.centre is not None:
            out["within"] = (np.stack(np.broadcast_arrays(*self.centre), -1), self.radius)
        if self.normal is not None:
            out["beyond"] = (np.stack(np.broadcast_arrays(*self.normal), -1), self.offset)
        return out

    def holds(self, time: np.ndarray, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """(...) bool at times (...) s, positions (..., 3) m and velocities (..., 3) m/s."""
        return is_inside(self.edges, time, position, velocity)

    def as_dict(self) -> dict[str, Any]:
        """As `only` has it in a scene and in a report."""
        plain = {name: getattr(self, name) for name in LIMITS}
        out: dict[str, Any] = {k: v for k, v in plain.items() if v is not None}
        if self.centre is not None:
            out["within"] = {"center": [float(v) for v in self.centre], "radius": self.radius}
        if self.normal is not None:
            out["beyond"] = {"normal": [float(v) for v in self.normal], "offset": self.offset}
        if self.clips is not None:
            out["clips"] = list(self.clips)
        return out

    @staticmethod
    def of(only: Mapping[str, Any]) -> Region:
        """The region of `as_dict`, or of the same with `{value, stderr}` in place of each number."""

        def plain(entry: Any) -> Any:
            if not isinstance(entry, Mapping):
                return entry
            return plain(entry["value"]) if "value" in entry else {k: plain(v) for k, v in entry.items()}

        found = plain(only)
        parts = {k: v for k, v in found.items() if k not in ("within", "beyond", "clips")}
        if "within" in found:
            parts |= {"centre": tuple(found["within"]["center"]), "radius": found["within"]["radius"]}
        if "beyond" in found:
            parts |= {"normal": tuple(found["beyond"]["normal"]), "offset": found["beyond"]["offset"]}
        return Region(**parts, clips=tuple(found["clips"]) if "clips" in found else None)

    @property
    def words(self) -> str:
        """In words: "after 0.5 s, within 0.3 m of (0.35, 0.1, 0)"."""
        parts = [
            f"{k} {'than ' if unit == 'm/s' else ''}{getattr(self, k):.3g} {unit}"
            for k, unit in LIMITS.items()
            if getattr(self, k) is not None
        ]
        if self.centre is not None:
            parts.append(f"within {self.radius:.3g} m of ({', '.join(f'{v:.3g}' for v in self.centre)})")
        if self.normal is not None:
            terms = [f"{v:+.3g} {axis}" for v, axis in zip(self.normal, "xyz", strict=True) if abs(v) > 1e-6]
            parts.append(f"where {' '.join(terms)} > {self.offset:.3g} m")
        if self.clips is not None:
            parts.append(f"in {', '.join(self.clips)}")
        return ", ".join(parts) or "everywhere"
