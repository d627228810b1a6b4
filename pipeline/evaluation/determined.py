"""How far clips determine their parameters, summed up by kind, and whether the stated spreads hold."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.scene.scene import Scene
from pipeline.search.certainty import DETERMINED

WITHIN = 2.0  # spreads
HEADER = ["parameter", "unit", "numbers", "determined", "median spread", "truth within two spreads",
          "95 % of truths within, spreads"]  # fmt: skip
_PLACE = re.compile(r"objects\[(\d+)\]\.(\w+)(?:\[(\d+)\])?")


@dataclass
class Kind:
    """All numbers of a kind: spreads, shares of ignorance, distances from the truth in spreads where it is known."""

    unit: str
    spreads: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)
    distances: list[float] = field(default_factory=list)

    def cells(self, name: str) -> list[str]:
        told = f"{np.mean(np.array(self.distances) < WITHIN):.2f} of {len(self.distances)}" if self.distances else "–"
        known = np.mean(np.array(self.shares) < DETERMINED)
        spread = f"{np.median(self.spreads):.3g}"
        most = f"{np.quantile(self.distances, 0.95):.1f}" if self.distances else "–"
        return [name, self.unit, str(len(self.shares)), f"{known:.2f}", spread, told, most]


def true_value(truth: Scene, place: str, shapes: Sequence[str], instances: Sequence[int]) -> float | None:
    """What `truth` has at a place of a found scene, whose objects have `shapes` and are `instances` of the truth; None
    where the two cannot be compared: another shape, or a box, whose sizes may be called in another order."""
    camera = truth.camera
    assert camera is not None
    scene = {"camera.position[2]": camera.position[2], "camera.pitch": camera.pitch, "camera.fov": camera.fov,
             "gravity": -truth.gravity[2]}  # fmt: skip
    match = _PLACE.fullmatch(place)
    if match is None:
        return scene.get(place)
    number, name, part = int(match[1]), match[2], match[3]
    if instances[number] < 0 or name == "orientation":
        return None
    obj = truth.objects[instances[number]]
    if name == "size" and (obj.shape != shapes[number] or obj.shape == "box"):
        return None
    value = getattr(obj, name)
    return float(value[int(part)] if part is not None else value)


def by_kind(clips: Sequence[tuple[Sequence[Mapping[str, Any]], Scene, Sequence[int], Scene | None]]) -> dict[str, Kind]:
    """Clips as (certainties, the scene found, instance of each of its objects, the true scene or None)."""
    out: dict[str, Kind] = {}
    for rows, found, instances, truth in clips:
        for row in rows:
            kind = out.setdefault(row["kind"], Kind(row["unit"]))
            kind.spreads.append(row["spread"])
            kind.shares.append(row["share"])
            true = None if truth is None else true_value(truth, row["place"], found.shapes, instances)
            if true is None:
                continue
            if row["unit"] == "factor":
                kind.distances.append(abs(np.log(row["value"] / true)) / np.log(row["spread"]))
            else:
                kind.distances.append(abs(row["value"] - true) / row["spread"])
    return out


def table(kinds: Mapping[str, Kind]) -> tuple[list[str], list[list[str]]]:
    """Header and a row for each kind."""
    return HEADER, [kind.cells(name) for name, kind in kinds.items()]
