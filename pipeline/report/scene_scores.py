"""How well a predicted scene replays a clip: every metric of docs/formats.md for one clip and one answer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pipeline.clips.overlap import assign, count, foreground_iou, pair_iou, sequence_iou
from pipeline.clips.replay import HEIGHT, WIDTH, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.physics.overlap import penetration
from pipeline.scene.rotation import quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import Scene
from pipeline.search.target import make_target, resize_masks


@dataclass(frozen=True)
class Reference:
    """What is compared with: masks (F, H, W) of every frame at 480x320; flow (P, H, W, 2), px per frame interval, of
    the pairs that start at `pair_frames` (P,); the true scene, where it is known."""

    masks: np.ndarray
    flow: np.ndarray
    pair_frames: np.ndarray
    scene: Scene | None = None


def true_reference(scene: Scene, schedule: Schedule) -> Reference:
    """The reference of a sampled clip: its own replay, all pairs of frames."""
    own = replay_poses(scene, schedule)
    return Reference(own.masks, own.frame_flow, np.arange(len(own.frame_flow)), scene)


def measured_reference(masks: np.ndarray, flow: np.ndarray, pair_frames: np.ndarray) -> Reference:
    """The reference of a clip of which masks (F, H, W) of every frame and flow (P, h, w, 2) from `pair_frames` (P,) on
    were measured, at any size."""
    target = make_target(masks[pair_frames], flow, WIDTH, HEIGHT)
    return Reference(resize_masks(masks, WIDTH, HEIGHT), target.flow, pair_frames)


#: Metrics of every answer, and whether more is better.
METRICS: dict[str, bool] = {
    "composition": True,
    "iou_initial": True,
    "iou": True,
    "foreground_iou": True,
    "epe_first": False,
    "epe": False,
    "epe_frame": False,
    "penetration": False,
    "valid": True,
}


@dataclass(frozen=True)
class SceneScores:
    """How well one answer replays its clip.

    Attributes:
        metrics: By name: those of `METRICS`, and parameter errors (`error.<name>`) where the true scene is known and
            the composition right.
        pairs: (P, 2) Which object of the answer was assigned to which true object, once for the clip.
    """

    metrics: dict[str, float]
    pairs: np.ndarray


def score(scene: Scene, reference: Reference, schedule: Schedule) -> dict[str, float]:
    """The metrics of one answer, as `SceneScores` has them."""
    return score_with_pairs(scene, reference, schedule).metrics


def score_with_pairs(scene: Scene, reference: Reference, schedule: Schedule) -> SceneScores:
    """The scores of one answer. A replay that becomes unstable scores as an empty view, with `valid` 0."""
    try:
        own = replay_poses(scene, schedule)
        masks, flow, valid = own.masks, own.frame_flow, 1.0
    except SimulationError:
        shape = (len(reference.masks), HEIGHT, WIDTH)
        masks, flow, valid = np.zeros(shape, np.uint8), np.zeros((shape[0] - 1, *shape[1:], 2), np.float32), 0.0
    instances = int(reference.masks.max(initial=0)) if reference.scene is None else len(reference.scene.objects)
    counts = count(masks, reference.masks, len(scene.objects), instances)
    pairs = assign(pair_iou(counts))
    difference = np.linalg.norm(flow[reference.pair_frames] - reference.flow, axis=-1)  # (P, H, W)
    front = (masks[reference.pair_frames] > 0) | (reference.masks[reference.pair_frames] > 0)
    out = {
        "iou_initial": float(sequence_iou(counts.frames(slice(1)), pairs)),
        "iou": float(sequence_iou(counts, pairs)),
        "foreground_iou": foreground_iou(counts),
        "epe_first": float(difference[0][front[0]].mean()) if front[0].any() else 0.0,
        "epe": float(difference[front].mean()) if front.any() else 0.0,
        "epe_frame": float(difference.mean()),
        "penetration": penetration(scene),
        "valid": valid,
    }
    if reference.scene is not None:
        out["composition"] = float(scene.composition == reference.scene.composition)
        if out["composition"]:
            out |= parameter_errors(scene, reference.scene, pairs)
    return SceneScores(out, pairs)


def parameter_errors(scene: Scene, truth: Scene, pairs: np.ndarray) -> dict[str, float]:
    """Mean absolute error of each parameter, over the matched objects (P, 2) and the components of vectors, in SI units
    and degrees. Sizes and orientations are compared where the matched objects have one shape."""
    ours, theirs = scene.camera, truth.camera
    assert ours is not None
    assert theirs is not None
    assert ours.pitch is not None
    assert theirs.pitch is not None
    errors: dict[str, list[float]] = {
        "camera_height": [abs(ours.position[2] - theirs.position[2])],
        "camera_pitch": [abs(ours.pitch - theirs.pitch)],
        "fov": [abs(ours.fov - theirs.fov)],
        "gravity": [abs(scene.gravity[2] - truth.gravity[2])],
    }
    for i, j in pairs:
        a, b = scene.objects[i], truth.objects[j]
        for key in (
            "mass",
            "sliding_friction",
            "rolling_friction",
            "damping",
            "position",
            "velocity",
            "angular_velocity",
        ):
            errors.setdefault(key, []).append(float(np.mean(np.abs(np.subtract(getattr(a, key), getattr(b, key))))))
        if a.shape == b.shape:
            errors.setdefault("size", []).append(float(np.mean(np.abs(np.subtract(a.size, b.size)))))
            if a.shape != "sphere":
                turn = quaternion_multiply(quaternion_conjugate(np.array(a.orientation)), np.array(b.orientation))
                angle = 2 * np.degrees(np.arctan2(np.linalg.norm(turn[1:]), abs(turn[0])))
                errors.setdefault("orientation", []).append(float(angle))
    return {f"error.{key}": float(np.mean(values)) for key, values in errors.items()}
