"""Fixed bodies that a user points at: boxes whose face, or footprint seen from above, is a rectangle in the picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.scene.scene import FixedBody
from pipeline.worlds.plane import Plane

TOLERANCES = np.arange(4.0, 48.0, 2.0)  # CIELAB units from the colour at a point, that are tried
STEADY = 0.15  # largest growth of a region from one tolerance to the next, that ends at the body's edge
LEAST_PIXELS, MOST_SHARE = 30, 0.4  # of a region; share of the picture
PATCH = 2  # px on each side of a point, whose median colour counts
DAMPING = 0.6  # of contacts of which nothing is known
FRONT, BACK = 1.5, 6.0  # from the plane of motion to a fixed body's near and far side, in radii of the largest body
#: Of a fixed body on level ground: share of its width, where that is all that is seen, and heights of the tallest body.
DEPTH, HEIGHT = 0.5, 1.5


@dataclass(frozen=True)
class FixedMark:
    """A fixed box that a user points at.

    Attributes:
        at: (x, y) px, on it, or (left, top, right, bottom) px, its face.
    """

    at: tuple[float, ...]

    def __str__(self) -> str:
        return "box@" + ",".join(f"{v:g}" for v in self.at)


@dataclass(frozen=True)
class Block:
    """A rectangle in the picture of the plane of motion.

    Attributes:
        corners: (4, 2) px, around it.
    """

    corners: np.ndarray

    def outside(self, point: np.ndarray) -> float:
        """px by which a point (2,) px is outside."""
        return -float(cv2.pointPolygonTest(self.corners.astype(np.float32), tuple(map(float, point)), True))


def find_block(background: np.ndarray, mark: FixedMark) -> Block:
    """The block at a mark in the picture (H, W, 3) uint8 without what moves.

    Of a point, the block is the smallest rectangle around the region that has the point's colour: that of the tolerance
    from which a larger one adds least (Matas et al., "Robust wide-baseline stereo from maximally stable extremal
    regions", 2002).

    Raises:
        ValueError: The mark is outside of the picture, or no region can be told apart there.
    """
    height, width = background.shape[:2]
    xs, ys = mark.at[::2], mark.at[1::2]
    if not all(0 <= x <= width for x in xs) or not all(0 <= y <= height for y in ys):
        raise ValueError(f"it is outside of the picture; valid: in 0,0,{width},{height}, px")
    if len(mark.at) == 4:
        (left, right), (top, bottom) = sorted(xs), sorted(ys)
        return Block(np.array([[left, top], [right, top], [right, bottom], [left, bottom]], float))
    region = _stable_region(background, (int(min(xs[0], width - 1)), int(min(ys[0], height - 1))))
    if region is None:
        raise ValueError(
            "no region of one colour can be told apart there; valid: a point on a fixed body, or its corners, "
            "box@x0,y0,x1,y1"
        )
    rows, columns = np.nonzero(region)
    found = cv2.minAreaRect(np.stack([columns, rows], 1).astype(np.float32) + 0.5)
    (middle, sides, angle) = found
    return Block(np.asarray(cv2.boxPoints((middle, (sides[0] + 1, sides[1] + 1), angle)), float))


def _stable_region(background: np.ndarray, point: tuple[int, int]) -> np.ndarray | None:
    """(H, W) bool: the connected region with a point (x, y) px that changes least with the tolerance of its colour."""
    x, y = point
    lab = cv2.cvtColor(background.astype(np.float32) / 255, cv2.COLOR_RGB2LAB)
    near = lab[max(y - PATCH, 0) : y + PATCH + 1, max(x - PATCH, 0) : x + PATCH + 1].reshape(-1, 3)
    off = np.linalg.norm(lab - np.median(near, axis=0), axis=-1)
    off[max(y - PATCH, 0) : y + PATCH + 1, max(x - PATCH, 0) : x + PATCH + 1] = 0
    regions = []
    for tolerance in TOLERANCES:
        _, parts = cv2.connectedComponents((off < tolerance).astype(np.uint8), connectivity=4)
        regions.append(parts == parts[y, x])
    areas = np.array([r.sum() for r in regions], float)
    growth = np.diff(areas) / areas[:-1]
    fits = (areas[:-1] >= LEAST_PIXELS) & (areas[:-1] <= MOST_SHARE * off.size) & (growth < STEADY)
    if not fits.any():
        return None
    return regions[int(np.flatnonzero(fits)[np.argmin(growth[fits])])]


def at_block(blocks: Sequence[Block], contact: np.ndarray, within: float) -> bool:
    """Whether a contact (2,) px is on a block, or as near as `within` px."""
    return any(block.outside(contact) < within for block in blocks)


def block_body(block: Block, plane: Plane, *, radius: float, top: float, name: str) -> FixedBody:
    """The fixed box of a block.

    Args:
        block: In the plane's picture.
        plane: In which bodies move.
        radius: m, of the largest body.
        top: m, the height of the tallest body, on a level plane.
        name: Of the box.
    """
    corners = plane.to_world(block.corners)
    sides = corners[1] - corners[0], corners[3] - corners[0]
    along, across = sorted(sides, key=lambda side: -abs(side[0]) / np.linalg.norm(side))  # the more level one first
    along = along if along[0] > 0 else -along
    width, height = float(np.linalg.norm(along)), float(np.linalg.norm(across))
    angle = float(np.arctan2(along[1], along[0]))
    middle = corners.mean(0)
    if plane.level:
        turn = Rotation.from_euler("z", angle)
        size, place = (width, height, HEIGHT * top), plane.in_space(middle, HEIGHT * top / 2)
    else:
        turn = Rotation.from_euler("y", -angle)
        size = (width, (FRONT + BACK) * radius, height)
        place = plane.in_space(middle, 0.5 * (BACK - FRONT) * radius)
    orientation = tuple(turn.as_quat(canonical=True, scalar_first=True))
    return FixedBody("box", size, tuple(place), orientation, damping=DAMPING, name=name)
