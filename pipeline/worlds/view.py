"""Which view of the world a clip shows, from the tracks in the picture alone.

The kinds of views compete (`view_evidence`). Bodies hang from points where swings explain all tracks better than arcs
of constant acceleration do, at the price of their numbers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc
from pipeline.worlds.swing import Swing, arcs_evidence, fit_swing, swing_evidence
from pipeline.worlds.view_evidence import (
    LEAST_ERROR,
    LEVEL_DEG,
    LINE_DEG,
    OUTLINES,
    STEEP_DEG,
    Growth,
    Moving,
    view_costs,
)

VIEWS = ("table", "side", "incline", "flight", "top", "hanging")
LEVEL = ("table", "side", "top")  # views of a level ground
UPRIGHT = ("side", "incline", "flight")  # views in which bodies move in an upright plane
CLOSE, PLAUSIBLE = 20.0, 1e4  # times less likely: a view may as well be this one; is worth a fit where none explains
SIGNIFICANT = 4.0  # standard errors from which an acceleration, or a jump of the velocity, counts
STRAIGHT = 0.012  # of its length: largest sagitta of a straight arc
STRAIGHT_RADII = 0.15  # of the body: and of one that speeds up downhill, whose outline shading and shadows change
FOCAL = 377.0  # px, of a phone's main camera, in a picture of 480 px
NEARLY_LEVEL_DEG = 6.0  # and by which a level line may be turned, with the camera
UNKNOWN_ROLL_DEG, EDGES_ROLL_DEG = 3.0, 1.0  # standard deviation of a camera's roll; its error where edges tell it
OFF_DOWN_DEG = 25.0  # largest angle of free fall to the picture's vertical
LEAST_PATH, SLOW = 0.6, 0.2  # radii, and share of the body's fastest arc: what goes less far and as slow rests
ALIKE = 0.3  # largest mean deviation of the accelerations of free arcs, as a share
LEAST_SIZES = 6  # outlines of a body, from which its growth is measured


@dataclass(frozen=True)
class ArcMotion:
    """What an arc's motion looks like.

    Attributes:
        arc: The arc.
        kind: "free" (falls), "slope" (on a straight line, sped up downhill), "straight", "rest", or "other".
        path: px, length of the way.
        slope_deg: Of the line to the world's horizontal, positive where it descends to the right; -90 to 90.
    """

    arc: Arc
    kind: str
    path: float
    slope_deg: float


@dataclass(frozen=True)
class View:
    """A view of the world.

    Attributes:
        kind: Of `VIEWS`.
        arcs: The motion of each arc.
        gravity_px: (2,) px/s², the acceleration of free fall in the picture; None where nothing falls or swings.
        slope_deg: Of the incline to the world's horizontal, positive where it descends to the right; 0 elsewhere.
        roll_deg: By which the world's vertical is turned in the picture, clockwise.
        reason: What told, in words.
        swings: Of each track, where bodies hang.
        costs: Of each kind of view that tracks were compared with, the likeliest first (`view_costs`).
    """

    kind: str
    arcs: tuple[ArcMotion, ...]
    gravity_px: np.ndarray | None
    slope_deg: float
    roll_deg: float
    reason: str
    swings: tuple[Swing, ...] = ()
    costs: dict[str, float] = field(default_factory=dict)

    def rivals(self, odds: float) -> tuple[str, ...]:
        """The other kinds of views that are at most so many times less likely, the likeliest first.

        A flight is a side view without supports, so that neither is a rival of the other.
        """
        own = self.costs.get(self.kind, -np.inf)
        others = [k for k in self.costs if k != self.kind and {k, self.kind} != {"side", "flight"}]
        return tuple(k for k in others if self.costs[k] - own <= 2 * np.log(odds))

    @property
    def gravity_error(self) -> float:
        """Standard error of `gravity_px`, as a share, from what falls or swings."""
        assert self.gravity_px is not None
        if self.swings:
            return float(sum(s.rate_error**-2 for s in self.swings) ** -0.5)
        errors = [m.arc.acceleration_sigma for m in self.arcs if m.kind == "free"]
        return float(sum(e**-2 for e in errors) ** -0.5 / np.linalg.norm(self.gravity_px))


def down(roll_deg: float) -> np.ndarray:
    """(2,) unit vector of gravity in the picture, x right and y down."""
    roll = np.radians(roll_deg)
    return np.array([-np.sin(roll), np.cos(roll)])


def _ends(arc: Arc) -> np.ndarray:
    """(3, 2) start, middle and end of an arc, px."""
    return arc.position_at(arc.time + arc.span * np.array([-0.5, 0.0, 0.5]))


def path_length(arc: Arc) -> float:
    """px from an arc's start by its middle to its end."""
    return float(np.linalg.norm(np.diff(_ends(arc), axis=0), axis=1).sum())


def fastest_arc(arcs: Sequence[Arc], radius: float) -> float:
    """px/s of a body in its fastest arc; infinite where no arc leads it far enough to count as motion."""
    far = [a for a in arcs if path_length(a) >= LEAST_PATH * radius]
    return max((float(np.linalg.norm(a.velocity)) for a in far), default=np.inf)


def describe_arc(arc: Arc, radius: float, fastest: float, roll_deg: float = 0.0) -> ArcMotion:
    """The kind of an arc.

    Args:
        arc: The arc.
        radius: px, of the body.
        fastest: px/s, the body's speed in its fastest arc (`fastest_arc`).
        roll_deg: By which the picture's vertical is turned.
    """
    ends, path = _ends(arc), path_length(arc)
    chord = ends[2] - ends[0]
    if path < LEAST_PATH * radius and np.linalg.norm(arc.velocity) <= SLOW * fastest:
        return ArcMotion(arc, "rest", path, 0.0)
    along = chord if np.linalg.norm(chord) > 0.3 * path else arc.acceleration
    along = along / np.linalg.norm(along)
    slope = float(np.degrees(np.arctan2(along[1], along[0]))) - roll_deg
    slope = slope - 180 if slope > 90 else slope + 180 if slope <= -90 else slope
    parallel = float(arc.acceleration @ along)
    across = arc.acceleration - parallel * along
    sagitta = float(np.linalg.norm(across)) * arc.span**2 / 8
    bends = np.linalg.norm(across) > SIGNIFICANT * arc.acceleration_sigma
    size = float(np.linalg.norm(arc.acceleration))
    significant = size > SIGNIFICANT * arc.acceleration_sigma
    falls = significant and arc.acceleration @ down(roll_deg) > np.cos(np.radians(OFF_DOWN_DEG)) * size
    if bends and sagitta > max(STRAIGHT * path, STRAIGHT_RADII * radius):
        return ArcMotion(arc, "free" if falls else "other", path, slope)
    if falls and abs(slope) > STEEP_DEG:
        return ArcMotion(arc, "free", path, slope)
    downhill = along if along @ down(roll_deg) > 0 else -along
    if significant and arc.acceleration @ downhill > 0 and LEVEL_DEG < abs(slope) <= STEEP_DEG:
        return ArcMotion(arc, "slope", path, slope)
    return ArcMotion(arc, "other" if bends and sagitta > STRAIGHT * path else "straight", path, slope)


def growth(tracks: Sequence[ImageTrack]) -> Growth:
    """How much larger the bodies of tracks are lower in the picture."""
    x, y, ways = [], [], [0.0]
    for track in tracks:
        use = track.whole
        if use.sum() < LEAST_SIZES:
            continue
        height = track.centre[use, 1]
        log_radius = 0.5 * np.log(track.area[use])
        x.append(height - height.mean())
        y.append(log_radius - log_radius.mean())
        ways.append(float(np.ptp(height)))
    spread = float(sum((h**2).sum() for h in x))
    if spread < 1e-6:
        return Growth(0.0, np.inf, max(ways), np.inf)
    height, log_radius = np.concatenate(x), np.concatenate(y)
    slope = float((height * log_radius).sum()) / spread
    left = float(np.std(log_radius - slope * height))
    return Growth(slope, left / np.sqrt(spread), max(ways), left)


def find_view(
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    roll_deg: float | None = None,
    kind: str | None = None,
    focal: float = FOCAL,
) -> View:
    """The view that the tracks of a clip and their arcs tell of.

    Args:
        tracks: Of the bodies.
        arcs: Of each track.
        roll_deg: By which the world's vertical is turned in the picture, clockwise, where edges tell it; free fall may
            tell it better. None: not known; lines along which bodies move from the side are level then.
        kind: Of `VIEWS`, where it is known; None: the tracks decide.
        focal: px, of the camera.

    Raises:
        ValueError: The tracks show nothing of what a view of this kind needs.
    """
    lines_are_level, roll_deg = roll_deg is None, roll_deg or 0.0
    edges = roll_deg, UNKNOWN_ROLL_DEG if lines_are_level else EDGES_ROLL_DEG
    motions = _described(tracks, arcs, roll_deg)
    if kind in (None, "hanging"):
        swings = find_swings(tracks, arcs, *edges, certain=kind == "hanging")
        if swings:
            return _hanging(motions, swings)
        if kind == "hanging":
            raise ValueError("no body swings")
    if kind is not None:
        return _seen_as(kind, tracks, arcs, edges, lines_are_level)
    if all(m.kind == "rest" for m in motions):
        view = _seen_as("table", tracks, arcs, edges, lines_are_level)
        return replace(view, reason="no body moves far enough to tell the view")
    costs = view_costs(_moving(tracks, motions), growth(tracks), *edges, focal)
    for likely in costs:
        try:
            view = _seen_as(likely, tracks, arcs, edges, lines_are_level)
        except ValueError:  # what the evidence takes for a fall or a slope may be too short to be measured
            continue
        if likely != "incline" or abs(view.slope_deg) > LEVEL_DEG:
            return replace(view, costs=costs, reason=_reason(view, costs))
    raise AssertionError("a view from above can always be measured")


def _seen_as(
    kind: str,
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    edges: tuple[float, float],
    lines_are_level: bool,
) -> View:
    """The view of a kind. edges: roll, deg, and its standard error. Raises ValueError as `find_view` does."""
    roll_deg = edges[0]
    motions = _described(tracks, arcs, roll_deg)
    gravity = None if kind in ("table", "top") else free_fall(_of_kind(motions, "free"))
    if gravity is not None:
        roll_deg = fall_roll(gravity, motions, *edges)
        motions = _described(tracks, arcs, roll_deg)
    elif kind == "flight":
        raise ValueError("no body falls freely")
    moving = [m for m in motions if m.kind != "rest"]
    slope = None
    if kind == "incline":
        total = sum(m.path for m in moving)
        slope = common_slope(_of_kind(moving, "slope"), total)
        if slope is None:
            slope = common_slope([m for m in moving if m.kind in ("slope", "straight")], total)
        if slope is None:
            raise ValueError("no body moves along a line")
    if kind in ("table", "top"):
        roll_deg = 0.0
    if kind == "side" and gravity is None and lines_are_level:
        roll_deg = level_roll(moving)
        motions = _described(tracks, arcs, roll_deg)
    return View(kind, motions, gravity, slope or 0.0, roll_deg, "as it was asked for")


def _moving(tracks: Sequence[ImageTrack], motions: Sequence[ArcMotion]) -> Moving:
    """The arcs in which bodies do not rest."""
    radii = {track.body: track.radius for track in tracks}
    rows = []
    for motion in motions:
        if motion.kind != "rest":
            arc, radius = motion.arc, radii[motion.arc.body]
            sigma = float(np.hypot(arc.acceleration_sigma, OUTLINES * radius / arc.span**2))
            rows.append((*arc.velocity, *arc.bend, sigma, motion.path, motion.slope_deg, arc.span, radius))
    table = np.array(rows).T
    return Moving(table[:2].T, table[2:4].T, *table[4:])


def _reason(view: View, costs: dict[str, float]) -> str:
    """What told the view, and others that are hardly less likely."""
    told = {
        "table": "bodies move, and grow, as on a table seen from aside",
        "top": "bodies go straight on, or slow down, and grow nowhere",
        "incline": f"bodies speed up along a line of {abs(view.slope_deg):.1f}°",
        "side": "bodies move along level lines",
        "flight": "",
    }[view.kind]
    if view.gravity_px is not None and view.kind != "incline":
        told = f"bodies fall with {np.linalg.norm(view.gravity_px):.0f} px/s²"
    close = replace(view, costs=costs).rivals(CLOSE)
    return f"{told}; it may be {' or '.join(close)}" if close else told


def find_swings(
    tracks: Sequence[ImageTrack],
    arcs: Sequence[Sequence[Arc]],
    roll_deg: float,
    roll_error_deg: float,
    *,
    certain: bool = False,
) -> tuple[Swing, ...]:
    """The swing of each track; empty where not all have one, or arcs explain the tracks better.

    Args:
        tracks: Of the bodies.
        arcs: Of each track.
        roll_deg: Of the camera, as it is known without them.
        roll_error_deg: Its standard error.
        certain: Bodies are known to hang, whatever explains the tracks better.
    """
    swings: list[Swing] = []
    for track in tracks:
        swing = fit_swing(track, roll_deg, roll_error_deg)
        if swing is None:
            return ()
        swings.append(swing)
    against = sum(arcs_evidence(t, own) for t, own in zip(tracks, arcs, strict=True))
    wins = sum(swing_evidence(t, s) for t, s in zip(tracks, swings, strict=True)) < against
    return tuple(swings) if wins or certain else ()


def _hanging(motions: tuple[ArcMotion, ...], swings: tuple[Swing, ...]) -> View:
    """The view of bodies that hang. Their common gravity and vertical are means, weighted by the swings' errors."""
    weights = np.array([s.rate_error**-2 for s in swings])
    roll = float(np.average([s.roll for s in swings], weights=weights))
    size = float(np.average([s.rate * s.length for s in swings], weights=weights))
    reason = "bodies swing about " + ("a point" if len(swings) == 1 else "points")
    turned = float(np.degrees(roll))
    return View("hanging", motions, size * down(turned), 0.0, turned, reason, swings)


def _described(tracks: Sequence[ImageTrack], arcs: Sequence[Sequence[Arc]], roll_deg: float) -> tuple[ArcMotion, ...]:
    """The motion of each arc."""
    return tuple(
        describe_arc(arc, track.radius, fastest_arc(own, track.radius), roll_deg)
        for track, own in zip(tracks, arcs, strict=True)
        for arc in own
    )


def _of_kind(motions: Sequence[ArcMotion], kind: str) -> list[ArcMotion]:
    return [m for m in motions if m.kind == kind]


def fall_roll(gravity: np.ndarray, motions: Sequence[ArcMotion], known_deg: float, error_deg: float) -> float:
    """The camera's roll, deg, by free fall and by what is known of it beside that.

    Args:
        gravity: (2,) px/s², of free fall.
        motions: Of all arcs.
        known_deg: The roll as it is known without free fall.
        error_deg: Its standard error.
    """
    sigma = sum(m.arc.acceleration_sigma**-2 for m in motions if m.kind == "free") ** -0.5
    weight, known = (np.degrees(sigma) / np.linalg.norm(gravity)) ** -2, error_deg**-2
    fallen = np.degrees(np.arctan2(-gravity[0], gravity[1]))
    return float((weight * fallen + known * known_deg) / (weight + known))


def level_roll(moving: Sequence[ArcMotion]) -> float:
    """The camera's roll, deg, for which lines along which bodies move are level; 0 where no line is nearly so."""
    lines = [m for m in moving if m.kind in ("straight", "slope") and abs(m.slope_deg) <= NEARLY_LEVEL_DEG]
    return float(np.average([m.slope_deg for m in lines], weights=[m.path for m in lines])) if lines else 0.0


def may_fall(motion: ArcMotion, gravity: np.ndarray) -> bool:
    """Whether an arc is too short to tell its motion from free fall. gravity: (2,) px/s²."""
    off = np.linalg.norm(motion.arc.acceleration - gravity)
    return bool(off <= SIGNIFICANT * motion.arc.acceleration_sigma)


def free_fall(free: Sequence[ArcMotion]) -> np.ndarray | None:
    """The common acceleration (2,) px/s² of arcs that fall; None where there are none, or they do not agree."""
    if not free:
        return None
    paths = np.array([m.path for m in free])
    found = np.array([m.arc.acceleration for m in free])
    errors = np.hypot(LEAST_ERROR * np.linalg.norm(found, axis=1), [m.arc.acceleration_sigma for m in free])
    gravity = np.average(found, axis=0, weights=1 / errors**2)
    off = np.linalg.norm(found - gravity, axis=1) / np.linalg.norm(gravity)
    return np.asarray(gravity) if np.average(off, weights=paths) < ALIKE else None


def common_slope(sloping: Sequence[ArcMotion], total: float) -> float | None:
    """The slope, deg, of the line along which bodies speed up downhill; None where less than half of the way is on one.

    total: px, the way of all bodies.
    """
    if not sloping:
        return None
    paths = np.array([m.path for m in sloping])
    slopes = np.array([m.slope_deg for m in sloping])
    order = np.argsort(slopes)
    median = slopes[order][np.searchsorted(np.cumsum(paths[order]), paths.sum() / 2)]
    alike = np.abs(slopes - median) < 2 * LINE_DEG
    if 2 * paths[alike].sum() <= total:
        return None
    return float(np.average(slopes[alike], weights=paths[alike]))
