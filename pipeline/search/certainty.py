"""How far a clip determines each parameter of a scene that was found: from the curvature of its cost there.

The residuals J of Gauss-Newton, with noise as large as what the scene leaves unexplained, and a uniform prior over
each parameter's bounds give the covariance (J'J / s² + prior)⁻¹ (Laplace's approximation). What the clip says nothing
about, as the masses of bodies that meet nothing, keeps the spread of its bounds. The absolute scale, about which one
camera says nothing, is given a spread of its own. A search ends beside the truth by more than the curvature there
tells (another pitch of the camera is made up for by everything else), by a factor that was measured for each kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.gauss_newton import evaluate, slope
from pipeline.search.parameters import Key, Space, search_space

INDEPENDENT = 3.0  # residuals of an object in a frame that count as independent
UNITS = {
    "camera_height": "m", "camera_pitch": "deg", "camera_turn": "rad", "fov": "deg", "gravity": "m/s^2",
    "gravity_along": "m/s^2", "size": "m", "log_mass": "factor", "sliding_friction": "-", "rolling_friction": "m",
    "damping": "-", "position": "m", "velocity": "m/s", "angular_velocity": "rad/s", "turn": "rad",
}  # fmt: skip
SCALE = 0.5  # standard deviation of the logarithm of the absolute scale
#: By how much spreads are larger than the curvature tells. Calibrated on 72 clips of suite id (seed 9): times about
#: half of the last column of reports/determined.md, 95 % of the truths lie within two spreads (docs/decisions.md).
INFLATION = {
    "camera_height": 1.0, "camera_pitch": 17.0, "camera_turn": 17.0, "fov": 8.5, "gravity": 1.2, "gravity_along": 2.0,
    "size": 1.0, "log_mass": 1.2, "sliding_friction": 9.7, "rolling_friction": 6.0, "damping": 5.4, "position": 1.0,
    "velocity": 1.8, "angular_velocity": 3.4, "turn": 3.4,
}  # fmt: skip
assert INFLATION.keys() == UNITS.keys()
DETERMINED = 0.5  # of the spread of not knowing, below which a clip says something of a parameter
IGNORANCE = 12.0  # 1 / variance of a uniform distribution over a range of 1
_PLACES = {"log_mass": "mass", "turn": "orientation"}


@dataclass(frozen=True)
class Certainty:
    """One number of a scene. place: as `objects[0].velocity[1]`; kind: its name alone; value; spread: standard
    deviation in `unit` (of a mass: the factor by which it may be off); share: spread over that of not knowing."""

    place: str
    kind: str
    value: float
    spread: float
    unit: str
    share: float

    @property
    def determined(self) -> bool:
        return self.share < DETERMINED


def certainties(evaluator: Evaluator, scene: Scene, pairs: np.ndarray) -> list[Certainty]:
    """Those of all parameters of a scene that was searched for, whose objects are the target's instances as in `pairs`
    (P, 2); costs a step of Gauss-Newton in simulations.

    Of an orientation it gives the three (two of a cylinder) angles by which it may be turned, with value 0.
    """
    space = search_space(scene)
    x = space.encode()
    values, (point,) = evaluate(evaluator, space, x[None], pairs, None)
    there = slope(evaluator, space, x, values[0], pairs, None)
    variance = max(float(point.cost.sum()), 1e-6) / (INDEPENDENT * len(evaluator.target.masks) * max(len(pairs), 1))
    along = scale_direction(space)
    information = without(there.normal_matrix() / variance, along) + IGNORANCE * np.eye(len(x))
    known = 1 / float(along @ information @ along)  # variance of the scale where all else is held
    inflation = np.array([INFLATION[key.name] for key in space.keys])
    variances = inflation**2 * np.diag(np.linalg.inv(information)) + max(SCALE**2 - known, 0.0) * along**2
    deviation = np.minimum(np.sqrt(variances), IGNORANCE**-0.5)
    numbers = x * space.span + space.low
    return [_certainty(key, number, s * span, s * np.sqrt(IGNORANCE))
            for key, number, s, span in zip(space.keys, numbers, deviation, space.span, strict=True)]  # fmt: skip


def scale_direction(space: Space) -> np.ndarray:
    """How the coordinates (D,) change as the world grows about the camera, which changes no picture."""
    camera = space.start.camera
    assert camera is not None
    out = np.zeros(len(space.keys))
    for d, key in enumerate(space.keys):
        if key.name in ("camera_height", "gravity", "gravity_along", "size", "velocity"):
            out[d] = space.value(key)
        elif key.name == "position":
            out[d] = space.value(key) - (camera.position[key.part] if key.part < 2 else 0.0)
    return out / space.span


def without(information: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Information (D, D) that says nothing along a direction (D,), as differences of counted pixels seem to."""
    pulled = information @ direction
    return information - np.outer(pulled, pulled) / max(float(direction @ pulled), 1e-12)


def _certainty(key: Key, number: float, spread: float, share: float) -> Certainty:
    kind = _PLACES.get(key.name, key.name)
    unit = UNITS[key.name]
    if key.name == "log_mass":
        number, spread = float(np.exp(number)), float(np.exp(spread))
    if key.index < 0:
        place = {"camera_height": "camera.position[2]", "camera_pitch": "camera.pitch", "fov": "camera.fov",
                 "camera_turn": f"camera.orientation[{key.part}]"}.get(key.name, "gravity")  # fmt: skip
    else:
        vector = key.name in ("size", "position", "velocity", "angular_velocity", "turn")
        place = f"objects[{key.index}].{kind}" + (f"[{key.part}]" if vector else "")
    return Certainty(place, kind, float(number), float(spread), unit, float(share))


def hardly(found: Sequence[Certainty]) -> list[str]:
    """The kinds of numbers of which the clip determines less than half."""
    kinds: dict[str, list[bool]] = {}
    for c in found:
        kinds.setdefault(c.kind, []).append(c.determined)
    return [kind for kind, known in kinds.items() if sum(known) < len(known) / 2]
