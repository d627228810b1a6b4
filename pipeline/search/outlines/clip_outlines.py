"""The outlines of all instances of a clip."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pipeline.scene.scene import Camera
from pipeline.search.outlines.contour import Contour, instance_contour
from pipeline.search.outlines.shape_evidence import ShapeEvidence, shape_evidence
from pipeline.vision.rendering.camera import focal_px, pinhole


@dataclass(frozen=True)
class ClipOutlines:
    """Masks at the size at which outlines are compared, which may be larger than that of the search's target.

    Attributes:
        masks: (F, H, W) uint8, j + 1 for instance j, 0 for the background.
        times: (F,) s.
        instances: Number of instances.
    """

    masks: np.ndarray
    times: np.ndarray
    instances: int

    @property
    def height(self) -> int:
        return self.masks.shape[1]

    @cached_property
    def contours(self) -> tuple[Contour, ...]:
        """Of each instance."""
        return tuple(instance_contour(self.masks, j) for j in range(self.instances))

    def evidence(self, camera: Camera) -> list[ShapeEvidence]:
        """Of each instance, which shape it has. camera: a usual one, with a pitch."""
        focal, upright = focal_px(camera.fov, self.height), pinhole(camera).rotation_world.T
        return [shape_evidence(contour, self.times, focal, upright) for contour in self.contours]
