"""How many decimals each number of a scene deserves: what the sampler rounds to and the model writes."""

from __future__ import annotations

from dataclasses import replace

from pipeline.scene.scene import Scene, SceneObject

DECIMALS: dict[str, int] = {
    "camera.height": 2,
    "camera.pitch": 2,
    "camera.fov": 2,
    "gravity": 2,
    "size": 3,
    "mass": 2,
    "sliding_friction": 2,
    "rolling_friction": 3,
    "damping": 2,
    "position": 3,
    "velocity": 2,
    "angular_velocity": 2,
    "orientation": 3,
}


def rounded_object(obj: SceneObject) -> SceneObject:
    """The object with every number rounded to the decimals of `DECIMALS`."""
    values: dict[str, object] = {"size": tuple(round(v, DECIMALS["size"]) for v in obj.size)}
    for key in ("mass", "sliding_friction", "rolling_friction", "damping"):
        values[key] = round(getattr(obj, key), DECIMALS[key])
    for key in ("position", "velocity", "angular_velocity", "orientation"):
        values[key] = tuple(round(v, DECIMALS[key]) for v in getattr(obj, key))
    return replace(obj, **values)  # type: ignore[arg-type]


def rounded_scene(scene: Scene) -> Scene:
    """The scene with its objects, a camera with pitch, and a downward gravity rounded likewise."""
    camera = scene.camera
    if camera is not None and camera.pitch is not None:
        x, y, z = camera.position
        camera = replace(camera, position=(x, y, round(z, 2)), pitch=round(camera.pitch, 2), fov=round(camera.fov, 2))
    gravity = tuple(round(v, DECIMALS["gravity"]) for v in scene.gravity)
    return replace(scene, objects=tuple(map(rounded_object, scene.objects)), camera=camera, gravity=gravity)
