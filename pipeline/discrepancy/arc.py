"""Tracks cut into arcs: the smooth stretches between impacts, in the air or on the ground.

What happens within an impact depends on the engine and on the material more than on any law that we look for, so that
arcs have initial states of their own, and impacts are compared by the speeds before and after them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.breaks import Break, find_breaks
from pipeline.discrepancy.known_scene import KnownScene
from pipeline.discrepancy.meeting import meetings
from pipeline.discrepancy.noise import leave_one_out, rough_sigma
from pipeline.discrepancy.track import Track
from pipeline.errors import MeasurementError
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import Scene, SceneObject, half_extents
from pipeline.scene.solid import reach_below

LEAST_SAMPLES = 6
FAR_AWAY = 1e6  # m: where objects are that a clip does not show
SETTLING = 0.05  # s after landing in which a body on the ground still swings
HOPPING = 0.2  # s after two bodies on the ground met, which rub each other up and down: they press on it unevenly
SLIPPING = 0.4  # s after which a ball of unknown spin that another one struck is taken to roll again
OUTLIER = 5.0  # standard deviations
SMOOTH = 3.0  # the same, of five samples from a parabola
LOW_FLIGHT = 8.0  # standard deviations over the ground: in lower hops a touch does not show
UPWARDS = 0.8  # share of a jump that is upwards at least, of a bounce on the ground
SIDEWAYS = 0.5  # share of a jump that may be upwards, of a body that another one struck from the side
TOUCH = 3.5  # standard deviations of a coordinate by which the gap between two balls in touch may seem wider
SIDE = 5  # samples on each side that predict one


@dataclass(frozen=True)
class Impact:
    """A jump of velocity that is explained: with the ground (other = -1) or with object `other`; before, after: indices
    of the arcs around it, -1 where they are too short. time s, position (3,) m."""

    clip: str
    object: int
    other: int
    time: float
    position: np.ndarray
    before: int
    after: int


@dataclass(frozen=True)
class Arc:
    """A smooth stretch of n samples. time (n,) s; position (n, 3) m; sigma (n,) m; grounded: on the ground, else in the
    air. spin (n, 3) rad/s, quaternion (n, 4) or None; others (n, M, 3) m: where the other objects were. jumps: breaks
    within it that nothing known explains. row (n,): the samples' places in their track. rolling: a ball on the ground
    is taken to roll where its spin is unknown: nothing has struck it, or not lately."""

    clip: str
    object: int
    grounded: bool
    time: np.ndarray
    position: np.ndarray
    sigma: np.ndarray
    row: np.ndarray
    others: np.ndarray
    spin: np.ndarray | None = None
    quaternion: np.ndarray | None = None
    jumps: tuple[Break, ...] = ()
    rolling: bool = False

    @property
    def mean_spin(self) -> np.ndarray | None:
        """(3,) rad/s; None where it was not measured."""
        if self.spin is None or not np.isfinite(self.spin).any():
            return None
        return np.nanmedian(self.spin, axis=0)


@dataclass(frozen=True)
class Cut:
    """All arcs of all tracks, and the impacts between them. sigma: rough noise, m. outliers: (clip, object, row)."""

    arcs: tuple[Arc, ...]
    impacts: tuple[Impact, ...]
    sigma: float
    outliers: frozenset[tuple[str, int, int]]


def cut_tracks(tracks: Sequence[Track], known: KnownScene) -> Cut:
    """Arcs and impacts of all tracks. Raises `MeasurementError` for an object that the scene lacks."""
    names = [o.name for o in known.scene.objects]
    for t in tracks:
        if t.object not in names:
            raise MeasurementError(
                f"clip {t.clip}, object {t.object}, row 1: the scene has no such object; valid: {', '.join(names)}"
            )
    good = [np.isfinite(t.position).all(1) for t in tracks]
    residuals = [leave_one_out(t.time[g], t.position[g]) for t, g in zip(tracks, good, strict=True)]
    rough = rough_sigma(np.concatenate(residuals))
    stated = [t.sigma[np.isfinite(t.sigma)] for t in tracks if t.sigma is not None]
    sigma = float(np.median(np.concatenate(stated))) if stated and sum(map(len, stated)) else rough
    moving: dict[tuple[str, str], Track] = {}
    rows_of: list[np.ndarray] = []
    arcs: list[Arc] = []
    impacts: list[Impact] = []
    outliers: set[tuple[str, int, int]] = set()
    for track, kept in zip(tracks, good, strict=True):
        rows = np.flatnonzero(kept)
        bad = _outliers(track.time[rows], track.position[rows], sigma)
        outliers |= {(track.clip, names.index(track.object), int(r)) for r in rows[bad]}
        rows_of.append(rows[~bad])
        if len(rows_of[-1]):
            clean = replace(track, time=track.time[rows[~bad]], position=track.position[rows[~bad]])
            moving[track.clip, track.object] = clean
    for track, rows in zip(tracks, rows_of, strict=True):
        if len(rows) >= LEAST_SAMPLES - 1:
            scene = known.of_clip(track.clip)
            _cut_track(track, rows, scene, names.index(track.object), names, moving, sigma, arcs, impacts)
    return Cut(tuple(arcs), tuple(impacts), sigma, frozenset(outliers))


def _outliers(time: np.ndarray, position: np.ndarray, sigma: float) -> np.ndarray:
    """Samples that are far from where those before lead and from where those after lead, (T,) bool.

    At an impact a sample fits one side; an outlier fits neither. Each side's prediction is the median of the parabolas
    through all triples of its five nearest samples, so that an outlier among them does no harm.
    """
    bad = np.zeros(len(time), bool)
    for _ in range(SIDE + 1):  # again without the worst of them: a side that has them predicts nothing
        new = np.array([_alone(time, position, bad, k, sigma) for k in range(len(time))]) & ~bad
        if not new.any():
            break
        bad |= new
    return bad


def _alone(time: np.ndarray, position: np.ndarray, bad: np.ndarray, k: int, sigma: float) -> bool:
    """Whether sample k is too far from what each side predicts. A side alone (near an end of the track) must itself be
    smooth to count: else the jump may be there."""
    sides = [inwards[~bad[inwards]][:SIDE] for inwards in (np.arange(k - 1, -1, -1), np.arange(k + 1, len(time)))]
    sides = [near for near in sides if len(near) == SIDE]
    for near in sides:
        weights = _parabolas(time[near] - time[k])
        predicted = np.median(weights @ position[near], axis=0)
        limit = OUTLIER * sigma * (1 + 0.6 * float(np.median(np.linalg.norm(weights, axis=1)))) + 0.002
        if np.abs(position[k] - predicted).max() <= limit:
            return False
    return len(sides) == 2 or (len(sides) == 1 and _is_smooth(time[sides[0]], position[sides[0]], sigma))


def _is_smooth(time: np.ndarray, position: np.ndarray, sigma: float) -> bool:
    """Whether a few samples lie on a parabola."""
    design = np.vander(time - time[0], 3)
    left = position - design @ np.linalg.lstsq(design, position, rcond=None)[0]
    return bool(np.abs(left).max() < SMOOTH * sigma)


def _parabolas(t: np.ndarray) -> np.ndarray:
    """Weights (triples, n) of n samples at times t (n,) in the parabolas through each three of them, at time 0."""
    rows = []
    for triple in itertools.combinations(range(len(t)), 3):
        row = np.zeros(len(t))
        for i in triple:
            row[i] = np.prod([t[j] / (t[j] - t[i]) for j in triple if j != i])
        rows.append(row)
    return np.array(rows)


def _cut_track(
    track: Track, rows: np.ndarray, scene: Scene, index: int, names: Sequence[str],
    moving: dict[tuple[str, str], Track], sigma: float, arcs: list[Arc], impacts: list[Impact],
) -> None:  # fmt: skip
    """Append the arcs and impacts of one track."""
    obj, time, position = scene.objects[index], track.time[rows], track.position[rows]
    quaternion = None if track.quaternion is None else track.quaternion[rows]
    others = _others(time, track, names, moving)
    spin = _spin(track, rows, obj)
    gap = _gaps(obj, position, quaternion, scene.ground)

    def explanation(b: Break) -> int | None:
        return _explanation(b, obj, time, position, gap, others, scene, names, index, sigma)

    def bounces(b: Break) -> bool:
        return bool(b.jump[2] > UPWARDS * np.linalg.norm(b.jump)) and explanation(b) == -1

    explained = [(b, explanation(b)) for b in find_breaks(time, position, sigma, bounces)]
    known = [(b, other) for b, other in explained if other is not None]
    unknown = [b for b, other in explained if other is None]
    met = _met(time, position, others, scene, index, sigma, [b for b, _ in explained])
    together = _together(time, position, others, scene, index, sigma)
    touching = np.isin(time, [b.time for b, _ in (*met, *together)])  # such a sample is of neither side
    known += met + [(b, m) for b, m in together if all(b.time != k.time for k, _ in (*known, *met))]
    known.sort(key=lambda pair: pair[0].time)
    edges = [-np.inf, *(b.time for b, _ in known), np.inf]
    struck = HOPPING if spin is not None or obj.shape != "sphere" else SLIPPING
    settled = [-np.inf, *(b.time + (SETTLING if other == -1 else struck) for b, other in known)]
    placed: list[int] = []
    for k, (left, right) in enumerate(itertools.pairwise(edges)):
        inside = (time > left) & (time < right) & ~touching
        grounded = _is_grounded(position[inside], gap[inside], sigma, obj)
        if grounded:
            inside &= time > settled[k]
        if not grounded:
            inside = _in_the_air(inside, time, gap, others, position, scene, index, sigma)
        chosen = np.flatnonzero(inside)
        if len(chosen) < LEAST_SAMPLES or (
            obj.shape not in ("sphere",) and grounded and not _slides(obj, quaternion, inside)
        ):
            placed.append(-1)
            continue
        placed.append(len(arcs))
        arcs.append(Arc(
            track.clip, index, grounded, time[chosen], position[chosen],
            np.full(len(chosen), sigma) if track.sigma is None else _filled(track.sigma[rows][chosen], sigma),
            rows[chosen], others[chosen], None if spin is None else spin[chosen],
            None if quaternion is None else quaternion[chosen],
            tuple(b for b in unknown if time[chosen[0]] < b.time < time[chosen[-1]]),
            rows[chosen[0]] < 3 or (k > 0 and known[k - 1][1] != -1),
        ))  # fmt: skip
    for k, (b, other) in enumerate(known):
        impacts.append(Impact(track.clip, index, other, b.time, b.position, placed[k], placed[k + 1]))


def _filled(values: np.ndarray, default: float) -> np.ndarray:
    return np.where(np.isfinite(values), values, default)


def _others(time: np.ndarray, track: Track, names: Sequence[str], moving: dict[tuple[str, str], Track]) -> np.ndarray:
    """Where the scene's other objects were at the times (T,), (T, M, 3) m, by interpolation; those that the clip does
    not show are far away."""
    places = []
    for name in names:
        if name == track.object:
            continue
        other = moving.get((track.clip, name))
        if other is None:
            places.append(np.full((len(time), 3), FAR_AWAY))
            continue
        there = np.isfinite(other.position).all(1)
        places.append(np.stack([np.interp(time, other.time[there], c) for c in other.position[there].T], 1))
    return np.stack(places, 1) if places else np.zeros((len(time), 0, 3))


def _spin(track: Track, rows: np.ndarray, obj: SceneObject) -> np.ndarray | None:
    """Measured angular velocity, else that of the measured orientations, (n, 3) rad/s."""
    if track.angular_velocity is not None and np.isfinite(track.angular_velocity[rows]).any():
        return track.angular_velocity[rows]
    if track.quaternion is None or not np.isfinite(track.quaternion[rows]).all():
        return None
    q, t = track.quaternion[rows], track.time[rows]
    step = 2 if len(q) > 8 else 1
    late, early = np.minimum(np.arange(len(q)) + step, len(q) - 1), np.maximum(np.arange(len(q)) - step, 0)
    turn = quaternion_multiply(q[late], quaternion_conjugate(q[early]))
    turn = np.where(turn[:, :1] < 0, -turn, turn)
    size = np.linalg.norm(turn[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(size, turn[:, :1])
    return np.where(size > 1e-12, turn[:, 1:] / np.maximum(size, 1e-12), 0.0) * angle / (t[late] - t[early])[:, None]


def _gaps(obj: SceneObject, position: np.ndarray, quaternion: np.ndarray | None, ground: float | None) -> np.ndarray:
    """How far above the ground the body's lowest point is, (T,) m; inf without a ground."""
    if ground is None:
        return np.full(len(position), np.inf)
    if obj.shape == "sphere":
        reach = np.full(len(position), half_extents(obj)[0])
    elif quaternion is not None and np.isfinite(quaternion).all():
        reach = np.array([reach_below(replace(obj, orientation=tuple(q))) for q in quaternion])
    else:
        reach = np.full(len(position), reach_below(obj))
    return position[:, 2] - reach - ground


def _explanation(
    b: Break, obj: SceneObject, time: np.ndarray, position: np.ndarray, gap: np.ndarray, others: np.ndarray,
    scene: Scene, names: Sequence[str], index: int, sigma: float,
) -> int | None:  # fmt: skip
    """What a jump is an impact with: GROUND (-1), another object's index, or None."""
    near = int(np.argmin(np.abs(time - b.time)))
    low = slice(max(0, near - 1), near + 2)
    size = float(max(half_extents(obj)))
    present = [i for i in range(len(names)) if i != index]
    met: int | None = None
    for m in range(others.shape[1]):
        reach = size + float(max(half_extents(scene.objects[present[m]])))
        if met is None and np.linalg.norm(others[low, m] - position[low], axis=1).min() < 1.3 * reach + 4 * sigma:
            met = present[m]
    if met is not None and abs(b.jump[2]) < SIDEWAYS * np.linalg.norm(b.jump):
        return met  # the ground strikes upwards
    if np.isfinite(gap[near]):
        at_break = b.position[2] - position[near, 2] + gap[near]
        around = np.diff(time[max(0, near - 2) : near + 3])
        missed = 0.0  # how far it may have fallen on where rows are missing, and come back
        if (
            b.jump[2] > UPWARDS * np.linalg.norm(b.jump)
            and len(around)
            and around.max() > 1.5 * np.median(np.diff(time))
        ):
            missed = 0.5 * float(b.jump[2]) * float(around.max())
        if min(at_break, gap[low].min()) < 0.25 * size + 0.01 + 4 * sigma + missed:
            return -1
    return met


def _met(
    time: np.ndarray, position: np.ndarray, others: np.ndarray, scene: Scene, index: int, sigma: float,
    found: Sequence[Break],
) -> list[tuple[Break, int]]:  # fmt: skip
    """Impacts with other balls that show by the distance alone, but for those that were found as jumps."""
    present = [o for i, o in enumerate(scene.objects) if i != index]
    out: list[tuple[Break, int]] = []
    if scene.objects[index].shape != "sphere":
        return out
    for m in range(others.shape[1]):
        if present[m].shape != "sphere":
            continue
        reach = float(half_extents(scene.objects[index])[0] + half_extents(present[m])[0])
        for when in meetings(time, np.linalg.norm(others[:, m] - position, axis=1), reach, sigma):
            step = float(np.median(np.diff(time)))
            if all(abs(when - b.time) > 2.5 * step for b in (*found, *(b for b, _ in out))):
                at = position[int(np.argmin(np.abs(time - when)))]
                number = scene.objects.index(present[m])
                out.append((Break(when, at, np.zeros(3), 0.0), number))
    return out


def _together(
    time: np.ndarray, position: np.ndarray, others: np.ndarray, scene: Scene, index: int, sigma: float
) -> list[tuple[Break, int]]:
    """Samples at which the ball is in touch with another: they push and rub each other, however gently."""
    out: list[tuple[Break, int]] = []
    for m, number in enumerate(i for i in range(len(scene.objects)) if i != index):
        pair = scene.objects[index], scene.objects[number]
        if m < others.shape[1] and all(o.shape == "sphere" for o in pair):
            reach = sum(float(half_extents(o)[0]) for o in pair)
            near = np.linalg.norm(others[:, m] - position, axis=1) < reach + TOUCH * sigma
            out += [(Break(float(time[k]), position[k], np.zeros(3), 0.0), number) for k in np.flatnonzero(near)]
    return out


def _is_grounded(position: np.ndarray, gap: np.ndarray, sigma: float, obj: SceneObject) -> bool:
    """Whether a stretch is on the ground: low, and level."""
    if not len(gap) or not np.isfinite(gap[0]):
        return False
    low = 0.3 * float(half_extents(obj).min()) + 3 * sigma
    return bool(abs(np.median(gap)) < low and np.ptp(np.quantile(position[:, 2], [0.1, 0.9])) < 3 * sigma + 0.006)


def _in_the_air(
    inside: np.ndarray, time: np.ndarray, gap: np.ndarray, others: np.ndarray, position: np.ndarray, scene: Scene,
    index: int, sigma: float,
) -> np.ndarray:  # fmt: skip
    """The samples of a flight that touch nothing: those near an impact that are too low or too near are left out, at
    the ends of the track those beyond one that too few samples show, and all of a hop as low as the noise."""
    out = inside.copy()
    chosen = np.flatnonzero(inside)
    if len(chosen) and np.isfinite(gap[0]):
        out &= gap > 2.5 * sigma
        out &= bool(gap[chosen].max() > LOW_FLIGHT * sigma + 0.005)
        for ends in (chosen, chosen[::-1]):  # inwards from each end
            first = ends[: max(2, len(ends) // 3)]
            low = np.flatnonzero(gap[first] <= 2.5 * sigma)
            lowest = int(np.argmin(gap[first[:4]]))
            inner = ends[lowest + 1 : lowest + 4]
            passed = len(inner) == 3 and _within_a_step(time, gap, ends[lowest], inner)
            beyond = max(int(low[-1]) + 1 if len(low) else 0, lowest + 1 if passed and lowest else 0)
            out[ends[:beyond]] = False
            out[ends[0]] &= bool(gap[ends[0]] > 5 * sigma + 0.005)
    reach = [float(max(half_extents(o))) for i, o in enumerate(scene.objects) if i != index]
    for m in range(others.shape[1]):
        apart = np.linalg.norm(others[:, m] - position, axis=1)
        out &= apart > float(max(half_extents(scene.objects[index]))) + reach[m] + 2.5 * sigma
    return out


def _within_a_step(time: np.ndarray, gap: np.ndarray, lowest: int, inner: np.ndarray) -> bool:
    """Whether a body as fast as at the samples `inner`, from which it came or to which it went, was on the ground less
    than a step from its lowest sample."""
    speed = abs(gap[inner[0]] - gap[inner[-1]]) / abs(time[inner[0]] - time[inner[-1]])
    return bool(gap[lowest] < 1.2 * speed * abs(time[inner[0]] - time[lowest]))


def _slides(obj: SceneObject, quaternion: np.ndarray | None, inside: np.ndarray) -> bool:
    """Whether a body that is no sphere rests on a face while it moves, so that its friction is that of sliding."""
    if quaternion is None:
        return obj.shape in ("cylinder", "box")
    up = matrix_from_quaternion(quaternion[inside])[:, 2]  # z components of the body's axes
    axes = np.abs(up[:, 2:]) if obj.shape == "cylinder" else np.abs(up)
    return bool(np.median(axes.max(1)) > 0.995) if len(up) else False
