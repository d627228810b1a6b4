"""A scene from what the user gives: a file, an answer or a folder; with a camera where it has none."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from pipeline.errors import SceneError
from pipeline.model.language.completion import read_completion
from pipeline.scene.mjcf import mesh_vertices
from pipeline.scene.scene import Camera, Scene, SceneObject, half_extents
from pipeline.scene.text import load_scene
from pipeline.untrusted import read_bytes

SCENE_FILE = "scene.yaml"
FOV, PITCH = 40.0, -22.0  # deg, of the camera that is made


def read_scene_source(place: Path) -> Scene:
    """The scene of a YAML file, of a model's answer (with its `<answer>`), or of a folder that `dynamics` wrote.

    Raises SceneError.
    """
    if place.is_dir():
        if not (place / SCENE_FILE).is_file():
            raise SceneError(f"{place} has no {SCENE_FILE}; give a scene file, or a folder that `dynamics infer` wrote")
        return load_scene(place / SCENE_FILE)
    if place.suffix.lower() == ".xml":
        raise SceneError(f"{place} is MJCF, which is written and not read; give the {SCENE_FILE} beside it")
    text = read_bytes(place, SceneError).decode("utf-8", errors="replace")
    if "<answer>\n" in text:
        return read_completion(text.strip()).scene
    return load_scene(place)


def with_camera(scene: Scene, positions: np.ndarray) -> tuple[Scene, str | None]:
    """The scene with a camera, and a note where one had to be made: it looks along +y and sees all of positions
    (..., 3), m, of the objects' centres."""
    if scene.camera is not None or not scene.objects:
        return scene, None
    points = positions.reshape(-1, 3)
    low, high = points.min(0), points.max(0)
    centre = (low + high) / 2
    reach = float(np.linalg.norm(high - low)) / 2 + max(_radius(o) for o in scene.objects)
    distance = 1.15 * reach / np.tan(np.radians(FOV / 2))
    pitch = np.radians(PITCH)
    eye = centre + distance * np.array([0.0, -np.cos(pitch), -np.sin(pitch)])
    if scene.ground is not None:
        eye[2] = max(eye[2], scene.ground + 0.1 * distance)
    x, y, z = (round(float(v), 2) for v in eye)
    camera = Camera((x, y, z), fov=FOV, pitch=PITCH)
    note = f"the scene has no camera; one at ({x:g}, {y:g}, {z:g}) m sees the whole motion"
    return replace(scene, camera=camera), note


def _radius(obj: SceneObject) -> float:
    """Of a sphere about the centre that holds the body, m."""
    if obj.shape == "mesh":
        assert obj.file is not None
        return float(np.linalg.norm(mesh_vertices(obj.file), axis=1).max()) * obj.size[0]
    return float(np.linalg.norm(half_extents(obj)))
