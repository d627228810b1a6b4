"""The standard deviation of each parameter of a fitted scene, from the curvature of the cost (Laplace approximation).

The covariance is (J'J / s² + prior)⁻¹, with the Jacobian J of the pooled residuals, their unexplained variance s², and
the precision of a uniform prior over the bounds of each parameter. A parameter that the clip does not constrain, such
as the mass of a body without collisions, keeps the standard deviation of its bounds. One camera does not determine the
absolute scale, which has a prior of its own. The errors of a search are larger than the curvature predicts, because
parameters compensate each other (a wrong pitch of the camera, for example), by a factor that was measured per kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scene.scene import Scene
from pipeline.search.evaluator import Evaluator
from pipeline.search.gauss_newton import evaluate, linearise
from pipeline.search.parameters import Key, Space, search_space

INDEPENDENT = 3.0  # effective number of independent residuals per object and frame
UNITS = {
    "camera_height": "m", "camera_pitch": "deg", "camera_turn": "rad", "fov": "deg", "gravity": "m/s^2",
    "gravity_along": "m/s^2", "size": "m", "log_mass": "factor", "sliding_friction": "-", "rolling_friction": "m",
    "damping": "-", "position": "m", "velocity": "m/s", "angular_velocity": "rad/s", "turn": "rad",
}  # fmt: skip
SCALE = 0.5  # standard deviation of the logarithm of the absolute scale
#: Factor from the standard deviation by curvature to the actual one, calibrated on 72 clips of suite id (seed 9). With
#: about half the last column of reports/determined.md, 95 % of the truths are within two of them (docs/decisions.md).
INFLATION = {
    "camera_height": 1.0, "camera_pitch": 17.0, "camera_turn": 17.0, "fov": 8.5, "gravity": 1.2, "gravity_along": 2.0,
    "size": 1.0, "log_mass": 1.2, "sliding_friction": 9.7, "rolling_friction": 6.0, "damping": 5.4, "position": 1.0,
    "velocity": 1.8, "angular_velocity": 3.4, "turn": 3.4,
}  # fmt: skip
assert INFLATION.keys() == UNITS.keys()
DETERMINED = 0.5  # share of the prior standard deviation below which a parameter is identified
PRIOR_PRECISION = 12.0  # of a uniform distribution over a range of 1
_PLACES = {"log_mass": "mass", "turn": "orientation"}


@dataclass(frozen=True)
class Certainty:
    """The value and standard deviation of one number of a scene.

    Attributes:
        place: Its path, such as `objects[0].velocity[1]`.
        kind: Its name, such as `velocity`.
        value: In `unit`.
        spread: Standard deviation in `unit`; of a mass, the factor of one standard deviation.
        unit: Its unit.
        share: Standard deviation over that of the prior.
    """

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
    """Values and standard deviations of all parameters of a fitted scene.

    It needs as many simulations as one linearisation. For an orientation it gives three angles (two of a cylinder)
    about the fitted one, with value 0.

    Args:
        evaluator: Of the target.
        scene: The fitted scene.
        pairs: (P, 2) objects of the scene and instances of the target.
    """
    space = search_space(scene)
    x = space.encode()
    values, (point,) = evaluate(evaluator, space, x[None], pairs, None)
    linear = linearise(evaluator, space, x, values[0], pairs, None)
    variance = max(float(point.cost.sum()), 1e-6) / (INDEPENDENT * len(evaluator.target.masks) * max(len(pairs), 1))
    along = scale_direction(space)
    information = remove_information(linear.normal_matrix() / variance, along) + PRIOR_PRECISION * np.eye(len(x))
    known = 1 / float(along @ information @ along)  # variance of the scale if all else is fixed
    inflation = np.array([INFLATION[key.name] for key in space.keys])
    variances = inflation**2 * np.diag(np.linalg.inv(information)) + max(SCALE**2 - known, 0.0) * along**2
    deviation = np.minimum(np.sqrt(variances), PRIOR_PRECISION**-0.5)
    numbers = x * space.span + space.low
    return [_certainty(key, number, s * span, s * np.sqrt(PRIOR_PRECISION))
            for key, number, s, span in zip(space.keys, numbers, deviation, space.span, strict=True)]  # fmt: skip


def scale_direction(space: Space) -> np.ndarray:
    """Derivative of the coordinates (D,) by the logarithm of the world's scale about the camera.

    Such a change of scale changes no picture.
    """
    camera = space.start.camera
    assert camera is not None
    out = np.zeros(len(space.keys))
    for d, key in enumerate(space.keys):
        if key.name in ("camera_height", "gravity", "gravity_along", "size", "velocity"):
            out[d] = space.value(key)
        elif key.name == "position":
            out[d] = space.value(key) - (camera.position[key.part] if key.part < 2 else 0.0)
    return out / space.span


def remove_information(information: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """The information matrix (D, D) without information along a direction (D,).

    Finite differences of pixel counts leave some there, which is an artefact.
    """
    projected = information @ direction
    return information - np.outer(projected, projected) / max(float(direction @ projected), 1e-12)


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
    return Certainty(place=place, kind=kind, value=float(number), spread=float(spread), unit=unit, share=float(share))


def weakly_identified(parameters: Sequence[Certainty]) -> list[str]:
    """The kinds of parameters of which less than half are identified by the clip."""
    kinds: dict[str, list[bool]] = {}
    for c in parameters:
        kinds.setdefault(c.kind, []).append(c.determined)
    return [kind for kind, known in kinds.items() if sum(known) < len(known) / 2]
