"""A scene with other numbers, run and drawn while a slider is moved."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from pipeline.api.export import paths_of
from pipeline.app.sliders import Changes, edits_of
from pipeline.clips.replay import replay_trace
from pipeline.clips.schedule import Schedule
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.edited import edited
from pipeline.scene.scene import Scene
from pipeline.viewer.page.motion_3d import RATE, motion_record
from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.rendering.appearance import object_colour, plain_appearance
from pipeline.vision.rendering.camera import focal_px, pinhole
from pipeline.vision.rendering.rasteriser import rasterise
from pipeline.vision.rendering.render import render_rgb

AREA = 240 * 160  # px² of a picture
COLUMNS = 6
LIGHT = np.array([-0.4, 0.75, 0.55])  # right, up, back


@dataclass(frozen=True)
class LiveScene:
    """What the replays of one clip share.

    Attributes:
        scene: As found; with a camera.
        schedule: Of the clip.
        size: px, width and height, of the pictures.
        trace: The motion as found.
        backdrop: (H, W, 3) uint8, ground and fixed bodies.
    """

    scene: Scene
    schedule: Schedule
    size: tuple[int, int]
    trace: Trace
    backdrop: np.ndarray

    @staticmethod
    def of(scene: Scene, schedule: Schedule, size: tuple[int, int]) -> LiveScene:
        """Prepare a scene; size: px, width and height, of its clip. Raises SimulationError where it is unstable."""
        size = of_area(size, AREA)
        trace = simulate(scene, schedule.seconds)
        assert scene.camera is not None
        eye = pinhole(scene.camera)
        behind_camera = eye.position_world + 1e3 * eye.rotation_world[:, 2]
        away = np.tile(behind_camera, (1, len(scene.objects), 1))
        still = np.tile([1.0, 0.0, 0.0, 0.0], (1, len(scene.objects), 1))
        appearance = plain_appearance(len(scene.objects), len(scene.fixed))
        backdrop = render_rgb(scene, away, still, appearance, *size, "raycast")[0]
        return LiveScene(scene, schedule, size, trace, backdrop)

    def replay(self, changes: Changes) -> dict[str, Any]:
        """The replay with changes, for JSON: `sheet` (JPEG of all frames, COLUMNS a row), its `columns`, `width` and
        `height`, `motion` for the 3D view with the found motion as ghosts, and the `edits`.

        Raises:
            SceneError: A change does not fit the scene.
            SimulationError: The changed scene becomes unstable.
        """
        edits = edits_of(self.scene, changes)
        scene = edited(self.scene, edits) if edits else self.scene
        trace = simulate(scene, self.schedule.seconds) if edits else self.trace
        pictures = self.pictures(scene, trace)
        paths = [*paths_of(scene, trace), *(paths_of(self.scene, self.trace, ghost=True) if edits else [])]
        encoded, data = cv2.imencode(".jpg", sheet(pictures)[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 85])
        assert encoded
        return {
            "sheet": base64.b64encode(data.tobytes()).decode(),
            "columns": COLUMNS,
            "width": self.size[0],
            "height": self.size[1],
            "motion": motion_record(scene, paths, RATE, self.size[0] / self.size[1]),
            "edits": edits,
        }

    def pictures(self, scene: Scene, trace: Trace) -> np.ndarray:
        """(T, H, W, 3) uint8: the bodies in their colours, shaded by the slope of their depth, before the backdrop."""
        width, height = self.size
        run = replay_trace(scene, trace, self.schedule, width, height)
        assert scene.camera is not None
        eye = pinhole(scene.camera)
        drawn = rasterise(scene.objects, run.position, run.quaternion, eye, width, height, scene.ground, scene.fixed)
        out = np.repeat(self.backdrop[None], self.schedule.frames, 0)
        frame, row, col = np.nonzero(drawn.mask)
        colours = np.array([object_colour(i) for i in range(len(scene.objects))], np.float32)
        light = _light(drawn.depth, drawn.mask, frame, row, col, focal_px(eye.fov_y_deg, height))
        shown = colours[drawn.mask[frame, row, col] - 1] * light[:, None]
        out[frame, row, col] = np.clip(shown, 0, 255).astype(np.uint8)
        return out


def _light(
    depth: np.ndarray, mask: np.ndarray, frame: np.ndarray, row: np.ndarray, col: np.ndarray, focal: float
) -> np.ndarray:
    """(K,) How bright a body's pixels are, by the normals that differences of inverse depth 1/z give.

    On a plane n·p = c, 1/z is linear in the picture: its slopes and value are n / c. Slopes over a body's edge are 0.
    """
    height, width = mask.shape[1:]
    inverse, ids = 1 / depth[frame, row, col], mask[frame, row, col]

    def slope(rows: int, cols: int) -> np.ndarray:
        r, c = np.clip(row + rows, 0, height - 1), np.clip(col + cols, 0, width - 1)
        inside = mask[frame, r, c] == ids
        return np.where(inside, 1 / depth[frame, r, c] - inverse, 0.0) * (rows + cols)

    right, down = slope(0, 1), slope(1, 0)
    right, down = np.where(right == 0, slope(0, -1), right), np.where(down == 0, slope(-1, 0), down)
    x, y = (col + 0.5 - width / 2) / focal, (row + 0.5 - height / 2) / focal
    normal = np.stack([focal * right, -focal * down, -(inverse - focal * (x * right + y * down))], -1)
    normal /= -np.linalg.norm(normal, axis=-1, keepdims=True)
    facing = normal @ (LIGHT / np.linalg.norm(LIGHT))
    return np.asarray(0.45 + 0.65 * np.clip(facing, 0, 1))


def sheet(pictures: np.ndarray) -> np.ndarray:
    """Pictures (T, H, W, 3) in one, COLUMNS a row."""
    rows = -(-len(pictures) // COLUMNS)
    padded = np.zeros((rows * COLUMNS, *pictures.shape[1:]), np.uint8)
    padded[: len(pictures)] = pictures
    height, width = pictures.shape[1:3]
    return padded.reshape(rows, COLUMNS, height, width, 3).swapaxes(1, 2).reshape(rows * height, COLUMNS * width, 3)
