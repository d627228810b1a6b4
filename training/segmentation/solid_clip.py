"""Clips of simulated solid bodies, by MuJoCo's renderer or by our ray caster, in front of any picture."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.physics.trace import Trace
from pipeline.scene.scene import Camera, Scene, half_extents
from pipeline.scene.time_step import STEPS_PER_SECOND
from pipeline.vision.rendering.appearance import Appearance
from pipeline.vision.rendering.camera import Pinhole, focal_px, project
from pipeline.vision.rendering.mujoco_render import render_mujoco
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.shade import shade
from training.segmentation.backgrounds import log_uniform, sample_background
from training.segmentation.clip import OTHER, DrawnClip, largest_shifts, state_of
from training.segmentation.flat_clip import layer_over, sample_times
from training.segmentation.hands import draw_cloth, draw_hand, sample_cloth, sample_hand, sample_passing_shadow
from training.segmentation.shadows import label_shadows, with_empty_scene
from training.segmentation.solid_looks import sample_looks
from training.segmentation.solid_scenes import draw_moving_scene, largest_turns, sample_camera

LEAST_AREA, MOST_AREA = 0.0006, 0.55  # of all bodies together, shares of the picture


def poses_at(trace: Trace, steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions (T, N, 3), interpolated, and quaternions (T, N, 4), the nearest, at fractional steps (T,)."""
    last = len(trace.position) - 1
    steps = np.clip(steps, 0, last)
    low = np.minimum(steps.astype(int), last - 1)
    part = (steps - low)[:, None, None]
    position = (1 - part) * trace.position[low] + part * trace.position[low + 1]
    sign = np.sign((trace.quaternion[low] * trace.quaternion[low + 1]).sum(-1, keepdims=True))
    turned = (1 - part) * trace.quaternion[low] + part * sign * trace.quaternion[low + 1]
    return position, turned / np.linalg.norm(turned, axis=-1, keepdims=True)


def render(
    scene: Scene,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera: Pinhole,
    look: Appearance,
    width: int,
    height: int,
    mujoco: bool,
    shadows: bool,
) -> np.ndarray:
    """Pictures float32 (T, H, W, 3), 0 to 255, four rays a pixel."""
    size = (2 * width, 2 * height)
    if mujoco:
        orientation = Rotation.from_matrix(camera.rotation_world).as_quat(scalar_first=True)
        eye = Camera(tuple(camera.position_world), camera.fov_y_deg, orientation=tuple(orientation))
        big = render_mujoco(replace(scene, camera=eye), position, quaternion, look, *size, shadows)
    else:
        big = shade(scene.objects, position, quaternion, camera, look, *size, scene.ground, shadows, antialias=False)
    return np.stack([cv2.resize(b, (width, height), interpolation=cv2.INTER_AREA) for b in big]).astype(np.float32)


def mirror_image(
    rng: np.random.Generator,
    scene: Scene,
    position: np.ndarray,
    quaternion: np.ndarray,
    camera: Pinhole,
    look: Appearance,
    frames: np.ndarray,
    mask: np.ndarray,
    ground: np.ndarray,
) -> np.ndarray:
    """Add the bodies' images in a glossy floor to frames (T, H, W, 3), in place; where they are, (T, H, W) bool.

    ground: (T, H, W) bool, where the floor is seen.
    """
    height, width = mask.shape[1:]
    below = position * [1, 1, -1]
    turned = quaternion * [1, -1, -1, 1]
    image = shade(scene.objects, below, turned, camera, look, width, height, None, False, False)
    where = rasterise(scene.objects, below, turned, camera, width, height, None).mask > 0
    strength, soft = rng.uniform(0.05, 0.5), log_uniform(rng, 0.3, 3.0)
    out = np.zeros(mask.shape, bool)
    for t in range(len(frames)):
        seen = (where[t] & ground[t]).astype(np.float32)
        weight = strength * cv2.GaussianBlur(seen, (0, 0), soft) * (mask[t] == 0)
        frames[t] += weight[..., None] * (cv2.GaussianBlur(image[t], (0, 0), soft).astype(np.float32) - frames[t])
        out[t] = weight > 0.08
    return out


def draw_solid_clip(rng: np.random.Generator, width: int, height: int, mujoco: bool) -> DrawnClip | None:
    """A random clip of width x height px; None where too little or too much is seen of the bodies."""
    count, interval = sample_times(rng)
    seconds = min(count * interval, 2.4)
    interval = seconds / count
    drawn = draw_moving_scene(rng, seconds + float(rng.choice([0.0, rng.uniform(0, 0.8)])) + 0.05)
    if drawn is None:
        return None
    scene, trace, tilt = drawn
    start = rng.uniform(0, max(len(trace.position) - 1 - seconds * STEPS_PER_SECOND, 0.0))
    steps = start + interval * STEPS_PER_SECOND * np.arange(count)
    if rng.random() < 0.15:
        steps = steps[::-1]
    position, quaternion = poses_at(trace, steps)
    camera = sample_camera(rng, scene, position, tilt)
    centre, depth = project(position, camera, width, height)
    if camera.position_world[2] < 0.1 or (depth < 0.1).any():
        return None
    full = rasterise(scene.objects, position, quaternion, camera, width, height, scene.ground)
    mask, bodies = full.mask, len(scene.objects)
    areas = np.stack([(mask == i + 1).sum((1, 2)) for i in range(bodies)], 1)  # (T, N)
    seen = (areas >= 6).sum(0) >= min(4, count)
    state = state_of(largest_shifts(centre, areas > 0), largest_turns(quaternion))
    share = areas.sum(1).max() / mask[0].size
    if not ((state == 1) & seen).any() or not LEAST_AREA < share < MOST_AREA or seen.sum() < max(1, bodies - 2):
        return None
    look = sample_looks(rng, bodies)
    pictured = rng.random() < 0.5
    if pictured:
        grey = (float(rng.uniform(0.6, 0.95)),) * 3
        look = replace(
            look,
            floor=replace(look.floor, texture="plain", colour=grey, second_colour=grey),
            backdrop=replace(look.backdrop, horizon=grey, zenith=grey, clouds=0.0),
        )
    shadows = bool(rng.random() < 0.9)
    posed = with_empty_scene(position, quaternion)
    frames = render(scene, *posed, camera, look, width, height, mujoco, shadows)
    frames, empty = frames[:-1], frames[-1]
    other = label_shadows(frames, empty, mask)
    if rng.random() < 0.25:  # motion blur
        for k in (-0.33, 0.33):
            blurred = poses_at(trace, steps + k * rng.uniform(0.2, 0.95) * interval * STEPS_PER_SECOND)
            frames += render(scene, *blurred, camera, look, width, height, mujoco, shadows)
        frames /= 3
    if pictured:
        clear = mask == 0
        brightest = np.percentile(frames[0][clear[0]], 90) if clear[0].any() else 255.0
        picture = sample_background(rng, width, height) * (255 / max(brightest, 60.0))
        # A rim of half-covered pixels takes the picture's share by the mask's own soft edge.
        for t in range(count):
            soft = cv2.GaussianBlur(clear[t].astype(np.float32), (0, 0), 0.5)[..., None]
            frames[t] *= 1 + soft * (picture - 1)
    if rng.random() < 0.25:
        ground = np.isfinite(full.depth)
        other[mirror_image(rng, scene, position, quaternion, camera, look, frames, mask, ground)] = OTHER
    frames = np.clip(frames, 0, 255)
    times = np.linspace(0, 1, count)
    if rng.random() < 0.08:
        frames *= sample_passing_shadow(rng, width, height, times)
    mask = mask.copy()
    _add_intruders(rng, frames, mask, other, centre, times)
    radius = body_radii(scene, camera, depth, height)
    return DrawnClip(frames, mask, other, centre.astype(np.float32), radius.astype(np.float32), state)


def body_radii(scene: Scene, camera: Pinhole, depth: np.ndarray, height: int) -> np.ndarray:
    """(T, N) px: geometric means of the bodies' half extents in a picture `height` px high. depth: (T, N) m."""
    size = np.array([np.cbrt(np.prod(half_extents(o))) for o in scene.objects])
    return np.asarray(focal_px(camera.fov_y_deg, height) * size / depth)


def _add_intruders(
    rng: np.random.Generator,
    frames: np.ndarray,
    mask: np.ndarray,
    other: np.ndarray,
    centre: np.ndarray,
    times: np.ndarray,
) -> None:
    """Draw hands and cloth over frames (T, H, W, 3), and write them into mask and other (T, H, W), in place."""
    height, width = mask.shape[1:]
    layers = []
    if rng.random() < 0.25:
        body = int(rng.integers(centre.shape[1]))
        target = centre[:, body] + rng.normal(0, 6, 2)
        release = float(rng.uniform(0.1, 0.6)) if rng.random() < 0.3 else None
        hand = sample_hand(rng, width, height, target, log_uniform(rng, 0.03, 0.18) * height, times, release)
        layers.append(lambda t: draw_hand(hand, t, width, height))
    if rng.random() < 0.08:
        cloth = sample_cloth(rng, width, height, times)
        layers.append(lambda t: draw_cloth(cloth, t, width, height))
    for layer_at in layers:
        for t in range(len(frames)):
            layer = layer_at(t)
            layer[..., :3] *= 255
            layer_over(frames[t], layer, (slice(None), slice(None)))
            covered = layer[..., 3] > 0.5
            mask[t][covered] = 0
            other[t][covered] = OTHER
