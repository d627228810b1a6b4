"""RGB pictures of a moving scene, by whichever renderer works here."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from pipeline.errors import SceneError
from pipeline.scene.scene import Scene
from pipeline.vision.appearance import Appearance
from pipeline.vision.camera import pinhole
from pipeline.vision.mujoco_render import render_mujoco
from pipeline.vision.shade import shade


def render_raycast(
    scene: Scene,
    positions: np.ndarray,
    quaternions: np.ndarray,
    appearance: Appearance,
    width: int,
    height: int,
    shadows: bool = True,
) -> np.ndarray:
    """Pictures uint8 (F, H, W, 3) by our own ray caster. Raises SceneError on a mesh."""
    assert scene.camera is not None
    camera = pinhole(scene.camera)
    return shade(scene.objects, positions, quaternions, camera, appearance, width, height, scene.ground, shadows)


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
    """Pictures uint8 (F, H, W, 3) of a scene's camera: positions (F, N, 3) m, quaternions (F, N, 4) wxyz.

    backend: "mujoco" or "raycast" (`render_backend.choose_backend`). Raises SceneError where there is no camera, or
    a mesh that the ray caster cannot show.
    """
    if scene.camera is None:
        raise SceneError("camera: missing; a picture needs one")
    return RENDERERS[backend](scene, positions, quaternions, appearance, width, height, shadows)
