"""Clips with true masks for the benchmark of masks: another engine's, fresh ones by MuJoCo, real ones with outlines."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.drawn_outlines import read_outlines
from pipeline.physics.simulate import simulate
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.recordings.video import Decoder, read_clip
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole, project
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

SIZE = (480, 320)
OBJECTS = {1: 1.0, 2: 1.0, 3: 1.0, 4: 1.0}
MOVES_PX, MOVES_DEG = 4.0, 15.0  # at a width of 480 px: from here on a body moves
RATE = 30.0  # frames a second of real time that are seen of a real clip, as `dynamics masks` does
OUTLINES = Path(__file__).parent / "outlines"


@dataclass(frozen=True)
class MaskClip:
    """frames: (T, H, W, 3) uint8. times: (T,) s. masks: (F, H, W) uint8, the true ids, of the frames `labelled` (F,).
    moving: ids of the bodies that move; the others may be found or not."""

    name: str
    frames: np.ndarray
    times: np.ndarray
    masks: np.ndarray
    labelled: np.ndarray
    moving: tuple[int, ...]


def moving_ids(centre: np.ndarray, quaternion: np.ndarray, width: int, masks: np.ndarray) -> tuple[int, ...]:
    """Ids of the bodies, seen at some time, that shift or turn. centre: (T, N, 2) px, quaternion: (T, N, 4) wxyz."""
    out = []
    for i in range(centre.shape[1]):
        shift = np.linalg.norm(centre[:, i] - centre[:1, i], axis=-1).max() * 480 / width
        turn = Rotation.from_quat(quaternion[:, i], scalar_first=True)
        angle = np.degrees((turn * turn[0].inv()).magnitude()).max()
        if (shift > MOVES_PX or angle > MOVES_DEG) and (masks == i + 1).any():
            out.append(i + 1)
    return tuple(out)


def another_engine(folder: Path) -> Iterator[MaskClip]:
    """The clips of `cross_engine`, at 480x320."""
    for place in sorted(folder.glob("clip_*")):
        masks = np.load(place / "masks.npz")["masks"]
        frames = read_clip(place / "video.mp4", size=SIZE).frames
        masks = np.stack([cv2.resize(m, SIZE, interpolation=cv2.INTER_NEAREST_EXACT) for m in masks])
        truth = json.loads((place / "truth.json").read_text())
        yield MaskClip(
            name=place.name,
            frames=frames,
            times=np.arange(len(frames)) / truth["fps"],
            masks=masks,
            labelled=np.arange(len(frames)),
            moving=moving_in(truth, masks),
        )


def moving_in(truth: dict[str, Any], masks: np.ndarray) -> tuple[int, ...]:
    """Ids of the bodies that move in a clip of `cross_engine`: of its truth.json and its masks (T, H, W)."""
    objects, camera = sorted(truth["objects"], key=lambda o: o["id"]), truth["camera"]
    position = np.stack([np.array(o["position"]) for o in objects], 1)
    quaternion = np.stack([np.array(o["quat_wxyz"]) for o in objects], 1)
    view = np.array(camera["world_to_cam_opencv"])
    local = position @ view[:3, :3].T + view[:3, 3]
    centre = local[..., :2] / local[..., 2:] * camera["fx"]
    return moving_ids(centre, quaternion, truth["width"], masks)


def sampled_by_mujoco(seed: int, count: int) -> Iterator[MaskClip]:
    """Fresh clips of the project's own sampler, by MuJoCo's renderer, at 480x320."""
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    for index in range(count):
        (scene,) = drawn_scenes(params, seed, "masks", range(index, index + 1), OBJECTS)
        trace = simulate(scene, schedule.seconds)
        rng = clip_rng(seed, "masks", index, "appearance")
        look = sample_appearance(rng, len(scene.objects))
        at = schedule.frame_steps
        position, quaternion = trace.position[at], trace.quaternion[at]
        frames = render_rgb(scene, position, quaternion, look, *SIZE, "mujoco")
        frames = apply_sensor(frames, sample_sensor(rng), rng)
        assert scene.camera is not None
        camera = pinhole(scene.camera)
        masks = rasterise(scene.objects, position, quaternion, camera, *SIZE, scene.ground).mask
        centre, _ = project(position, camera, *SIZE)
        moving = moving_ids(centre, quaternion, SIZE[0], masks)
        yield MaskClip(
            name=f"sampled_{index:03d}",
            frames=frames,
            times=at / STEPS_PER_SECOND,
            masks=masks,
            labelled=np.arange(len(frames)),
            moving=moving,
        )


def outlined(folder: Path, videos: Path) -> Iterator[MaskClip]:
    """Real clips with drawn outlines: `folder` has a file of each (benchmarks/outlines/README.md), `videos` the videos.

    A clip is the stretch of its file at RATE and the frames with outlines, at the area of SIZE. Clips whose video is
    not there are left out.
    """
    for clip in read_outlines(folder):
        video = videos / clip.clip
        if not video.is_file():
            continue
        wanted = np.array(sorted(clip.frames))
        first, last = min(clip.stretch_frames[0], wanted[0]), max(clip.stretch_frames[1], wanted[-1])
        decoder = Decoder(video, 0.0, None)
        pictures = [picture for k, (_, picture) in enumerate(decoder) if first <= k <= last]
        decoder.close()
        between = np.arange(0, len(pictures) - 0.5, max(clip.fps / RATE, 1.0)).round().astype(int)
        kept = np.union1d(between, wanted - first)
        names = sorted({o.object for outlines in clip.frames.values() for o in outlines})
        height, width = pictures[0].shape[:2]
        scale = min(1.0, (SIZE[0] * SIZE[1] / (width * height)) ** 0.5)
        size = (round(width * scale), round(height * scale))
        masks = np.zeros((len(wanted), size[1], size[0]), np.uint8)
        for mask, k in zip(masks, wanted, strict=True):
            for outline in clip.frames[int(k)]:
                # Pixel centres have integer coordinates, in the polygons as in OpenCV.
                points = np.round(((outline.polygon + 0.5) * scale - 0.5) * 16).astype(np.int32)
                cv2.fillPoly(mask, [points], names.index(outline.object) + 1, cv2.LINE_8, 4)
        frames = np.stack([cv2.resize(pictures[k], size, interpolation=cv2.INTER_AREA) for k in kept])
        labelled = np.searchsorted(kept, wanted - first)
        yield MaskClip(
            name=video.stem,
            frames=frames,
            times=kept / clip.fps,
            masks=masks,
            labelled=labelled,
            moving=tuple(range(1, len(names) + 1)),
        )
