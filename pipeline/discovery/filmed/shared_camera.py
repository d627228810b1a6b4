"""The camera of several clips, from the apparent sizes of bodies of known size in a plane. No physics is assumed.

A body's depth shows in the size of its outline, so that all outlines together tell how the plane in which bodies move
lies before the camera: the ground (a table), or a vertical plane (bodies that fly and bounce, from the side). What they
do not tell well keeps a wide prior, and the covariance says so.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.discovery.filmed.body_matching import apparent_radius
from pipeline.errors import MeasurementError
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_from_rotation_vector, quaternion_multiply
from pipeline.scene.scene import Camera, SceneObject, half_extents
from pipeline.worlds.plane import FOV_DEG
from pipeline.worlds.tilt import INDEPENDENT

FOV_SPREAD = 0.2  # of the logarithm of the focal length, about that of FOV_DEG
GROUND, UPRIGHT = "ground", "upright"
SIZE_SIGMA = 0.01  # relative: outlines err alike over a whole track
EDGE_SIGMA = 0.4  # px, by which outlines may be too wide everywhere
RADIUS_SIGMA = 0.25  # px, of one outline's radius
LOWEST = 0.05  # sine of the angle between a line of sight and the plane, below which a place is not known
#: Numbers of the camera with their usual values and spreads: logarithm of the focal length over the picture's longer
#: side, pitch, yaw and roll (rad), logarithm of the distance from the plane's point in the middle of the picture (m).
USUAL = {
    GROUND: (np.array([np.nan, np.radians(-38), 0.0, 0.0, np.nan]), np.array([FOV_SPREAD, 0.35, 1e-6, 0.02, 3.0])),
    UPRIGHT: (np.array([np.nan, np.radians(-3), 0.0, 0.0, np.nan]), np.array([FOV_SPREAD, 0.08, 0.06, 0.015, 3.0])),
}


@dataclass(frozen=True)
class SharedCamera:
    """One camera for all clips.

    Attributes:
        plane: `GROUND`: bodies rest on z = 0; `UPRIGHT`: they move in the plane y = 0.
        numbers: (5,) as `USUAL`.
        covariance: (5, 5) of the numbers.
        width: px, of the picture.
        height: px.
        lift: m, added to z in an upright plane, so that the ground is at its height.
    """

    plane: str
    numbers: np.ndarray
    covariance: np.ndarray
    width: int
    height: int
    lift: float = 0.0

    @property
    def focal(self) -> float:
        """px."""
        return float(np.exp(self.numbers[0])) * max(self.width, self.height)

    @property
    def deviations(self) -> np.ndarray:
        """(5, K) changes of the numbers by one standard deviation of each independent one."""
        values, vectors = np.linalg.eigh(self.covariance)
        return vectors[:, values > 1e-10] * np.sqrt(values[values > 1e-10])

    @property
    def orientation(self) -> np.ndarray:
        """(4,) quaternion of the frame with x right and y up, looking along -z."""
        _, pitch, yaw, roll, _ = self.numbers
        out = quaternion_from_rotation_vector(yaw * np.array([0.0, 0, 1]))
        for angle, axis in ((np.pi / 2 + pitch, np.array([1.0, 0, 0])), (roll, np.array([0.0, 0, 1]))):
            out = quaternion_multiply(out, quaternion_from_rotation_vector(angle * axis))
        return np.asarray(out)

    @property
    def position(self) -> np.ndarray:
        """(3,) m."""
        back = matrix_from_quaternion(self.orientation)[:, 2]
        return np.exp(self.numbers[4]) * back + [0, 0, self.lift]

    @property
    def camera(self) -> Camera:
        """The camera of a scene."""
        fov = 2 * np.degrees(np.arctan(self.height / 2 / self.focal))
        return Camera(tuple(map(float, self.position)), float(fov), orientation=tuple(map(float, self.orientation)))

    def moved(self, sigmas: np.ndarray) -> SharedCamera:
        """The camera whose numbers are off by so many of the standard deviations (K,)."""
        return replace(self, numbers=self.numbers + self.deviations @ sigmas)

    def places(self, px: np.ndarray, height: float) -> tuple[np.ndarray, np.ndarray]:
        """Where the centre of a body is that is seen at px (T, 2): (T, 3) m, and its depth (T,) m.

        height: m, of its centre over the ground; of bodies in an upright plane it does not matter.
        """
        turn = matrix_from_quaternion(self.orientation)
        off = (np.asarray(px, float) - [self.width / 2, self.height / 2]) / self.focal
        ways = np.stack([off[:, 0], -off[:, 1], -np.ones(len(off))], 1) @ turn.T
        away = self.position
        if self.plane == GROUND:
            depth = (away[2] - height) / np.maximum(-ways[:, 2], LOWEST)
        else:
            depth = -away[1] / np.maximum(ways[:, 1], LOWEST)
        return away + depth[:, None] * ways, depth

    def centre_places(self, track: ImageTrack, obj: SceneObject) -> tuple[np.ndarray, np.ndarray]:
        """`places` of the centre of a body, which is where its track is."""
        return self.places(track.centre, float(half_extents(obj)[2]))

    def radii(self, track: ImageTrack, obj: SceneObject) -> np.ndarray:
        """(T,) px: radius of the disc with the area of the outline that the body should have."""
        place, depth = self.centre_places(track, obj)
        half = half_extents(obj)
        away = place - self.position
        far = np.linalg.norm(away, axis=1)
        if obj.shape == "sphere":
            outer = np.maximum(depth**2 - half[0] ** 2, 1e-9)
            stretch = ((far**2 - half[0] ** 2) / outer) ** 0.25
            return np.asarray(self.focal * half[0] / np.sqrt(outer) * stretch)
        if obj.shape == "cylinder" and self.plane == GROUND:
            rise = -away[:, 2] / far
            area = np.pi * half[0] ** 2 * rise + 4 * half[0] * half[2] * np.sqrt(np.maximum(1 - rise**2, 0))
            return np.asarray(self.focal * np.sqrt(area / np.pi) / depth)
        return np.asarray(self.focal * apparent_radius(obj) / depth)


def fit_camera(
    tracks: Sequence[Mapping[str, ImageTrack]],
    objects: Sequence[SceneObject],
    plane: str,
    width: int,
    height: int,
) -> SharedCamera:
    """The camera that the sizes of outlines tell of.

    Args:
        tracks: For each clip, by name of the object.
        objects: With known sizes.
        plane: `GROUND` or `UPRIGHT`.
        width: px, of the picture.
        height: px.

    Raises:
        MeasurementError: Where no body is seen in two frames.
    """
    bodies = {o.name: o for o in objects}
    seen = [(t.part(t.whole), bodies[name]) for clip in tracks for name, t in clip.items() if t.whole.sum() > 1]
    if not seen:
        raise MeasurementError(
            "no outline in the clips fits a body of the scene; check its shapes and sizes, and the masks"
        )
    usual, spread = (a.copy() for a in USUAL[plane])
    usual[0] = -np.log(2 * np.tan(np.radians(FOV_DEG) / 2))
    guesses = [bodies_depth(t, o, np.exp(usual[0]) * max(width, height)) for t, o in seen]
    usual[4] = np.log(np.median(guesses))
    start = SharedCamera(plane, usual, np.eye(5), width, height)

    def misses(x: np.ndarray) -> np.ndarray:
        camera, edge = replace(start, numbers=usual + spread * x[:5]), EDGE_SIGMA * x[5]
        rows = [x]
        for number, (track, obj) in enumerate(seen):
            measured = np.sqrt(track.area / np.pi) - edge
            off = (
                np.log(np.maximum(measured, 0.5) / np.maximum(camera.radii(track, obj), 0.5))
                - SIZE_SIGMA * x[6 + number]
            )
            weight = np.sqrt(min(INDEPENDENT / len(track), 1.0))
            rows.append(weight * _tamed(off * measured / RADIUS_SIGMA))
        return np.concatenate(rows)

    found = least_squares(misses, np.zeros(6 + len(seen)), method="trf", x_scale="jac", max_nfev=60)
    covariance = np.linalg.inv(found.jac.T @ found.jac)[:5, :5] * np.outer(spread, spread)
    return replace(start, numbers=usual + spread * found.x[:5], covariance=covariance)


def bodies_depth(track: ImageTrack, obj: SceneObject, focal: float) -> float:
    """m: the median depth of a body by the size of its outline. focal: px."""
    return float(np.median(focal * apparent_radius(obj) / np.sqrt(track.area / np.pi)))


def _tamed(off: np.ndarray) -> np.ndarray:
    """Residuals whose squares grow linearly beyond 2 (Huber), since some outlines are cut or joined."""
    size = np.abs(off)
    return np.asarray(np.where(size <= 2, off, np.sign(off) * np.sqrt(np.maximum(4 * size - 4, 0))))
