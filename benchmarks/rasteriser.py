"""Times of the rasteriser, of `mj_multiRay` and of MuJoCo's segmentation renderer, in one run.

    python -m benchmarks.rasteriser [--scenes 20] [--frames 10] [--width 120] [--height 80]

Every rival draws the same frames of the same scenes: bodies in free flight before a camera like the paper's. Times
are per clip of `--frames` frames, the median over the scenes of the best of a few runs, on one core.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import mujoco
import numpy as np

from pipeline.errors import ParamsError
from pipeline.scene.mjcf import scene_mjcf
from pipeline.scene.rotation import integrate
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.vision.rendering.appearance import Appearance, plain_appearance
from pipeline.vision.rendering.camera import Pinhole, focal_px, pinhole
from pipeline.vision.rendering.exact_flow import exact_flow
from pipeline.vision.rendering.rasteriser import background_depth, rasterise, rasterise_frames
from pipeline.vision.rendering.render_backend import choose_backend
from pipeline.vision.rendering.shade import shade
from pipeline.vision.rendering.surface import shape_arrays

SHAPES = {"sphere": (0.16,), "cylinder": (0.13, 0.32), "box": (0.25, 0.3, 0.25), "capsule": (0.1, 0.4)}


def sample_clip(rng: np.random.Generator, frames: int) -> tuple[Scene, np.ndarray, np.ndarray]:
    """A scene of two to four objects, its positions (F, N, 3) and quaternions (F, N, 4)."""
    count = int(rng.integers(2, 5))
    shapes = rng.choice(list(SHAPES), count)
    camera = Camera((0, -2, float(rng.uniform(0.5, 1.2))), 42, pitch=float(rng.uniform(-28, -12)))
    scene = Scene(tuple(SceneObject(s, SHAPES[s], 1.0) for s in shapes), camera)
    start = np.stack([np.linspace(-0.5, 0.5, count), rng.uniform(-0.2, 0.6, count), np.full(count, 0.4)], axis=1)
    q = rng.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    velocity, omega = rng.normal(size=(count, 3)) * [0.5, 0.5, 0.2], rng.normal(size=(count, 3)) * 3
    times = np.linspace(0, 1, frames)
    return scene, np.stack([start + t * velocity for t in times]), np.stack([integrate(q, omega, t) for t in times])


def seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """The best of a few runs, after one that warms up."""
    work()
    best = np.inf
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        best = min(best, time.perf_counter() - start)
    return best


def kernel_run(
    scene: Scene, positions: np.ndarray, quaternions: np.ndarray, camera: Pinhole, width: int, height: int
) -> Callable[[], np.ndarray]:
    """The kernel alone, into buffers that are there, as a search calls it."""
    mask = np.empty((len(positions), height, width), dtype=np.uint8)
    depth = np.empty(mask.shape, dtype=np.float32)
    view = (camera.position_world, camera.rotation_world, camera.fov_y_deg)
    background = background_depth(camera, width, height, 0.0, ())
    arguments = (*shape_arrays(scene.objects), positions, quaternions, *view, background, mask, depth)

    def work() -> np.ndarray:
        rasterise_frames(*arguments)
        return mask

    return work


def ray_run(
    model: mujoco.MjModel, positions: np.ndarray, quaternions: np.ndarray, camera: Pinhole, width: int, height: int
) -> Callable[[], np.ndarray]:
    """`mj_multiRay` with one ray a pixel."""
    data = mujoco.MjData(model)
    focal = focal_px(camera.fov_y_deg, height)
    x, y = (np.arange(width) + 0.5 - width / 2) / focal, (height / 2 - np.arange(height) - 0.5) / focal
    rays = np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), np.full((height, width), -1.0)], axis=-1)
    directions = (rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ camera.rotation_world.T).ravel()
    geom, distance = np.empty(width * height, dtype=np.int32), np.empty(width * height)
    body = np.append(model.geom_bodyid, 0).astype(np.uint8)
    mask = np.empty((len(positions), height, width), dtype=np.uint8)

    def work() -> np.ndarray:
        for k in range(len(positions)):
            data.qpos[:] = np.concatenate([positions[k], quaternions[k]], axis=1).ravel()
            mujoco.mj_kinematics(model, data)
            eye = camera.position_world
            mujoco.mj_multiRay(model, data, eye, directions, None, 1, -1, geom, distance, None, len(geom), 1e9)
            mask[k] = body[geom].reshape(height, width)
        return mask

    return work


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("scenes", 20), ("frames", 10), ("width", 120), ("height", 80), ("seed", 0)):
        parser.add_argument(f"--{name}", type=int, default=default, help=f"default {default}")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    width, height = options.width, options.height
    try:
        _, reason = choose_backend("mujoco")
        from pipeline.vision.rendering.mujoco_render import Canvas
    except ParamsError as problem:
        reason = f"left out: {problem}"
    has_gl = not reason.startswith("left out")
    ours, rays, gl, flow, rgb = [], [], [], [], []
    agreement, agreement_gl, area = [], [], []
    for _ in range(options.scenes):
        scene, positions, quaternions = sample_clip(rng, options.frames)
        assert scene.camera is not None
        camera = pinhole(scene.camera)
        root = scene_mjcf(scene)
        getattr(root.visual, "global").offwidth, getattr(root.visual, "global").offheight = width, height
        root.visual.quality.offsamples = 0
        model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
        clip = (positions, quaternions, camera, width, height)
        draw, cast = kernel_run(scene, *clip), ray_run(model, *clip)
        ours.append(seconds(draw))
        rays.append(seconds(cast, repeats=2))
        agreement.append(float((draw() == cast()).mean()))
        area.append(float((draw() > 0).mean()))
        if has_gl:
            with Canvas(model, width, height) as canvas:

                def segment(canvas: Canvas = canvas, p: np.ndarray = positions, q: np.ndarray = quaternions) -> object:
                    return np.stack([canvas.segmentation(*pose) for pose in zip(p, q, strict=True)])

                gl.append(seconds(segment, repeats=2))
                agreement_gl.append(float((draw() == segment()).mean()))
        seen = rasterise(scene.objects, *clip)

        def flows(scene: Scene = scene, clip: tuple = clip, seen: object = seen) -> object:
            return exact_flow(scene.objects, *clip, rendering=seen)  # type: ignore[arg-type]

        flow.append(seconds(flows))
        appearance = plain_appearance(len(scene.objects))

        def picture(scene: Scene = scene, clip: tuple = clip, appearance: Appearance = appearance) -> object:
            return shade(scene.objects, *clip[:3], appearance, width, height)

        rgb.append(seconds(picture, repeats=2))

    base = float(np.median(ours))
    print(
        f"{options.scenes} scenes of 2 to 4 objects ({np.mean(area):.1%} of the picture), "
        f"{options.frames} frames of {width}x{height}, one core"
    )
    print(f"{'':42} {'ms a clip':>10} {'against ours':>13} {'same pixels':>12}")
    rows = [("masks and depth, ours", ours, None), ("mj_multiRay", rays, agreement)]
    if has_gl:
        rows.append((f"segmentation, {reason}", gl, agreement_gl))
    rows += [
        ("exact flow", flow, None),
        ("RGB, ours, soft shadows", rgb, None),
    ]
    for name, times, same in rows:
        median = float(np.median(times))
        share = f"{np.mean(same):12.3%}" if same else ""
        print(f"{name:42} {1e3 * median:10.3f} {median / base:12.1f}x {share}")
    if not has_gl:
        print(f"MuJoCo's segmentation renderer {reason}")


if __name__ == "__main__":
    main()
