"""How each view of the world explains tracks in the picture: their arcs' accelerations and directions, and sizes.

A view allows an arc one motion or several. On a ground seen from above, bodies move straight on, or slow down. Over a
table they do so, too, but what comes nearer grows and speeds up as perspective has it. What flies has one common
acceleration, near the picture's vertical. From the side, bodies fly or are on a level ground; on an incline they speed
up downhill along one line. The cost of a view is -2 log of the likelihood of what was measured. A number that a view
needs and another one does not costs what its prior is wider than its error. No arc costs more than an outlier.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

OUTLIER = 25.0  # cost of an arc that a view does not explain: five standard errors
PRICE = 3.0  # of an incline, beside a view that needs nothing; of falls; of an arc on the ground between them
OUTLINES = 0.24  # radii, by which outlines bend an arc: shading, shadows and blur are alike over it
LEAST_ERROR = 0.05  # of an acceleration, as a share: what is nearer to the camera falls faster in the picture
LINE_DEG, LINE_RADII = 1.5, 0.05  # spread of the directions of bodies on one line, and in radii over their way
STEEP_DEG, LEVEL_DEG = 78.0, 2.0  # of a line to the horizontal, from which it counts as vertical, and as level below
SIZE_ERROR = 0.05  # of the logarithm of a radius, over the way: shading and blur differ between places
USUAL_COT, USUAL_SPREAD = 1.7, 0.8  # cotangent of the angle by which people look down at tables: 30 deg, and its spread
LEAST_COT, MOST_COT, COTS = 0.3, 5.0, 48  # so many are tried


@dataclass(frozen=True)
class Moving:
    """Arcs of all bodies that do not rest.

    Attributes:
        velocity: (N, 2) px/s, at the middle of each arc.
        acceleration: (N, 2) px/s².
        sigma: (N,) px/s², standard error of each coordinate of it.
        path: (N,) px, length of the way.
        slope_deg: (N,) of its line to the world's horizontal, positive where it descends to the right.
        span: (N,) s.
        radius: (N,) px, of the body.
    """

    velocity: np.ndarray
    acceleration: np.ndarray
    sigma: np.ndarray
    path: np.ndarray
    slope_deg: np.ndarray
    span: np.ndarray
    radius: np.ndarray

    @property
    def speed(self) -> np.ndarray:
        """(N,) px/s."""
        return np.maximum(np.linalg.norm(self.velocity, axis=1), 1e-9)

    @property
    def line_error(self) -> np.ndarray:
        """(N,) deg, by which the line that an arc goes along is off."""
        return np.hypot(LINE_DEG, np.degrees(LINE_RADII * self.radius / np.maximum(self.path, 1)))


@dataclass(frozen=True)
class Growth:
    """How much larger bodies are lower in the picture.

    Attributes:
        slope: 1/px, of the logarithm of the radius against the way down.
        error: 1/px, its standard error; infinite where bodies do not move down or up.
        way: px, the largest way down or up that one body makes.
        spread: Of the logarithms of radii about that.
    """

    slope: float
    error: float
    way: float
    spread: float

    def cost(self, slope: float) -> float:
        """Of a slope, 1/px, that a view expects; outlines do not err at random, so that many do not tell more."""
        if not np.isfinite(self.error):
            return 0.0
        return float(min(((self.slope - slope) * self.way / np.hypot(SIZE_ERROR, self.spread)) ** 2, OUTLIER))


@dataclass(frozen=True)
class Explanation:
    """What a view takes arcs for.

    Attributes:
        cost: Of all of it.
        kinds: Of each arc: "free" (falls), "slope" (on the line of an incline, sped up downhill), "straight" (goes
            straight on, or slows down), or "other" (an outlier).
    """

    cost: float
    kinds: tuple[str, ...]


def explanations(
    moving: Moving, growth: Growth, roll_deg: float, roll_error_deg: float, focal: float
) -> dict[str, Explanation]:
    """How each view that can explain arcs does so, the likeliest first; ties in favour of what needs less.

    A flight needs an arc that falls, an incline one on its line. A view that lacks it is left out.

    Args:
        moving: The arcs.
        growth: Of the bodies.
        roll_deg: By which the world's vertical is turned in the picture, clockwise.
        roll_error_deg: Its standard error.
        focal: px, of the camera.
    """
    count = len(moving.path)
    onward = _level(moving, np.zeros(count))
    level = onward + _angle(moving.slope_deg, np.hypot(roll_error_deg, moving.line_error))
    ground = {"straight": np.minimum(level, OUTLIER) + PRICE}
    steady = growth.cost(0.0)
    roll = roll_deg, roll_error_deg
    found = {
        "top": Explanation(steady + float(onward.sum()), _likeliest_kinds({"straight": onward})),
        "flight": _with_added_cost(_falling(moving, {"other": np.full(count, OUTLIER)}, *roll), steady),
        "side": _with_added_cost(_falling(moving, ground, *roll), steady),
        "incline": _with_added_cost(_incline(moving, ground, *roll), steady + PRICE),
        "table": _table(moving, growth, focal),
    }
    needed = {"flight": "free", "incline": "slope"}
    able = {view: e for view, e in found.items() if view not in needed or needed[view] in e.kinds}
    return {view: able[view] for view in sorted(able, key=lambda view: round(able[view].cost, 6))}


def _likeliest_kinds(costs: dict[str, np.ndarray]) -> tuple[str, ...]:
    """For each arc the kind of least cost (N,), "other" for outliers."""
    kinds, table = list(costs), np.array(list(costs.values()))
    return tuple(kinds[k] if cost < OUTLIER else "other" for k, cost in zip(table.argmin(0), table.min(0), strict=True))


def _with_added_cost(explanation: Explanation, cost: float) -> Explanation:
    return replace(explanation, cost=explanation.cost + cost)


def _level(moving: Moving, expected: np.ndarray) -> np.ndarray:
    """(N,) costs of arcs whose bodies go straight on or slow down, beside an expected acceleration (N,) px/s²."""
    way = moving.velocity / moving.speed[:, None]
    along = (moving.acceleration * way).sum(1)
    across = np.linalg.norm(moving.acceleration - along[:, None] * way, axis=1)
    steadily = ((along - expected) / moving.sigma) ** 2
    slower = _sided(expected - along, _pull(moving), moving.sigma)
    return np.asarray(np.minimum((across / moving.sigma) ** 2 + np.minimum(steadily, slower), OUTLIER))


def _sided(value: np.ndarray, scale: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """(N,) costs of values that are positive, of a scale that is wider than their standard errors."""
    scale = np.maximum(scale, sigma)
    return np.asarray((value / np.where(value > 0, scale, sigma)) ** 2 + 2 * np.log(scale / sigma))


def _angle(deg: np.ndarray, sigma: np.ndarray | float) -> np.ndarray:
    """Costs of lines that are off by deg, over those of lines in any direction."""
    return np.asarray((deg / sigma) ** 2 + 2 * np.log(sigma * np.sqrt(2 * np.pi) / 180))


def _falling(moving: Moving, others: dict[str, np.ndarray], roll_deg: float, roll_error_deg: float) -> Explanation:
    """Of arcs of which each either falls freely or is of another kind, of costs (N,)."""
    size = np.linalg.norm(moving.acceleration, axis=1)
    other = np.min(list(others.values()), axis=0)
    best = Explanation(float(other.sum()), _likeliest_kinds(others))
    for k in np.flatnonzero(size > moving.sigma):
        gravity = moving.acceleration[k]
        error = np.hypot(moving.sigma, LEAST_ERROR * size)
        off = np.linalg.norm(moving.acceleration - gravity, axis=1)
        weight = (off**2 < OUTLIER * error**2) / error**2
        gravity = weight @ moving.acceleration / weight.sum()
        strength = float(np.linalg.norm(gravity))
        turned = np.degrees(np.arctan2(-gravity[0], gravity[1])) - roll_deg
        turned_error = np.hypot(roll_error_deg, np.degrees(weight.sum() ** -0.5 / strength))
        error = np.hypot(moving.sigma, LEAST_ERROR * strength)
        falls = (np.linalg.norm(moving.acceleration - gravity, axis=1) / error) ** 2
        needed = 2 * np.log(max(_pull(moving)[k] / moving.sigma[k], 1.0)) + PRICE
        cost = float((turned / turned_error) ** 2 + needed + np.minimum(falls, other).sum())
        if cost < best.cost:
            best = Explanation(cost, _likeliest_kinds({"free": falls, **others}))
    return best


def _pull(moving: Moving) -> np.ndarray:
    """(N,) px/s², accelerations with which bodies would go as far from rest, or to it."""
    return 2 * moving.path / moving.span**2


def _incline(moving: Moving, ground: dict[str, np.ndarray], roll_deg: float, roll_error_deg: float) -> Explanation:
    """Of arcs that speed up down a common line, fall, or are on a level ground, of costs (N,)."""
    best = Explanation(np.inf, ())
    for slope in moving.slope_deg[(np.abs(moving.slope_deg) < STEEP_DEG) & (np.abs(moving.slope_deg) > LEVEL_DEG)]:
        angle = np.radians(slope + roll_deg)
        down = np.array([np.cos(angle), np.sin(angle)]) * np.sign(np.sin(angle))
        along = moving.acceleration @ down
        across = np.linalg.norm(moving.acceleration - along[:, None] * down, axis=1)
        cost = (across / moving.sigma) ** 2 + _sided(along, _pull(moving), moving.sigma)
        cost += _angle((moving.slope_deg - slope + 90) % 180 - 90, moving.line_error)
        needed = -float(_angle(np.zeros(()), LINE_DEG))
        ways = {"slope": np.minimum(cost, OUTLIER), **ground}
        best = min(
            best, _with_added_cost(_falling(moving, ways, roll_deg, roll_error_deg), needed), key=lambda e: e.cost
        )
    return best


def _table(moving: Moving, growth: Growth, focal: float) -> Explanation:
    """Of bodies on a level ground that is seen from aside: they come nearer as they come down the picture."""
    best = Explanation(np.inf, ())
    for cot in np.linspace(LEAST_COT, MOST_COT, COTS):
        slope = cot / focal  # of the logarithm of the radius; that of the speed is twice as large
        prior = ((cot - USUAL_COT) / USUAL_SPREAD) ** 2
        onward = _level(moving, 2 * slope * moving.velocity[:, 1] * moving.speed)
        cost = float(prior + growth.cost(slope) + onward.sum())
        if cost < best.cost:
            best = Explanation(cost, _likeliest_kinds({"straight": onward}))
    return best
