"""What fixes the scale of a clip: gravity, a known length, or nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.worlds.silhouette import Silhouette
from pipeline.worlds.tilt import Tilt
from pipeline.worlds.view import View, common_acceleration

GRAVITY = 9.81  # m/s²
KNOWN = ("length", "size", "board")  # what a user says of the scale
RELATIVE_RADIUS = 0.05  # m, of the largest body where nothing fixes the scale
SLIDING_FRICTION = 0.3  # of a box on an incline whose scale is not known
#: Acceleration of a solid body that rolls down an incline, over that of one that slides without friction.
ROLLING = {"sphere": 5 / 7, "cylinder": 2 / 3}


@dataclass(frozen=True)
class Scale:
    """The scale of the plane in which bodies move.

    Attributes:
        px_per_m: px of the picture.
        by: "gravity", "length", "size", "board" or "none", as result.json says it.
        error: Standard error, as a share.
        ends: (2, 2) px, the two points whose distance gave it; None where it holds for the middle of the picture.
    """

    px_per_m: float
    by: str
    error: float
    ends: np.ndarray | None = None

    def seen_straight(self, tilt: Tilt) -> Scale:
        """The scale in the picture of a camera that looks straight at the plane."""
        if self.ends is None:
            return self
        before, after = (float(np.linalg.norm(p[1] - p[0])) for p in (self.ends, tilt.straight(self.ends)))
        return replace(self, px_per_m=self.px_per_m * after / before)


def find_scale(view: View, silhouettes: Sequence[Silhouette], gravity: float = GRAVITY) -> Scale:
    """The scale that gravity gives where bodies fall or speed up on a slope; else lengths are relative.

    On a slope a round body is taken to roll and to be solid, another to slide with a friction of SLIDING_FRICTION.
    Where there are round ones, only these count.
    """
    if view.gravity_px is not None:
        size = float(np.linalg.norm(view.gravity_px))
        return Scale(size / gravity, "gravity", max(view.gravity_error, 0.02))
    if view.kind == "incline":
        arcs = [m for m in view.arcs if m.kind == "slope"]
        shapes = dict(zip(dict.fromkeys(m.arc.body for m in view.arcs), (s.shape for s in silhouettes), strict=True))
        rolling = [m for m in arcs if shapes[m.arc.body] in ROLLING]
        arcs = rolling or arcs
        weights = [m.sigma**-2 for m in arcs]
        slope = np.radians(abs(view.slope_deg))
        least = np.sin(slope) - min(SLIDING_FRICTION, 0.5 * np.tan(slope)) * np.cos(slope)
        pushes = [np.sin(slope) * ROLLING[shapes[m.arc.body]] if rolling else least for m in arcs]
        size = float(np.linalg.norm(common_acceleration(arcs)))
        size = max(size, arcs[0].sigma)
        push = float(np.average(pushes, weights=weights))
        return Scale(size / (gravity * push), "gravity", 0.15 if rolling else 0.3)
    largest = max((s.width for s in silhouettes), default=1.0) / 2
    return Scale(largest / RELATIVE_RADIUS, "none", float("inf"))
