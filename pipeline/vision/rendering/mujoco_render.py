"""RGB pictures and segmentations by MuJoCo's renderer."""

from __future__ import annotations

import atexit
import copy
import functools
import importlib
from typing import Any

import mujoco
import numpy as np

from pipeline.scene.mjcf import scene_mjcf
from pipeline.scene.rotation import matrix_from_quaternion
from pipeline.scene.scene import Scene
from pipeline.vision.rendering.appearance import Appearance, clear_view
from pipeline.vision.rendering.mjcf_appearance import add_appearance
from pipeline.vision.rendering.render_backend import gl_platform

_HIDDEN_GROUP = 5  # a geom group that MuJoCo does not draw by default


def render_mujoco(
    scene: Scene,
    positions: np.ndarray,
    quaternions: np.ndarray,
    appearance: Appearance,
    width: int,
    height: int,
    shadows: bool = True,
) -> np.ndarray:
    """Pictures uint8 (F, H, W, 3) from the camera of a scene; arguments as `render.render_rgb`."""
    assert scene.camera is not None
    root = scene_mjcf(scene.without_joints())  # a free body can have any pose
    appearance = clear_view(appearance, scene.camera.position, positions)
    add_appearance(root, appearance, width, height, shadows)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string(), root.get_assets())
    with Canvas(model, width, height) as canvas:
        canvas.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = shadows
        canvas.scene.flags[mujoco.mjtRndFlag.mjRND_HAZE] = True
        pictures = [canvas.picture(p, q) for p, q in zip(positions, quaternions, strict=True)]
    return np.stack(pictures) if pictures else np.empty((0, height, width, 3), dtype=np.uint8)


class Canvas:
    """MuJoCo's offscreen renderer for one model with a free body per object, in order, and the fixed camera `camera`.

    It differs from `mujoco.Renderer` in that one OpenGL context serves the whole process: the first picture in a new
    context takes 0.15 s on a CPU. Use it as a context manager. The offscreen buffer of the model must hold width x
    height.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self.model = _without_planes_behind(model)
        self.data = mujoco.MjData(self.model)
        self.scene = mujoco.MjvScene(model, maxgeom=1000)
        self._option, self._eye = mujoco.MjvOption(), mujoco.MjvCamera()
        self._eye.type = mujoco.mjtCamera.mjCAMERA_FIXED
        self._eye.fixedcamid = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "camera")
        self._rectangle = mujoco.MjrRect(0, 0, width, height)
        _gl_context(gl_platform(), width, height).make_current()
        self._context = mujoco.MjrContext(model, mujoco.mjtFontScale.mjFONTSCALE_50.value)
        mujoco.mjr_setBuffer(mujoco.mjtFramebuffer.mjFB_OFFSCREEN.value, self._context)
        # Body of each geom; the last entry is for pixels that show no geom.
        self._body = np.append(model.geom_bodyid, 0).astype(np.uint8)

    def __enter__(self) -> Canvas:
        return self

    def __exit__(self, *_: Any) -> None:
        self._context.free()

    def picture(self, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
        """RGB uint8 (H, W, 3) with the bodies at position (N, 3) m and quaternion (N, 4)."""
        self.data.qpos[:] = np.concatenate([position, quaternion], axis=1).ravel()
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_comPos(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)
        everything = mujoco.mjtCatBit.mjCAT_ALL.value
        mujoco.mjv_updateScene(self.model, self.data, self._option, None, self._eye, everything, self.scene)
        mujoco.mjr_render(self._rectangle, self.scene, self._context)
        pixels = np.empty((self._rectangle.height, self._rectangle.width, 3), dtype=np.uint8)
        mujoco.mjr_readPixels(pixels, None, self._rectangle, self._context)
        return pixels[::-1]

    def segmentation(self, position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
        """Mask uint8 (H, W) as from `rasterise`: 0 for background and ground, i + 1 for object i."""
        flags = (mujoco.mjtRndFlag.mjRND_SEGMENT, mujoco.mjtRndFlag.mjRND_IDCOLOR)
        for flag in flags:
            self.scene.flags[flag] = True
        colour = self.picture(position, quaternion).astype(np.int64)
        for flag in flags:
            self.scene.flags[flag] = False
        segment = colour @ np.array([1, 256, 65536])  # 0: background, else index in the scene + 1
        geoms = np.array([g.objid for g in self.scene.geoms[: self.scene.ngeom]], dtype=np.int64)
        return self._body[np.append(-1, geoms)[segment]]


def _without_planes_behind(model: mujoco.MjModel) -> mujoco.MjModel:
    """The model without the planes that its camera sees from below, where MuJoCo draws them half transparent."""
    eye = model.cam_pos[mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, "camera")]
    planes = np.flatnonzero(model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE)
    normals = matrix_from_quaternion(model.geom_quat[planes])[:, :, 2]
    behind = planes[np.sum((eye - model.geom_pos[planes]) * normals, 1) < 0]
    if len(behind):
        model = copy.copy(model)
        model.geom_group[behind] = _HIDDEN_GROUP
    return model


@functools.cache
def _gl_context(platform: str, width: int, height: int) -> Any:
    context = importlib.import_module(f"mujoco.{platform}").GLContext(width, height)
    atexit.register(context.free)
    return context
