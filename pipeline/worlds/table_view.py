"""A table from above and aside: how its camera sees it, and the tracks of balls on it as if seen from straight above.

A ball's radius in the picture is inversely proportional to its depth, which falls along the picture's y axis on a plane
that the camera looks down at by the angle P: d(log radius)/dy = cot(P) / f. Where balls move across the picture only,
this says little, and the angle at which people film tables is assumed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.scene.scene import Camera
from pipeline.vision.rendering.camera import pinhole
from pipeline.worlds.blocks import DEPTH, Block
from pipeline.worlds.plane import Plane
from pipeline.worlds.view_evidence import LEAST_COT, MOST_COT, SIZE_ERROR, USUAL_COT, USUAL_SPREAD, Growth

LOWEST = 0.15  # sine of the angle between a line of sight and the table, below which a place is not known


@dataclass(frozen=True)
class TableView:
    """A level plane that a camera looks down at.

    Attributes:
        plane: The plane as seen from straight above, at the scale that it has in the middle of the picture.
        pitch_deg: By which the camera looks down.
        height: m, of the plane above the table: that of the centre of the largest ball.
    """

    plane: Plane
    pitch_deg: float
    height: float

    def camera(self) -> Camera:
        """The camera, with the table at height 0."""
        pitch = np.radians(self.pitch_deg)
        away = self.plane.distance
        return Camera(
            (0.0, -away * float(np.cos(pitch)), self.height + away * float(np.sin(pitch))),
            self.plane.fov_y_deg,
            pitch=-self.pitch_deg,
        )

    def to_ground(self, px: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Places (T, 2) m along x and y, at a height, m, that are seen at px (T, 2), and their depths (T,) m."""
        camera, plane = pinhole(self.camera()), self.plane
        off = (np.asarray(px, float) - [plane.width / 2, plane.height / 2]) / plane.focal
        ways = np.stack([off[:, 0], -off[:, 1], -np.ones(len(off))], 1) @ camera.rotation_world.T
        fall = np.maximum(-ways[:, 2], LOWEST)
        depth = (camera.position_world[2] - height) / fall
        return (camera.position_world + depth[:, None] * ways)[:, :2], depth

    def from_above(self, track: ImageTrack) -> tuple[ImageTrack, float]:
        """The track of a ball as if seen from straight above, and the ball's radius, m."""
        focal, radius = self.plane.focal, self.height
        for _ in range(3):
            _, depth = self.to_ground(track.centre, radius)
            radius = float(np.median((np.sqrt(track.area / np.pi) * depth / focal)[track.whole]))
        place, depth = self.to_ground(track.centre, radius)
        size = self.plane.px_per_m * depth / focal
        stretch = float(np.median(size)) / np.sin(np.radians(self.pitch_deg)) ** 0.5
        flat = replace(
            track,
            centre=self.plane.to_picture(place),
            axes=track.axes * size[:, None],
            area=track.area * size**2,
            sigma=track.sigma * stretch,
        )
        return flat, radius

    def block_from_above(self, block: Block) -> Block:
        """The footprint of a block that stands on the table: its lower edge is that of its near side."""
        left, right = block.corners[:, 0].min(), block.corners[:, 0].max()
        foot = block.corners[:, 1].max()
        (a, b), _ = self.to_ground(np.array([[left, foot], [right, foot]]), 0.0)
        away = DEPTH * np.array([a[1] - b[1], b[0] - a[0]])
        return Block(self.plane.to_picture(np.array([a, b, b + away, a + away])))


def slope_error(growth: Growth) -> float:
    """1/px, standard error of the growth, with what outlines err alike."""
    return float(np.hypot(growth.error, SIZE_ERROR / max(growth.way, 1.0)))


def table_view(plane: Plane, growth: Growth, tracks: Sequence[ImageTrack]) -> TableView:
    """How the camera sees a table.

    Args:
        plane: Level, with the scale that the middle of the picture has.
        growth: Of the bodies' outlines.
        tracks: Of the balls on it.
    """
    cot, error = plane.focal * growth.slope, plane.focal * slope_error(growth)
    weight, usual = error**-2, USUAL_SPREAD**-2
    cot = (weight * cot + usual * USUAL_COT) / (weight + usual)
    pitch = float(np.degrees(np.arctan(1 / np.clip(cot, LEAST_COT, MOST_COT))))
    largest = max(t.radius for t in tracks) / plane.px_per_m
    return TableView(plane, pitch, largest)
