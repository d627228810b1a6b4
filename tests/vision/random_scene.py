"""Random scenes of analytic shapes before a random camera, and what MuJoCo's rays see of them."""

from dataclasses import dataclass

import mujoco
import numpy as np

from pipeline.scene.scene import FIXED_SIZE_KEYS, SIZE_KEYS, FixedBody, SceneObject, half_extents
from pipeline.vision.rendering.camera import Pinhole, focal_px
from pipeline.vision.rendering.surface import KINDS

WIDTH, HEIGHT = 120, 80


@dataclass(frozen=True)
class View:
    """Objects with poses position (N, 3), quaternion (N, 4), a camera, a ground at z = 0 or none, and fixed bodies."""

    objects: tuple[SceneObject, ...]
    position: np.ndarray
    quaternion: np.ndarray
    camera: Pinhole
    ground: float | None = 0.0
    fixed: tuple[FixedBody, ...] = ()


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def random_object(rng: np.random.Generator, shape: str | None = None) -> SceneObject:
    shape = shape or str(rng.choice(list(KINDS)))
    size = rng.uniform(0.05, 0.5, len(SIZE_KEYS[shape]))
    if shape == "capsule":
        size[1] += 2 * size[0]
    return SceneObject(shape, tuple(size), mass=1.0)


def random_camera(rng: np.random.Generator, target: np.ndarray, distance: float) -> Pinhole:
    """Somewhere about the target, which is in view, with any roll."""
    eye = target + distance * unit(rng.normal(size=3))
    back = unit(eye - target + 0.15 * distance * rng.uniform(-1, 1, 3))
    right = unit(np.cross(rng.normal(size=3), back))
    return Pinhole(eye, np.stack([right, np.cross(back, right), back], axis=1), float(rng.uniform(20, 100)))


def random_view(rng: np.random.Generator, shape: str | None = None, near: bool = False) -> View:
    """One to four objects; from 1.5 to 3 m, or `near`: among them, where some lie about or behind the camera."""
    count = int(rng.integers(1, 5))
    position = rng.uniform([-0.6, -0.6, -0.1], [0.6, 0.6, 0.8], (count, 3))
    camera = random_camera(rng, position[0], float(rng.uniform(0.05, 0.6) if near else rng.uniform(1.5, 3.0)))
    objects = tuple(random_object(rng, shape) for _ in range(count))
    return View(objects, position, unit(rng.normal(size=(count, 4))), camera, 0.0 if rng.random() < 0.8 else None)


def random_fixed(rng: np.random.Generator, shape: str | None = None) -> FixedBody:
    shape = shape or str(rng.choice([s for s in FIXED_SIZE_KEYS if s != "mesh"]))
    size = rng.uniform(0.1, 1.0, len(FIXED_SIZE_KEYS[shape]))
    if shape == "capsule":
        size[1] += 2 * size[0]
    return FixedBody(shape, tuple(size), tuple(rng.uniform(-0.8, 0.8, 3)), tuple(rng.normal(size=4)))


def pixel_rays(camera: Pinhole) -> np.ndarray:
    """Directions (H, W, 3), world, of planar depth one."""
    focal = focal_px(camera.fov_y_deg, HEIGHT)
    x = (np.arange(WIDTH) + 0.5 - WIDTH / 2) / focal
    y = (HEIGHT / 2 - np.arange(HEIGHT) - 0.5) / focal
    local = np.stack([*np.broadcast_arrays(x[None, :], y[:, None]), np.full((HEIGHT, WIDTH), -1.0)], axis=-1)
    return local @ camera.rotation_world.T


def geom_xml(obj: SceneObject | FixedBody, position: np.ndarray, quaternion: np.ndarray) -> str:
    half = half_extents(obj).tolist()
    size = {
        "plane": [0.0, 0.0, 1.0],
        "sphere": half[:1],
        "cylinder": [half[0], half[2]],
        "capsule": [half[0], half[2] - half[0]],
        "box": half,
        "ellipsoid": half,
    }[obj.shape]
    numbers = [" ".join(map(repr, v)) for v in (size, position.tolist(), quaternion.tolist())]
    return '<geom type="{}" size="{}" pos="{}" quat="{}"/>'.format(obj.shape, *numbers)


def mujoco_sees(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Mask (H, W) and planar depth (H, W) as `mj_multiRay` gives them."""
    plane = '<geom type="plane" size="0 0 1"/>' if view.ground is not None else ""
    geoms = "".join(map(geom_xml, view.objects, view.position, view.quaternion))
    geoms += "".join(geom_xml(b, np.array(b.position), np.array(b.orientation)) for b in view.fixed)
    model = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{geoms}{plane}</worldbody></mujoco>")
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    rays = pixel_rays(view.camera).reshape(-1, 3)
    length = np.linalg.norm(rays, axis=1)
    geom = np.empty(len(rays), dtype=np.int32)
    distance = np.empty(len(rays))
    directions = (rays / length[:, None]).ravel()
    eye = view.camera.position_world
    mujoco.mj_multiRay(model, data, eye, directions, None, 1, -1, geom, distance, None, len(rays), 1e9)
    mask = np.where((geom < 0) | (geom >= len(view.objects)), 0, geom + 1)
    depth = np.where(geom < 0, np.inf, distance / length)
    return mask.reshape(HEIGHT, WIDTH), depth.reshape(HEIGHT, WIDTH)
