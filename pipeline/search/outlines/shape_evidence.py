"""Which shape each instance has, by how well each shape fits its outlines."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.scene.scene import BASIC_SHAPES
from pipeline.search.outlines.contour import POINTS, Contour
from pipeline.search.outlines.registration import Registration, register

#: Free parameters of each shape: sizes, and where it has one, an orientation and an angular velocity that show.
PARAMETERS = {"sphere": 1, "cylinder": 6, "box": 9}
CORRELATED = 16.0  # points of an outline that count as one independent observation: masks that were found err alike
LEAST_PROBABILITY = 0.05  # of a shape that is tried, relative to the most probable
FLOOR = 0.05  # least mean square of the residuals: finer differences than outlines between pixels can tell
UNIFORM = np.full(len(BASIC_SHAPES), 1 / len(BASIC_SHAPES))
assert PARAMETERS.keys() == set(BASIC_SHAPES)


@dataclass(frozen=True)
class ShapeEvidence:
    """The fits of all shapes to one instance.

    Attributes:
        registrations: The fit of each shape; empty where the instance has no outline.
        probability: Of each shape.
    """

    registrations: dict[str, Registration]
    probability: dict[str, float]

    @property
    def ranked(self) -> list[str]:
        """Shapes, the most probable first."""
        return sorted(self.probability, key=lambda shape: -self.probability[shape])


def shape_evidence(
    contour: Contour, times: np.ndarray, focal: float, upright: np.ndarray, shape_prior: np.ndarray = UNIFORM
) -> ShapeEvidence:
    """Fit every basic shape to the outlines of an instance.

    Args:
        contour: The outlines.
        times: (F,) of the clip's frames, s.
        focal: Usual focal length, px.
        upright: (3, 3) from the world frame (z up) to the camera frame, as far as it is known.
        shape_prior: (3,) probabilities of `BASIC_SHAPES` before its outlines are seen.
    """
    if not len(contour.frames):
        return ShapeEvidence({}, dict(zip(BASIC_SHAPES, map(float, shape_prior), strict=True)))
    fits = {shape: register(contour, shape, times, focal, upright) for shape in BASIC_SHAPES}
    costs = np.array([fits[shape].cost for shape in BASIC_SHAPES])
    points = max(fits[BASIC_SHAPES[0]].points, 1)
    free = np.array([PARAMETERS[shape] for shape in BASIC_SHAPES])
    both = np.array(probabilities(costs, points, free)) * shape_prior
    return ShapeEvidence(fits, dict(zip(BASIC_SHAPES, (both / both.sum()).tolist(), strict=True)))


def probabilities(costs: np.ndarray, points: int, parameters: np.ndarray) -> list[float]:
    """Probabilities (S,) of shapes by Schwarz's criterion, with a common unknown noise.

    Args:
        costs: (S,) sums of squared residuals, in units of the usual noise.
        points: How many residuals each has.
        parameters: (S,) free parameters.
    """
    independent = max(points / CORRELATED, 2.0)
    mean_square = np.clip(costs / points, FLOOR, 1e9)
    criterion = 0.5 * independent * np.log(mean_square) + 0.5 * parameters * np.log(independent)
    weight = np.exp(criterion.min() - criterion)
    return [float(w) for w in weight / weight.sum()]


def joint_probabilities(evidence: Sequence[ShapeEvidence], most: int) -> list[tuple[tuple[str, ...], float]]:
    """The most probable shapes of all instances, best first, with their probabilities; at most `most`."""
    beams: list[tuple[tuple[str, ...], float]] = [((), 1.0)]
    for each in evidence:
        grown = [((*shapes, s), p * q) for shapes, p in beams for s, q in each.probability.items()]
        beams = sorted(grown, key=lambda beam: -beam[1])[: max(most, 1)]
    return beams


assert POINTS > CORRELATED
