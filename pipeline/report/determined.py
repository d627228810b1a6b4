"""How well clips determine their parameters, by kind of parameter, and whether the stated spreads hold."""

from __future__ import annotations

import re
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pipeline.report.tables import NONE, Table
from pipeline.scene.scene import Scene
from pipeline.search.certainty import DETERMINED

WITHIN = 2.0  # spreads
HEADER = [
    "parameter",
    "unit",
    "numbers",
    "determined",
    "median spread",
    "truth within two spreads",
    "95 % of truths within, spreads",
]
_PLACE = re.compile(r"objects\[(\d+)\]\.(\w+)(?:\[(\d+)\])?")


@dataclass
class KindSpreads:
    """The spreads of all parameters of one kind.

    Attributes:
        unit: Of the spreads; `factor` where a spread is a ratio.
        spreads: Of each parameter.
        shares: Each spread as a share of the spread of the parameter's bounds.
        errors: Distance from the truth in spreads, where the truth is known.
    """

    unit: str
    spreads: array[float] = field(default_factory=lambda: array("d"))
    shares: array[float] = field(default_factory=lambda: array("d"))
    errors: array[float] = field(default_factory=lambda: array("d"))

    def cells(self, name: str) -> list[str]:
        """The row of the table, in the columns of `HEADER`."""
        determined = np.mean(np.array(self.shares) < DETERMINED)
        covered = f"{np.mean(np.array(self.errors) < WITHIN):.2f} of {len(self.errors)}" if self.errors else NONE
        quantile = f"{np.quantile(self.errors, 0.95):.1f}" if self.errors else NONE
        return [
            name,
            self.unit,
            str(len(self.shares)),
            f"{determined:.2f}",
            f"{np.median(self.spreads):.3g}",
            covered,
            quantile,
        ]


def true_value(truth: Scene, place: str, shapes: Sequence[str], instances: Sequence[int]) -> float | None:
    """The true value of a parameter of a found scene; None where the two cannot be compared.

    Args:
        truth: The true scene.
        place: The parameter's place in the found scene, as `objects[0].velocity[1]` or `gravity`.
        shapes: Shapes of the found scene's objects.
        instances: For each of them the index of the true object, negative for none.

    Returns:
        None for another shape, an unmatched object, an orientation, or a box's size: its sides may be in another order.
    """
    camera = truth.camera
    assert camera is not None
    scene = {
        "camera.position[2]": camera.position[2],
        "camera.pitch": camera.pitch,
        "camera.fov": camera.fov,
        "gravity": -truth.gravity[2],
    }
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


def spreads_by_kind(
    clips: Iterable[tuple[Sequence[Mapping[str, Any]], Scene, Sequence[int], Scene | None]],
) -> dict[str, KindSpreads]:
    """The spreads of all clips by kind of parameter.

    Args:
        clips: Of each clip the rows of its `certainty`, the scene found, the true index of each of its objects, and the
            true scene, None where it is not known.
    """
    out: dict[str, KindSpreads] = {}
    for rows, found, instances, truth in clips:
        for row in rows:
            kind = out.setdefault(row["kind"], KindSpreads(row["unit"]))
            kind.spreads.append(row["spread"])
            kind.shares.append(row["share"])
            true = None if truth is None else true_value(truth, row["place"], found.shapes, instances)
            if true is None:
                continue
            if row["unit"] == "factor":
                kind.errors.append(abs(np.log(row["value"] / true)) / np.log(row["spread"]))
            else:
                kind.errors.append(abs(row["value"] - true) / row["spread"])
    return out


def determined_table(kinds: Mapping[str, KindSpreads]) -> Table:
    """A line per kind of parameter."""
    return HEADER, [kind.cells(name) for name, kind in kinds.items()]
