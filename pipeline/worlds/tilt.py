"""By how much a camera is turned from where it would look straight at the plane in which bodies move.

Such a camera sees what a straight one would see through a homography, f K R K^-1 (Hartley and Zisserman, "Multiple view
geometry in computer vision", section 8.4): bodies look smaller where the plane is further away, and free flight departs
from a parabola. Both tell the turn; where they do not determine it, there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc, design
from pipeline.worlds.bounces import changes_between
from pipeline.worlds.silhouette import Silhouette
from pipeline.worlds.view import LEAST_SIZES, View

SPREAD_DEG = 6.0  # of pitch and yaw, as people film
DETERMINED = 0.25  # of that spread: a larger standard error does not determine the turn
MOST_DEG = 25.0
SIZE_ERROR = 0.05  # of the logarithm of a size, over the way: shading and blur differ between places
OFF_SIZE = 0.2  # share of a disc's median width, by which an outline is wrong
LEAST_SIGMA = 0.3  # px, of a centre
SYSTEMATIC, INDEPENDENT = 0.02, 4  # radii: errors of outlines that are alike in neighbouring frames; such in one track
#: Deceleration by the air over the square of the speed, times the radius: 3/8 of the drag coefficient (0.47) times the
#: density of air over that of the body. A tennis ball has 6e-4.
DRAG = 5e-4
LEAST_FLIGHT = 8  # frames


@dataclass(frozen=True)
class Tilt:
    """A turn of the camera about the x axis of its picture, then about its y axis.

    Attributes:
        pitch: rad; what is lower in the picture is further away where it is positive: the camera looks down.
        yaw: rad; what is further to the right is further away where it is positive: the camera is turned to the right.
        focal: px.
        middle: (2,) px, the middle of the picture.
    """

    pitch: float
    yaw: float
    focal: float
    middle: tuple[float, float]

    @property
    def none(self) -> bool:
        return not (self.pitch or self.yaw)

    @property
    def rotation(self) -> np.ndarray:
        """(3, 3), from the camera's frame (x right, y down, z ahead) to that of a camera that looks straight."""
        return Rotation.from_euler("xy", [-self.pitch, self.yaw]).as_matrix()

    def rays(self, px: np.ndarray) -> np.ndarray:
        """(..., 3) rays through (..., 2) px, whose depth is 1 in the camera's frame, in that of a camera that looks
        straight."""
        off = (np.asarray(px, float) - self.middle) / self.focal
        return np.asarray(np.concatenate([off, np.ones((*off.shape[:-1], 1))], -1) @ self.rotation.T)

    def straight(self, px: np.ndarray) -> np.ndarray:
        """(..., 2) px, where a camera that looks straight sees what this one sees at (..., 2) px."""
        rays = self.rays(px)
        return self.focal * rays[..., :2] / rays[..., 2:] + self.middle

    def growth(self, px: np.ndarray) -> np.ndarray:
        """(...) factor by which lengths near (..., 2) px are larger to a camera that looks straight: the root of the
        homography's determinant."""
        return np.asarray(self.rays(px)[..., 2] ** -1.5)

    def straight_track(self, track: ImageTrack) -> ImageTrack:
        """The track as a camera that looks straight sees it."""
        if self.none:
            return track
        growth = self.growth(track.centre)
        return replace(
            track,
            centre=self.straight(track.centre),
            axes=track.axes * growth[:, None],
            area=track.area * growth**2,
            sigma=track.sigma * float(np.median(growth)),
        )


def find_tilt(
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    view: View,
    silhouettes: Sequence[Silhouette],
    straight: Tilt,
    *,
    likeliest: bool = False,
) -> Tilt:
    """The turn of a camera that tracks tell of.

    Args:
        tracks: Of the bodies.
        arcs: Of each track.
        view: That they tell of.
        silhouettes: Of each body.
        straight: No turn, of the camera with its focal length.
        likeliest: The likeliest turn is wanted, even where it is not determined.
    """
    sizes = [s for t, o in zip(tracks, silhouettes, strict=True) if o.disc and (s := _sizes(t)) is not None]
    flown = [f for t, own in zip(tracks, arcs, strict=True) for f in flights(t, own, view)]
    if not sizes and not flown:
        return straight
    spread = np.radians(SPREAD_DEG)

    def off(x: np.ndarray) -> np.ndarray:
        tilt = replace(straight, pitch=float(x[0]), yaw=float(x[1]))
        parts = [x / spread, *(_size_errors(tilt, *s) for s in sizes)]
        return np.concatenate([*parts, _flight_errors(tilt, flown)] if flown else parts)

    most = np.radians(MOST_DEG)
    found = least_squares(off, np.zeros(2), bounds=(-most, most), x_scale=0.02, diff_step=1e-3)
    error = np.sqrt(np.diag(np.linalg.inv(found.jac.T @ found.jac)))
    pitch, yaw = np.where(likeliest | (error < DETERMINED * spread), found.x, 0.0)
    return replace(straight, pitch=float(pitch), yaw=float(yaw))


def flights(track: ImageTrack, arcs: Sequence[Arc], view: View) -> list[ImageTrack]:
    """The parts of a track in which its body falls freely, without a jump of its velocity, that are long enough.

    The first and the last frame may show what comes before and after; outlines of other widths are wrong.
    """
    width = track.axes[:, 1] / np.median(track.axes[track.whole, 1])
    good = track.whole & (np.abs(width - 1) < OFF_SIZE)
    free = {id(m.arc) for m in view.arcs if m.kind == "free"}
    groups: list[list[Arc]] = []
    for arc, before in zip(arcs, (None, *arcs), strict=False):
        if id(arc) not in free:
            continue
        if before is not None and groups and groups[-1][-1] is before and not changes_between(track, before, arc):
            groups[-1].append(arc)
        else:
            groups.append([arc])
    out = []
    for group in groups:
        use = np.concatenate([np.arange(a.start, a.stop) for a in group])[1:-1]
        use = use[good[use]]
        if len(use) >= LEAST_FLIGHT:
            out.append(track.part(use))
    return out


def _sizes(track: ImageTrack) -> tuple[np.ndarray, np.ndarray, float] | None:
    """Centres (T, 2) px of a disc, logarithms (T,) of its widths across the blur, and their error; None: too few."""
    own = track.part(track.whole)
    if len(own) < LEAST_SIZES:
        return None
    size = np.log(own.axes[:, 1])
    use = np.abs(size - np.median(size)) < OFF_SIZE
    return own.centre[use], size[use], float(np.std(size[use]))


def _size_errors(tilt: Tilt, centre: np.ndarray, log_size: np.ndarray, error: float) -> np.ndarray:
    """(2,) errors of the change of size along the two axes of a way, in their standard errors."""
    off = centre - centre.mean(0)
    _, _, axes = np.linalg.svd(off, full_matrices=False)
    away = (centre - tilt.middle) / tilt.focal
    # A ball looks larger by this where it is seen from aside, whichever way the camera is turned.
    aside = 0.25 * np.log1p((away**2).sum(1))
    nearer = np.log(tilt.rays(centre)[:, 2])  # the inverse of the depth at which a ray meets the plane
    rest = log_size - aside - nearer
    out = []
    for along in (off @ axes.T).T:
        way, spread = float(np.ptp(along)), float((along**2).sum())
        slope = float((along * (rest - rest.mean())).sum()) / max(spread, 1e-9)
        out.append(slope * way / np.hypot(SIZE_ERROR, error * way / max(spread, 1e-9) ** 0.5))
    return np.array(out)


def _flight_errors(tilt: Tilt, flown: Sequence[ImageTrack]) -> np.ndarray:
    """Errors of all centres of flights from parabolas of one acceleration, braked by the air, in standard errors."""
    rows, targets = [], []
    count = 4 * len(flown) + 2 + len(flown)
    for i, flight in enumerate(flown):
        place, t = tilt.straight(flight.centre), flight.times - flight.times.mean()
        alike = (SYSTEMATIC * flight.radius) ** 2 * max(1.0, len(t) / INDEPENDENT)
        sigma = float(np.sqrt(flight.sigma**2 + LEAST_SIGMA**2 + alike))
        braked = _braked(place, t)
        for k in (0, 1):
            row = np.zeros((len(t), count))
            row[:, 4 * i + 2 * k], row[:, 4 * i + 2 * k + 1] = 1.0, t
            row[:, 4 * len(flown) + k] = 0.5 * t**2
            row[:, 4 * len(flown) + 2 + i] = braked[:, k] * DRAG / flight.radius
            rows.append(row / sigma)
            targets.append(place[:, k] / sigma)
    drag = np.eye(count)[4 * len(flown) + 2 :]
    matrix, target = np.concatenate([*rows, drag]), np.concatenate([*targets, np.zeros(len(drag))])
    scale = np.linalg.norm(matrix, axis=0)
    found = np.linalg.lstsq(matrix / scale, target, rcond=None)[0] / scale
    return np.asarray(target - matrix @ found)


def _braked(place: np.ndarray, times: np.ndarray) -> np.ndarray:
    """(T, 2) px by which a body is displaced, to first order, that the air brakes by its speed squared over 1 px."""
    path = np.linalg.lstsq(design(times), place, rcond=None)[0]
    velocity = path[1] + times[:, None] * path[2]
    brake = -np.linalg.norm(velocity, axis=1, keepdims=True) * velocity
    steps = np.diff(times)[:, None]
    speed = np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * steps * (brake[1:] + brake[:-1]), 0)])
    return np.concatenate([np.zeros((1, 2)), np.cumsum(0.5 * steps * (speed[1:] + speed[:-1]), 0)])
