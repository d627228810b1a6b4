"""Tracks cut into arcs at impacts."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pipeline.discovery.tracks.arc import FAR_AWAY, GROUND, Arc, Cut, Impact
from pipeline.discovery.tracks.contacts import (
    Surroundings,
    collisions_by_distance,
    hit_object,
    is_upwards,
    touching_samples,
)
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.noise import leave_one_out, rough_sigma
from pipeline.discovery.tracks.outliers import find_outliers
from pipeline.discovery.tracks.smoothing import LEAST_KNOWN, UNFILTERED, TrackNoise, find_smoothing
from pipeline.discovery.tracks.track import Track
from pipeline.discovery.tracks.velocity_jumps import VelocityJump, find_velocity_jumps
from pipeline.errors import MeasurementError
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import SceneObject, half_extents
from pipeline.scene.solid import reach_below

LEAST_SAMPLES = 6
SETTLING = 0.05  # s after landing in which a body on the ground still swings
HOPPING = 0.2  # s after a collision of two bodies on the ground in which they press on it unevenly
SLIPPING = 0.4  # s after a collision until a ball whose spin was not measured is assumed to roll again
RECUT = 2  # times that smoothed tracks are cut again: impacts look like a wider filter and more noise
LOW_FLIGHT = 8.0  # standard deviations over the ground: in lower hops a touch cannot be seen
Moving = Mapping[tuple[str, str], Track]
"""(clip, object) -> its track without outliers and missing positions."""


def cut_tracks(tracks: Sequence[Track], known: KnownScene) -> Cut:
    """Arcs and impacts of all tracks. Raises `MeasurementError` for an object that is not in the scene."""
    names = [o.name for o in known.scene.objects]
    for t in tracks:
        if t.object not in names:
            raise MeasurementError(
                f"clip {t.clip}, object {t.object}, row 1: the scene has no such object; valid: {', '.join(names)}"
            )
    measured = [np.isfinite(t.position).all(1) for t in tracks]
    cut = _cut_all(tracks, measured, known, _noise(tracks, measured))
    for _ in range(RECUT if cut.noise.smoothing.width else 0):
        noise = find_smoothing([a.time for a in cut.arcs], [a.position for a in cut.arcs], LEAST_KNOWN)
        if noise is None or noise.sigma > cut.noise.sigma:
            break
        cut = _cut_all(tracks, measured, known, noise)
    return cut


def _cut_all(tracks: Sequence[Track], measured: Sequence[np.ndarray], known: KnownScene, noise: TrackNoise) -> Cut:
    """Arcs and impacts of all tracks, which have positions at the samples `measured`, each (T,) bool."""
    names, reach = [o.name for o in known.scene.objects], noise.smoothing.reach
    moving: dict[tuple[str, str], Track] = {}
    rows_of: list[np.ndarray] = []
    outliers: set[tuple[str, int, int]] = set()
    for track, there in zip(tracks, measured, strict=True):
        rows = np.flatnonzero(there)
        parts = _between_bounces(track, track.time[rows])
        bad = np.concatenate([find_outliers(track.time[rows[p]], track.position[rows[p]], noise.sigma) for p in parts])
        outliers |= {(track.clip, names.index(track.object), int(r)) for r in rows[bad]}
        rows_of.append(_well_inside(track.time, rows[~bad], reach))
        if len(rows_of[-1]):
            moving[track.clip, track.object] = track.samples(rows_of[-1])
    arcs: list[Arc] = []
    impacts: list[Impact] = []
    for track, rows in zip(tracks, rows_of, strict=True):
        if len(rows) >= LEAST_SAMPLES - 1:
            more_arcs, more_impacts = _cut_track(track, rows, known, moving, noise, first=len(arcs))
            arcs += more_arcs
            impacts += more_impacts
    return Cut(tuple(arcs), tuple(impacts), noise, frozenset(outliers))


def _noise(tracks: Sequence[Track], measured: Sequence[np.ndarray]) -> TrackNoise:
    """The noise of all tracks: as stated, else estimated."""
    times = [t.time[g] for t, g in zip(tracks, measured, strict=True)]
    positions = [t.position[g] for t, g in zip(tracks, measured, strict=True)]
    filtered = find_smoothing(times, positions)
    smoothing = UNFILTERED if filtered is None else filtered.smoothing
    stated = [t.sigma[np.isfinite(t.sigma)] for t in tracks if t.sigma is not None]
    if stated and sum(map(len, stated)):
        return TrackNoise(float(np.median(np.concatenate(stated))) / smoothing.information**0.5, smoothing)
    if filtered is not None:
        return filtered
    residuals = [leave_one_out(t, x) for t, x in zip(times, positions, strict=True)]
    return TrackNoise(rough_sigma(np.concatenate(residuals)), smoothing)


def _well_inside(time: np.ndarray, rows: np.ndarray, margin: float) -> np.ndarray:
    """Of the rows (n,) of a track at times (T,), those at least `margin` s from its ends."""
    return rows[(time[rows] >= time[0] + margin) & (time[rows] <= time[-1] - margin)]


def _cut_track(
    track: Track, rows: np.ndarray, known: KnownScene, moving: Moving, noise: TrackNoise, *, first: int
) -> tuple[list[Arc], list[Impact]]:
    """The arcs and impacts of one track.

    Args:
        track: All of its samples.
        rows: Indices of the samples that are neither missing nor outliers.
        known: The known scene.
        moving: The tracks of all objects, without outliers.
        noise: Of all tracks.
        first: Index of the first arc.
    """
    sigma, reach = noise.sigma, noise.smoothing.reach
    names, scene = [o.name for o in known.scene.objects], known.of_clip(track.clip)
    index = names.index(track.object)
    obj, time, position = scene.objects[index], track.time[rows], track.position[rows]
    quaternion = None if track.quaternion is None else track.quaternion[rows]
    spin = _spin(track, rows)
    around = Surroundings(
        scene=scene,
        index=index,
        time=time,
        position=position,
        gap=_gaps(obj, position, quaternion, scene.ground),
        others=_others(time, track, names, moving),
        sigma=sigma,
        blur=noise.smoothing.blur,
    )

    def is_bounce(jump: VelocityJump) -> bool:
        return is_upwards(jump) and hit_object(jump, around) == GROUND

    parts = _between_bounces(track, time)
    found = [j for p in parts for j in find_velocity_jumps(time[p], position[p], sigma, is_bounce, apart=reach)]
    jumps = [(jump, hit_object(jump, around)) for jump in found]
    jumps += [(_known_bounce(when, time, position), GROUND) for when in track.bounces if scene.ground is not None]
    contacts = [(jump, other) for jump, other in jumps if other is not None]
    unexplained = [jump for jump, other in jumps if other is None]
    by_distance = collisions_by_distance(around, [jump for jump, _ in jumps])
    touches = touching_samples(around)
    # a sample in which bodies touch belongs to neither side
    touching = np.isin(time, [jump.time for jump, _ in (*by_distance, *touches)])
    contacts += by_distance
    known_times = [jump.time for jump, _ in contacts]
    contacts += [(jump, other) for jump, other in touches if all(jump.time != t for t in known_times)]
    contacts.sort(key=lambda pair: pair[0].time)
    edges = [-np.inf, *(jump.time for jump, _ in contacts), np.inf]
    after_collision = HOPPING if spin is not None or obj.shape != "sphere" else SLIPPING
    settled = [-np.inf, *(j.time + (SETTLING if other == GROUND else after_collision) for j, other in contacts)]
    trimmed = int((track.time < track.time[0] + reach).sum())
    arcs: list[Arc] = []
    number: list[int] = []  # of the arc between each pair of edges
    for k, (left, right) in enumerate(itertools.pairwise(edges)):
        inside = (time > left + reach) & (time < right - reach) & ~touching
        grounded = _is_grounded(around, inside)
        inside = inside & (time > settled[k]) if grounded else _without_contacts(around, inside)
        chosen = np.flatnonzero(inside)
        tumbles = obj.shape != "sphere" and grounded and not _slides(obj, quaternion, inside)
        if len(chosen) < LEAST_SAMPLES or tumbles:
            number.append(-1)
            continue
        number.append(first + len(arcs))
        arcs.append(
            Arc(
                clip=track.clip,
                object=index,
                grounded=grounded,
                time=time[chosen],
                position=position[chosen],
                sigma=np.full(len(chosen), sigma) if track.sigma is None else _filled(track.sigma[rows][chosen], sigma),
                row=rows[chosen],
                others=around.others[chosen],
                spin=None if spin is None else spin[chosen],
                quaternion=None if quaternion is None else quaternion[chosen],
                camera_error=track.camera_error,
                jumps=tuple(jump for jump in unexplained if time[chosen[0]] < jump.time < time[chosen[-1]]),
                rolling=rows[chosen[0]] < trimmed + 3 or (k > 0 and contacts[k - 1][1] != GROUND),
            )
        )
    impacts = [
        Impact(
            clip=track.clip,
            object=index,
            other=other,
            time=jump.time,
            position=jump.position,
            before=number[k],
            after=number[k + 1],
        )
        for k, (jump, other) in enumerate(contacts)
    ]
    return arcs, impacts


def _between_bounces(track: Track, time: np.ndarray) -> list[slice]:
    """The samples (T,) s of a track between the bounces that its recording shows."""
    edges = [0, *np.searchsorted(time, track.bounces), len(time)]
    return [slice(int(a), int(b)) for a, b in itertools.pairwise(edges)]


def _known_bounce(when: float, time: np.ndarray, position: np.ndarray) -> VelocityJump:
    place = np.array([np.interp(when, time, coordinate) for coordinate in position.T])
    return VelocityJump(when, place, np.zeros(3), 0.0)


def _filled(values: np.ndarray, default: float) -> np.ndarray:
    return np.where(np.isfinite(values), values, default)


def _others(time: np.ndarray, track: Track, names: Sequence[str], moving: Moving) -> np.ndarray:
    """Centres of the scene's other objects at the times (T,), by interpolation, (T, M, 3) m.

    Objects that the clip does not show are `FAR_AWAY`.
    """
    centres = []
    for name in names:
        if name == track.object:
            continue
        other = moving.get((track.clip, name))
        if other is None:
            centres.append(np.full((len(time), 3), FAR_AWAY))
            continue
        there = np.isfinite(other.position).all(1)
        centres.append(np.stack([np.interp(time, other.time[there], c) for c in other.position[there].T], 1))
    return np.stack(centres, 1) if centres else np.zeros((len(time), 0, 3))


def _spin(track: Track, rows: np.ndarray) -> np.ndarray | None:
    """Measured angular velocity, else that of the measured orientations, (n, 3) rad/s; None without both."""
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
    """Height of the body's lowest point over the ground, (T,) m; inf without a ground."""
    if ground is None:
        return np.full(len(position), np.inf)
    if obj.shape == "sphere":
        reach = np.full(len(position), half_extents(obj)[0])
    elif quaternion is not None and np.isfinite(quaternion).all():
        reach = np.array([reach_below(replace(obj, orientation=tuple(q))) for q in quaternion])
    else:
        reach = np.full(len(position), reach_below(obj))
    return position[:, 2] - reach - ground


def _is_grounded(around: Surroundings, inside: np.ndarray) -> bool:
    """Whether the samples `inside` (T,) bool are on the ground: low and level."""
    gap, height = around.gap[inside], around.position[inside, 2]
    if not len(gap) or not np.isfinite(gap[0]):
        return False
    low = 0.3 * float(half_extents(around.object).min()) + 3 * around.sigma
    return bool(abs(np.median(gap)) < low and np.ptp(np.quantile(height, [0.1, 0.9])) < 3 * around.sigma + 0.006)


def _without_contacts(around: Surroundings, inside: np.ndarray) -> np.ndarray:
    """The samples of a flight `inside` (T,) bool in which nothing is touched.

    Removed are samples near an impact that are too low or too near; samples at an end of the track beyond an impact
    that too few samples show; and all of a hop that is not higher than the noise.
    """
    gap, time, sigma = around.gap, around.time, around.sigma
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
            passed = len(inner) == 3 and _touched_between_samples(time, gap, ends[lowest], inner)
            beyond = max(int(low[-1]) + 1 if len(low) else 0, lowest + 1 if passed and lowest else 0)
            out[ends[:beyond]] = False
            out[ends[0]] &= bool(gap[ends[0]] > 5 * sigma + 0.005)
    for _, other, distance in around.other_objects():
        reach = float(max(half_extents(around.object))) + float(max(half_extents(other)))
        out &= distance > reach + 2.5 * sigma
    return out


def _touched_between_samples(time: np.ndarray, gap: np.ndarray, lowest: int, inner: np.ndarray) -> bool:
    """Whether the body touched the ground less than a sample interval from its lowest sample.

    Its speed is that at the samples `inner`, which are further inside the flight.
    """
    speed = abs(gap[inner[0]] - gap[inner[-1]]) / abs(time[inner[0]] - time[inner[-1]])
    return bool(gap[lowest] < 1.2 * speed * abs(time[inner[0]] - time[lowest]))


def _slides(obj: SceneObject, quaternion: np.ndarray | None, inside: np.ndarray) -> bool:
    """Whether a body that is not a sphere rests on a face while it moves, so that its friction is sliding friction."""
    if quaternion is None:
        return obj.shape in ("cylinder", "box")
    up = matrix_from_quaternion(quaternion[inside])[:, 2]  # z components of the body's axes
    axes = np.abs(up[:, 2:]) if obj.shape == "cylinder" else np.abs(up)
    return bool(np.median(axes.max(1)) > 0.995) if len(up) else False
