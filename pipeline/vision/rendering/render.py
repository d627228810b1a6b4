"""RGB pictures of a moving scene, by MuJoCo's renderer or the ray caster."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.errors import SceneError
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import Appearance, clear_view
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.mujoco_render import render_mujoco
from pipeline.vision.rendering.shade import shade


def render_raycast(
    scene: Scene,
    positions: np.ndarray,
    quaternions: np.ndarray,
    appearance: Appearance,
    width: int,
    height: int,
    shadows: bool = True,
) -> np.ndarray:
    """Pictures uint8 (F, H, W, 3) by the ray caster; arguments as `render_rgb`. Raises SceneError for a mesh."""
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    appearance = clear_view(appearance, scene.camera.position, positions)
    return shade(
        scene.objects,
        positions,
        quaternions,
        camera,
        appearance,
        width,
        height,
        scene.ground,
        shadows,
        fixed=scene.fixed,
    )


RENDERERS: dict[str, Callable[..., np.ndarray]] = {"mujoco": render_mujoco, "raycast": render_raycast}


def render_rgb(
    scene: Scene,
    positions: np.ndarray,
    quaternions: np.ndarray,
    appearance: Appearance,
    width: int,
    height: int,
    backend: str,
    shadows: bool = True,
) -> np.ndarray:
    """Pictures uint8 (F, H, W, 3) from the camera of a scene.

    Args:
        scene: The scene, with a camera.
        positions: (F, N, 3) m.
        quaternions: (F, N, 4) wxyz.
        appearance: Materials, floor, backdrop and lights.
        width: Width of the pictures, px.
        height: Height of the pictures, px.
        backend: "mujoco" or "raycast", from `render_backend.choose_backend`.
        shadows: Whether lights cast shadows.

    Raises:
        SceneError: The scene has no camera, or a mesh that the ray caster does not support.
    """
    if scene.camera is None:
        raise SceneError("camera: missing; a picture needs one")
    return RENDERERS[backend](scene, positions, quaternions, appearance, width, height, shadows)
