"""Views of motions: what a camera sees of one, with the errors of masks and flow, and the text that is right for it.

A motion is turned about the vertical, mirrored, shifted, scaled (lengths, velocities and gravity alike, which is the
same motion in other units) and given other masses in one ratio; then a camera is drawn. None of this is simulated
again. A view is kept if it passes the filters of the suites.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from statistics import NormalDist

import cv2
import numpy as np

from pipeline.clips.events import DEFAULT_THRESHOLDS, Event, told_events
from pipeline.clips.view import areas_px
from pipeline.model.instances import HEIGHT, WIDTH, Instances, crop_square, instances_of
from pipeline.model.mask_errors import with_errors
from pipeline.model.words_example import motions
from pipeline.scene.canonical import canonical_object
from pipeline.scene.rotation import matrix_from_quaternion, quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import BASIC_SHAPES, SIZE_KEYS, Camera, Scene, SceneObject, half_extents
from pipeline.vision.flow.flow_noise import RAFT_RANGES, add_waver, drop_out
from pipeline.vision.flow.flow_picture import REFERENCE_WIDTH
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import Pinhole, pinhole, project
from pipeline.vision.rendering.exact_flow import exact_flow_frame
from pipeline.vision.rendering.rasteriser import fill_background, rasterise_frame, rasterise_frames
from pipeline.vision.rendering.shade import shade
from training.words.motions import (
    DAMPING,
    MASS,
    ROLLING,
    SIZE,
    SLIDING,
    SPIN,
    VELOCITY,
    Motion,
)

FPS = 30
FIRST = np.arange(10) * 3  # the first frame of each of the model's pairs
TIMES = np.arange(30) / FPS
SMALL = (120, 80)  # px, of the masks from which areas are taken
AREA_PX, VISIBLE_PX = 8000, 32  # of 480x320: least area of all bodies at first, and of one that is in view
TRIES = 6
#: The sampler's ranges (params.yaml, sample.distribution).
HEIGHTS, TARGETS, FOVS, DISTANCE = (0.5, 1.4), (0.0, 0.25), (28.0, 46.0), 2.0
GRAVITIES, MASSES, ROLLINGS = (2.0, 12.0), (0.1, 4.0), (0.0, 0.01)
SIZES = {"sphere": ((0.07, 0.24),), "cylinder": ((0.06, 0.2), (0.1, 0.4)), "box": ((0.12, 0.4),) * 3}
PLACES = ((-0.7, 0.7), (-0.7, 0.8))
CENTRE = np.array([0.0, 0.05])
SPEED = 2.1  # m/s along the ground, the most that a scaled motion has
SCALES = (0.8, 1.25)


@dataclass(frozen=True)
class MotionView:
    """A motion in the world of another camera; bodies from left to right where they first appear."""

    scene: Scene
    position: np.ndarray
    quaternion: np.ndarray
    events: list[Event]

    @property
    def objects(self) -> tuple[SceneObject, ...]:
        return self.scene.objects

    @property
    def camera(self) -> Camera:
        assert self.scene.camera is not None
        return self.scene.camera


def _limits(motion: Motion) -> tuple[float, float]:
    """Scales that keep sizes, gravity and rolling friction within the sampler's ranges."""
    low, high = SCALES
    for shape, values in zip(motion.shapes, motion.values, strict=True):
        for k, (least, most) in enumerate(SIZES[BASIC_SHAPES[shape]]):
            low, high = max(low, least / values[SIZE + k]), min(high, most / values[SIZE + k])
        if values[ROLLING] > 0:
            high = min(high, ROLLINGS[1] / values[ROLLING])
        fastest = float(np.linalg.norm(values[VELOCITY : VELOCITY + 2]))
        high = min(high, SPEED / max(fastest, 1e-3))
    low, high = max(low, GRAVITIES[0] / motion.gravity), min(high, GRAVITIES[1] / motion.gravity)
    return min(low, 1.0), max(high, 1.0)


def draw_view(motion: Motion, rng: np.random.Generator) -> MotionView | None:
    """The motion seen otherwise; None where no try passes the filters."""
    low, high = _limits(motion)
    masses = motion.values[:, MASS]
    for _ in range(TRIES):
        scale = math.exp(rng.uniform(math.log(low), math.log(high)))
        angle, mirror = rng.uniform(-math.pi, math.pi), rng.random() < 0.5
        shift = np.array([*(CENTRE + rng.uniform(-0.1, 0.1, 2)), 0.0])
        c, s = math.cos(angle), math.sin(angle)
        flip = np.diag([-1.0 if mirror else 1.0, 1.0, 1.0])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ flip
        start = scale * (motion.position[0] - [*CENTRE, 0.0]) @ turn.T + shift
        if any((start[:, k] < a).any() or (start[:, k] > b).any() for k, (a, b) in enumerate(PLACES)):
            continue
        height, target = rng.uniform(*HEIGHTS), rng.uniform(*TARGETS)
        camera = Camera(
            (0.0, -DISTANCE, height),
            fov=rng.uniform(*FOVS),
            pitch=-math.degrees(math.atan2(height - target, DISTANCE)),
        )
        position = scale * (motion.position - [*CENTRE, 0.0]) @ turn.T + shift
        q = motion.quaternion * ([1, 1, -1, -1] if mirror else [1, 1, 1, 1])
        about = np.array([math.cos(angle / 2), 0, 0, math.sin(angle / 2)])
        quaternion = quaternion_multiply(np.broadcast_to(about, q.shape), q)
        sizes = scale * motion.values[:, SIZE : SIZE + 3].astype(float)
        shapes = [BASIC_SHAPES[k] for k in motion.shapes]
        kinds = motion.shapes.astype(np.int64)
        halves = np.array(
            [
                half_extents(SceneObject(shape=a, size=tuple(b[: len(SIZE_KEYS[a])]), mass=1.0))
                for a, b in zip(shapes, sizes, strict=True)
            ]
        )
        seen_from = pinhole(camera)
        areas = _areas(kinds, halves, position, quaternion, seen_from)
        if areas[0].sum() < AREA_PX:
            continue
        visible = areas >= VISIBLE_PX
        if np.count_nonzero(~visible[FIRST].any(0)) > 1:
            continue
        ratio = math.exp(rng.uniform(math.log(MASSES[0] / masses.min()), math.log(MASSES[1] / masses.max())))
        objects = []
        for k, shape in enumerate(shapes):
            v = motion.values[k].astype(float)
            objects.append(
                SceneObject(
                    shape=shape,
                    size=tuple(sizes[k, : len(SIZE_KEYS[shape])]),
                    mass=v[MASS] * ratio,
                    sliding_friction=v[SLIDING],
                    rolling_friction=v[ROLLING] * scale,
                    damping=v[DAMPING],
                    position=tuple(start[k]),
                    orientation=tuple(quaternion[0, k]),
                    velocity=tuple(scale * turn @ v[VELOCITY : VELOCITY + 3]),
                    angular_velocity=tuple(_spin_turn(turn) @ v[SPIN : SPIN + 3]),
                )
            )
        objects = [canonical_object(o) for o in objects]
        seen = np.where(visible[FIRST].any(0), visible[FIRST].argmax(0), -1)
        centre = np.array([position[FIRST[max(f, 0)], i] for i, f in enumerate(seen)])
        order = np.lexsort([project(centre, seen_from, WIDTH, HEIGHT)[0][:, 0], seen < 0])
        new = np.argsort(order)
        physical = []
        for e in motion.events:
            first, second = int(new[e.first]), None if e.second is None else int(new[e.second])
            if second is not None and second < first:
                first, second = second, first
            physical.append(replace(e, first=first, second=second))
        return MotionView(
            Scene(tuple(objects[i] for i in order), camera, (0.0, 0.0, -motion.gravity * scale)),
            np.ascontiguousarray(position[:, order]),
            np.ascontiguousarray(quaternion[:, order]),
            told_events(physical, areas[:, order], TIMES, DEFAULT_THRESHOLDS),
        )
    return None


def _spin_turn(turn: np.ndarray) -> np.ndarray:
    """What turns angular velocities as `turn` turns vectors: a mirror changes their sign (they are axial)."""
    return np.linalg.det(turn) * turn


def _areas(kinds, halves, position, quaternion, camera: Pinhole) -> np.ndarray:
    """(F, N) px of 480x320."""
    width, height = SMALL
    mask = np.empty((len(position), height, width), np.uint8)
    depth = np.empty((len(position), height, width), np.float32)
    back = np.empty((height, width), np.float32)
    eye, rotation, fov = camera.position_world, camera.rotation_world, camera.fov_y_deg
    fill_background(eye, rotation, fov, 0.0, back)
    rasterise_frames(kinds, halves, position, quaternion, eye, rotation, fov, back, mask, depth)
    return areas_px(mask, len(kinds))


@dataclass(frozen=True)
class Pictures:
    """What is seen of the ten frames: masks (T, H, W), flow (T, H, W, 2), both exact; the rectangle of the bodies."""

    masks: np.ndarray
    flow: np.ndarray
    within: np.ndarray


def pictures(view: MotionView, width: int = WIDTH, height: int = HEIGHT) -> Pictures:
    """Exact masks and flow."""
    camera = pinhole(view.camera)
    eye, rotation, fov = camera.position_world, camera.rotation_world, camera.fov_y_deg
    kinds = np.array([BASIC_SHAPES.index(o.shape) for o in view.objects], np.int64)
    halves = _halves(view)
    masks = np.empty((len(FIRST), height, width), np.uint8)
    depth = np.empty((height, width), np.float32)
    back = np.empty((height, width), np.float32)
    flow = np.zeros((len(FIRST), height, width, 2), np.float32)
    within = np.empty((len(FIRST), 4), np.int64)
    fill_background(eye, rotation, fov, 0.0, back)
    p, q = view.position, view.quaternion
    for t, f in enumerate(FIRST):
        box = rasterise_frame(kinds, halves, p[f], q[f], eye, rotation, fov, back, masks[t], depth)
        exact_flow_frame(p[f], q[f], p[f + 1], q[f + 1], eye, rotation, fov, masks[t], depth, box, flow[t])
        within[t] = box
    return Pictures(masks, flow, within)


def _halves(view: MotionView) -> np.ndarray:
    """Half extents (N, 3) in the frame of the motion's own quaternions: canonical boxes have their sizes permuted."""
    out = np.array([half_extents(o) for o in view.objects], float)
    for k, o in enumerate(view.objects):
        if o.shape == "box":
            turn = quaternion_multiply(quaternion_conjugate(view.quaternion[0, k]), np.array(o.orientation))
            out[k] = out[k, np.argmax(np.abs(matrix_from_quaternion(turn)), axis=1)]
    return out


NOISE_SIGMAS = (5.0, 7.0, 9.0)  # px of 240x160
NOISE_PAD = 128


class Fields:
    """Smooth noise of unit deviation, made once: (K, H + PAD, W + PAD, 3) for each of NOISE_SIGMAS."""

    def __init__(self, count: int = 6) -> None:
        rng = np.random.default_rng(0)
        self.fields = []
        for sigma in NOISE_SIGMAS:
            noise = rng.standard_normal((count, HEIGHT + NOISE_PAD, WIDTH + NOISE_PAD, 3)).astype(np.float32)
            smooth = np.stack([cv2.GaussianBlur(n, (0, 0), sigma) for n in noise])
            self.fields.append(smooth / smooth.std())

    def draw(self, rng: np.random.Generator, sigma: float, height: int, width: int) -> np.ndarray:
        """(height, width, 3)."""
        fields = self.fields[int(np.argmin(np.abs(np.array(NOISE_SIGMAS) - sigma)))]
        a, b = rng.integers(NOISE_PAD, size=2)
        return fields[rng.integers(len(fields)), a : a + height, b : b + width]


def noisy(
    flow: np.ndarray, masks: np.ndarray, within: np.ndarray, fields: Fields, rng: np.random.Generator
) -> np.ndarray:
    """Flow with errors on and near bodies like RAFT's (`pipeline.vision.flow.flow_noise`), at rest elsewhere."""
    drawn = {k: float(np.exp(rng.uniform(*np.log(limits)))) for k, limits in RAFT_RANGES.items()}
    size = masks.shape[2] / REFERENCE_WIDTH
    blur = size * drawn["edge_px"]
    margin = math.ceil(2 * blur)
    out = flow.copy()
    threshold = NormalDist().inv_cdf(1 - drawn["dropout"])
    for t in range(len(flow)):
        top, bottom, left, right = within[t]
        part = np.s_[max(top - margin, 0) : bottom + margin, max(left - margin, 0) : right + margin]
        piece = out[t][part]
        if not piece.size:
            continue
        field = fields.draw(rng, size * drawn["correlation_px"], *piece.shape[:2])
        drop_out(piece, np.ones(piece.shape[:2], bool), field[..., 2], threshold)
        piece[:] = cv2.GaussianBlur(piece, (0, 0), blur)
        still = np.zeros_like(piece)
        add_waver(piece, piece.any(-1), field[..., :2], still, size, drawn["waver_px"], drawn["waver_share"])
    return out


def motion_labels(view: MotionView) -> np.ndarray:
    """(N, T, 9) position, velocity and spin between the two frames of each pair."""
    pairs = np.stack([FIRST, FIRST + 1], 1)
    return motions(view.position[pairs], view.quaternion[pairs], 1 / FPS)


def instances_with_errors(seen: Pictures, count: int, fields: Fields, rng: np.random.Generator) -> Instances:
    """What the model reads of bodies: masks and flow as they are measured."""
    flow = noisy(seen.flow, seen.masks, seen.within, fields, rng)
    return instances_of(with_errors(seen.masks, count, rng), flow)


def shown_rgb(
    view: MotionView, rng: np.random.Generator, wanted: np.ndarray | None, width: int, height: int
) -> np.ndarray:
    """Frames (T, height, width, 3) uint8 with a drawn appearance and sensor; wanted: (T, height, width) bool."""
    appearance = sample_appearance(rng, len(view.objects))
    objects = [replace(o, size=_size_of(o, h)) for o, h in zip(view.objects, _halves(view), strict=True)]
    frames = shade(
        objects,
        view.position[FIRST],
        view.quaternion[FIRST],
        pinhole(view.camera),
        appearance,
        width,
        height,
        antialias=False,
        wanted=wanted,
    )
    return apply_sensor(frames, sample_sensor(rng), rng)


def _size_of(body: SceneObject, half: np.ndarray) -> tuple[float, ...]:
    return tuple(2 * half) if body.shape == "box" else body.size


def boxes_wanted(places: np.ndarray) -> np.ndarray:
    """(T, HEIGHT, WIDTH) bool: the crops of instances with places (N, T, 14)."""
    wanted = np.zeros((places.shape[1], HEIGHT, WIDTH), bool)
    for body in places:
        for t, v in enumerate(body):
            if v[0]:
                left, top, side = crop_square(v)
                rows = slice(max(int(top), 0), max(math.ceil(top + side), 0))
                wanted[t, rows, max(int(left), 0) : max(math.ceil(left + side), 0)] = True
    return wanted
