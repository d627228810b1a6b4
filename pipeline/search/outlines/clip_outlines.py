"""The outlines of all instances of a clip, and the solids that are registered to them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.search.guess import usual_camera
from pipeline.search.outlines.contour import Contour, instance_contour
from pipeline.search.outlines.rigid_flow import replace_flow
from pipeline.search.outlines.shape_evidence import LEAST_PROBABILITY, UNIFORM, ShapeEvidence, shape_evidence
from pipeline.search.outlines.spin import with_seen_turns
from pipeline.search.target import resize_masks
from pipeline.vision.rendering.camera import focal_px, pinhole

#: Errors of flow, in those of usual measured flow: of a known rigid motion, and of a round body without texture.
RIGID_ERROR, UNSEEN_ERROR = 0.4, 4.0


@dataclass(frozen=True)
class ClipOutlines:
    """Masks at the size at which outlines are compared, which may be larger than that of the search's target.

    Attributes:
        masks: (F, H, W) uint8, j + 1 for instance j, 0 for the background.
        times: (F,) s.
        instances: Number of instances.
        pictures: (F, h, w, 3) uint8 of the same frames, of any size; None where they are not known. They show how
            round bodies turn.
        shape_prior: (M, 3) probability of each of `BASIC_SHAPES` by the network for shapes; None: not known.
    """

    masks: np.ndarray
    times: np.ndarray
    instances: int
    pictures: np.ndarray | None = None
    shape_prior: np.ndarray | None = None

    @property
    def height(self) -> int:
        return self.masks.shape[1]

    @cached_property
    def contours(self) -> tuple[Contour, ...]:
        """Of each instance."""
        return tuple(instance_contour(self.masks, j) for j in range(self.instances))

    @cached_property
    def evidence(self) -> tuple[ShapeEvidence, ...]:
        """Of each instance, which shape it has, and the fits of likely shapes with the rotation that pictures show."""
        camera = usual_camera(self.masks.shape[2], self.height)
        focal, upright = focal_px(camera.fov, self.height), pinhole(camera).rotation_world.T
        priors = [UNIFORM] * self.instances if self.shape_prior is None else self.shape_prior
        found = [
            shape_evidence(contour, self.times, focal, upright, prior)
            for contour, prior in zip(self.contours, priors, strict=True)
        ]
        if self.pictures is None:
            return tuple(found)
        for instance, evidence in enumerate(found):
            for shape, fit in evidence.registrations.items():
                if evidence.probability[shape] >= LEAST_PROBABILITY:
                    evidence.registrations[shape] = with_seen_turns(fit, self.masks, instance, self.pictures)
        return tuple(found)

    @property
    def flow_errors(self) -> np.ndarray:
        """(M,) error of the flow of each instance from `rigid_flow`, in errors of usual measured flow.

        Where pictures do not show how a round body turns, measured flow tells less than usual: it is mostly that of the
        body's shading, which does not turn.
        """
        out = np.ones(self.instances)
        for instance, evidence in enumerate(self.evidence):
            if evidence.registrations:
                best = evidence.registrations[evidence.ranked[0]]
                if len(best.turns_seen) and best.turns_seen.all():
                    out[instance] = RIGID_ERROR
                elif self.pictures is not None and best.shape != "box":
                    out[instance] = UNSEEN_ERROR
        return out

    def rigid_flow(self, flow: np.ndarray, pairs: np.ndarray) -> np.ndarray:
        """Measured flow (P, h, w, 2) of pairs (P, 2) of frames, with the rigid motion of bodies where it is known."""
        height, width = flow.shape[1:3]
        small = resize_masks(self.masks[pairs[:, 0]], width, height)
        for instance, evidence in enumerate(self.evidence):
            if evidence.registrations:
                best = evidence.registrations[evidence.ranked[0]]
                flow = replace_flow(flow, small == instance + 1, best, pairs, self.masks.shape[2])
        return flow
