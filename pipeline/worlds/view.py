"""Which view of the world a clip shows, from the tracks in the picture alone.

The kinds of views compete (`view_evidence`). Bodies hang from points where swings explain all tracks better than arcs
of constant acceleration do, at the price of their numbers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.bodies.tracks.image_track import ImageTrack
from pipeline.worlds.arcs import Arc
from pipeline.worlds.swing import Swing, arcs_evidence, fit_swing, swing_evidence
from pipeline.worlds.view_evidence import (
    LEAST_ERROR,
    OUTLINES,
    Explanation,
    Growth,
    Moving,
    explanations,
)

VIEWS = ("table", "side", "incline", "flight", "top", "hanging")
LEVEL = ("table", "side", "top")  # views of a level ground
UPRIGHT = ("side", "incline", "flight")  # views in which bodies move in an upright plane
CLOSE, PLAUSIBLE = 20.0, 1e4  # times less likely: a view may as well be this one; is worth a fit where none explains
FOCAL = 377.0  # px, of a phone's main camera, in a picture of 480 px
UNKNOWN_ROLL_DEG, EDGES_ROLL_DEG = 3.0, 1.0  # standard deviation of a camera's roll; its error where edges tell it
LEAST_PATH, SLOW = 0.6, 0.2  # radii, and share of the body's fastest arc: what goes less far and as slow rests
LEAST_SIZES = 6  # outlines of a body, from which its growth is measured


@dataclass(frozen=True)
class ArcMotion:
    """What an arc's motion looks like.

    Attributes:
        arc: The arc.
        kind: "rest", or what the view takes it for, of `Explanation.kinds`.
        path: px, length of the way.
        slope_deg: Of the line to the world's horizontal, positive where it descends to the right; -90 to 90.
        sigma: px/s², standard error of each coordinate of the acceleration, that of biased outlines included.
    """

    arc: Arc
    kind: str
    path: float
    slope_deg: float
    sigma: float


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
        costs: Of each kind of view that tracks were compared with, the likeliest first (`explanations`).
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
        others = [k for k in self.costs if k != self.kind and {k, self.kind} != {"side", "flight"}]
        return tuple(k for k in others if self.log_odds(k) <= np.log(odds))

    def log_odds(self, kind: str) -> float:
        """How much likelier, nats, the view is than that of another kind; 0 where they were not compared."""
        own, other = self.costs.get(self.kind), self.costs.get(kind)
        return 0.0 if own is None or other is None else 0.5 * (other - own)

    @property
    def gravity_error(self) -> float:
        """Standard error of `gravity_px`, as a share, from what falls or swings."""
        assert self.gravity_px is not None
        if self.swings:
            return float(sum(s.rate_error**-2 for s in self.swings) ** -0.5)
        return common_error(_of_kind(self.arcs, "free")) / float(np.linalg.norm(self.gravity_px))


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
    """What an arc looks like before a view explains it: at rest or "other", and the line that it goes along.

    Args:
        arc: The arc.
        radius: px, of the body.
        fastest: px/s, the body's speed in its fastest arc (`fastest_arc`).
        roll_deg: By which the picture's vertical is turned.
    """
    ends, path = _ends(arc), path_length(arc)
    sigma = float(np.hypot(arc.acceleration_sigma, OUTLINES * radius / arc.span**2))
    chord = ends[2] - ends[0]
    if path < LEAST_PATH * radius and np.linalg.norm(arc.velocity) <= SLOW * fastest:
        return ArcMotion(arc, "rest", path, 0.0, sigma)
    along = chord if np.linalg.norm(chord) > 0.3 * path else arc.acceleration
    return ArcMotion(arc, "other", path, _acute(float(np.degrees(np.arctan2(along[1], along[0]))) - roll_deg), sigma)


def _acute(deg: float) -> float:
    """The angle of a line, in (-90, 90]."""
    return 90 - (90 - deg) % 180


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
    if kind is None and all(m.kind == "rest" for m in motions):
        return View("table", motions, None, 0.0, 0.0, "no body moves far enough to tell the view")
    found = explanations(_moving(tracks, motions), growth(tracks), *edges, focal)
    if kind is not None and kind not in found:
        raise ValueError(f"no body {'falls freely' if kind == 'flight' else 'moves along a line'}")
    view = _explained(kind or next(iter(found)), found, motions, edges, lines_are_level)
    if kind is not None:
        return view
    costs = {name: e.cost for name, e in found.items()}
    return replace(view, costs=costs, reason=_reason(view, costs))


def _explained(
    kind: str,
    found: Mapping[str, Explanation],
    motions: Sequence[ArcMotion],
    edges: tuple[float, float],
    lines_are_level: bool,
) -> View:
    """The view of a kind, with the motion of each arc as it explains it. edges: roll, deg, and its standard error."""
    kinds, roll_deg = iter(found[kind].kinds), edges[0]
    motions = [m if m.kind == "rest" else replace(m, kind=next(kinds)) for m in motions]
    free, straight = _of_kind(motions, "free"), _of_kind(motions, "straight")
    gravity = common_acceleration(free) if free else None
    if gravity is not None:
        roll_deg = fall_roll(gravity, free, *edges)
    elif kind == "side" and lines_are_level and straight:
        roll_deg = edges[0] + mean_slope(straight)
    turned = roll_deg - edges[0]
    motions = [m if m.kind == "rest" else replace(m, slope_deg=_acute(m.slope_deg - turned)) for m in motions]
    slope = mean_slope(_of_kind(motions, "slope")) if kind == "incline" else 0.0
    if kind in ("table", "top"):
        roll_deg = 0.0
    return View(kind, tuple(motions), gravity, slope, roll_deg, "as it was asked for")


def _moving(tracks: Sequence[ImageTrack], motions: Sequence[ArcMotion]) -> Moving:
    """The arcs in which bodies do not rest."""
    radii = {track.body: track.radius for track in tracks}
    rows = []
    for motion in motions:
        if motion.kind != "rest":
            arc, radius = motion.arc, radii[motion.arc.body]
            rows.append((*arc.velocity, *arc.bend, motion.sigma, motion.path, motion.slope_deg, arc.span, radius))
    table = np.array(rows).reshape(-1, 9).T
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


def fall_roll(gravity: np.ndarray, free: Sequence[ArcMotion], known_deg: float, error_deg: float) -> float:
    """The camera's roll, deg, by free fall and by what is known of it beside that.

    Args:
        gravity: (2,) px/s², of free fall.
        free: Arcs that fall.
        known_deg: The roll as it is known without free fall.
        error_deg: Its standard error.
    """
    weight, known = (np.degrees(common_error(free)) / np.linalg.norm(gravity)) ** -2, error_deg**-2
    fallen = np.degrees(np.arctan2(-gravity[0], gravity[1]))
    return float((weight * fallen + known * known_deg) / (weight + known))


def common_acceleration(motions: Sequence[ArcMotion]) -> np.ndarray:
    """The acceleration (2,) px/s² that arcs share."""
    found = np.array([m.arc.bend for m in motions])
    errors = np.hypot(LEAST_ERROR * np.linalg.norm(found, axis=1), [m.sigma for m in motions])
    return np.asarray(np.average(found, axis=0, weights=1 / errors**2))


def common_error(motions: Sequence[ArcMotion]) -> float:
    """px/s², standard error of each coordinate of the acceleration that arcs share."""
    return float(sum(m.sigma**-2 for m in motions) ** -0.5)


def mean_slope(motions: Sequence[ArcMotion]) -> float:
    """deg, of the lines that arcs go along, by the length of their ways."""
    return float(np.average([m.slope_deg for m in motions], weights=[m.path for m in motions]))
