"""Adds an `Appearance` to an MJCF document, so that MuJoCo's renderer shows what the ray caster `shade` shows.

The procedural textures are baked into cube maps, once per clip. Textures, materials, lights and render quality are
added; the physics is not changed.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from dm_control import mjcf
from PIL import Image

from pipeline.compiled import kernel
from pipeline.scene.mjcf import FIXED_GROUP
from pipeline.vision.rendering.appearance import Appearance, Backdrop, Colour, Material
from pipeline.vision.rendering.shading_tables import sky_colour
from pipeline.vision.rendering.surface import CAPSULE, KINDS, intersect
from pipeline.vision.rendering.texture import TEXTURES, texture

#: Faces of a cube map in the order of the picture: axis and sign of the normal, then axis and sign of the columns, then
#: of the rows. R, L, U, D, F, B of MuJoCo's `gridlayout` are OpenGL's +x, -x, +y, -y, +z, -z.
_FACES = (
    (0, 1, 2, -1, 1, -1),
    (0, -1, 2, 1, 1, -1),
    (1, 1, 0, 1, 2, 1),
    (1, -1, 0, 1, 2, -1),
    (2, 1, 0, 1, 1, -1),
    (2, -1, 0, -1, 1, -1),
)
_FLOOR_TILE_M = 8.0  # period of the floor texture
_SHADOW_MAP = 1024
_OBJECT_PX, _FLOOR_PX = 64, 512  # side of the faces of an object's cube map; of the floor's texture
_FIXED_TEXTURE = 4  # side of the texture of a fixed body, over that of an object: ramps and walls are large
_EXTENT_M = 4.0  # width of the shadow map of a directional light


def add_appearance(
    root: mjcf.RootElement,
    appearance: Appearance,
    width: int,
    height: int,
    shadows: bool = True,
) -> None:
    """Add an appearance to the document of a scene (`scene_mjcf`).

    Compile the document with `root.get_assets()`: the textures are files in memory.

    Args:
        root: The document; it is changed. Its bodies and its fixed bodies take their materials in order; its plane is
            named `ground`.
        appearance: What to add.
        width: Width of the pictures, px.
        height: Height of the pictures, px.
        shadows: Whether lights cast shadows.
    """
    quality = getattr(root.visual, "global")
    quality.offwidth, quality.offheight = width, height
    root.visual.quality.shadowsize = _SHADOW_MAP
    root.visual.quality.offsamples = 0
    headlight = root.visual.headlight
    headlight.ambient, headlight.diffuse, headlight.specular = [appearance.ambient] * 3, [0] * 3, [0] * 3
    places = np.array([body.pos for body in root.worldbody.body]).reshape(-1, 3)
    root.statistic.extent = _EXTENT_M
    root.statistic.center = places.mean(0) if len(places) else np.zeros(3)
    root.visual.map.zfar = 2.0 * appearance.haze / _EXTENT_M
    root.visual.map.znear = 0.02 / _EXTENT_M
    root.visual.rgba.haze = [*appearance.backdrop.horizon, 1]
    root.visual.map.haze = 0.7  # share of the distance to the horizon, zfar, that the haze covers
    for i, light in enumerate(appearance.lights):
        far = light.position is None
        place = light.position or tuple(4 * v for v in light.towards or ())
        root.worldbody.add(
            "light",
            name=f"light_{i}",
            pos=place,
            dir=[-v for v in place],
            directional=far,
            diffuse=light.colour,
            specular=light.colour,
            ambient=[0, 0, 0],
            attenuation=[1, 0, 0],
            cutoff=75,
            exponent=0,
            castshadow=shadows,
        )
    _add_cube(root, "sky", _sky_faces(appearance.backdrop, 128), type="skybox")
    moving = [body.geom[0] for body in root.worldbody.body]
    fixed = [geom for geom in root.worldbody.geom if geom.group == FIXED_GROUP]
    assert len(moving) == len(appearance.materials), "an appearance has one material for each object"
    assert len(fixed) == len(appearance.fixed), "an appearance has one material for each fixed body"
    materials = (*appearance.materials, *appearance.fixed)
    for i, (geom, material) in enumerate(zip([*moving, *fixed], materials, strict=True)):
        name = f"material_{i}"
        if geom.type == "plane":
            _add_floor(root, geom, name, material, _FLOOR_PX)
            continue
        side = _OBJECT_PX * (1 if i < len(moving) else _FIXED_TEXTURE)
        _add_cube(root, name, _object_faces(geom, material, side), type="cube")
        _add_material(root, name, material, texuniform=False)
        geom.material = name
    ground = root.find("geom", "ground")
    if ground is not None:
        _add_floor(root, ground, "floor", appearance.floor, _FLOOR_PX)


def _add_floor(root: mjcf.RootElement, plane: Any, name: str, material: Material, size: int) -> None:
    """Give a plane the texture of a material; size: its side, px."""
    root.asset.add("texture", name=name, type="2d", file=_png(_floor_picture(material, size)))
    _add_material(root, name, material, texuniform=True, texrepeat=[2 / _FLOOR_TILE_M] * 2)
    plane.material = name


def _add_material(root: mjcf.RootElement, name: str, material: Material, **keys: Any) -> None:
    root.asset.add(
        "material",
        name=name,
        texture=name,
        specular=min(1.0, material.specular + material.mirror),
        shininess=min(1.0, material.shininess / 128),
        **keys,
    )


def _add_cube(root: mjcf.RootElement, name: str, faces: np.ndarray, **keys: Any) -> None:
    """Add a cube map with faces uint8 (6, S, S, 3) in the order of `_FACES`."""
    strip = faces.reshape(-1, faces.shape[2], 3)
    root.asset.add("texture", name=name, file=_png(strip), gridsize=[6, 1], gridlayout="RLUDFB", **keys)


def _png(picture: np.ndarray) -> mjcf.Asset:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="png", compress_level=0)
    return mjcf.Asset(buffer.getvalue(), ".png")


def cube_points(size: int) -> np.ndarray:
    """Centres (6, S, S, 3) of the texels of a cube map on the cube [-1, 1]³, in the order of `_FACES`."""
    centres = (np.arange(size) + 0.5) / size * 2 - 1
    points = np.empty((6, size, size, 3))
    for face, (axis, sign, col_axis, col_sign, row_axis, row_sign) in enumerate(_FACES):
        points[face, :, :, axis] = sign
        points[face, :, :, col_axis] = col_sign * centres[None, :]
        points[face, :, :, row_axis] = row_sign * centres[:, None]
    return points


@kernel
def _bake_texture(
    shape: int, half: np.ndarray, kind: int, scale: float, seed: int, points: np.ndarray, texel: float, mix: np.ndarray
) -> None:
    """Evaluate the texture on a shape, at the points where rays from its centre through the texels leave it.

    Args:
        shape: Code of the shape; -1 for the cube itself.
        half: Half extents, (3,) m. MuJoCo stretches the cube map over the shape by them.
        kind: Code of the texture.
        scale: Size of the texture's features, m.
        seed: Variant of the texture.
        points: (M, 3) on the cube [-1, 1]³.
        texel: Size of a texel, m.
        mix: (M,), output: share of the second colour.
    """
    for m in range(points.shape[0]):
        x, y, z = points[m, 0] * half[0], points[m, 1] * half[1], points[m, 2] * half[2]
        t = 1.0 if shape < 0 else intersect(shape, half[0], half[1], half[2], 0.0, 0.0, 0.0, x, y, z)
        mix[m] = texture(kind, scale, seed, t * x, t * y, t * z, texel)


def _object_faces(geom: Any, material: Material, size: int) -> np.ndarray:
    """The cube map uint8 (6, S, S, 3) of a geom with the texture of a material; for a mesh, that of a cube."""
    kind, half = KINDS.get(geom.type, -1), np.full(3, 0.15)
    if kind >= 0:
        sizes = [float(v) for v in geom.size]
        if geom.type == "sphere":
            half = np.full(3, sizes[0])
        elif geom.type in ("cylinder", "capsule"):
            half = np.array([sizes[0], sizes[0], sizes[1] + (sizes[0] if kind == CAPSULE else 0.0)])
        else:
            half = np.array(sizes)
    points = cube_points(size).reshape(-1, 3)
    mix = np.empty(len(points))
    _bake_texture(
        kind, half, TEXTURES[material.texture], material.scale, material.seed, points, 2 * half.mean() / size, mix
    )
    return _blend(material.colour, material.second_colour, mix).reshape(6, size, size, 3)


def _floor_picture(material: Material, size: int) -> np.ndarray:
    """The texture of the floor, uint8 (S, S, 3), of a square tile centred on the origin, y up."""
    centres = ((np.arange(size) + 0.5) / size - 0.5) * _FLOOR_TILE_M
    points = np.zeros((size, size, 3))
    points[..., 0], points[..., 1] = centres[None, :], -centres[:, None]
    mix = np.empty(size * size)
    flat = np.ones(3)
    _bake_texture(
        -1,
        flat,
        TEXTURES[material.texture],
        material.scale,
        material.seed,
        points.reshape(-1, 3),
        _FLOOR_TILE_M / size,
        mix,
    )
    return _blend(material.colour, material.second_colour, mix).reshape(size, size, 3)


def _sky_faces(backdrop: Backdrop, size: int) -> np.ndarray:
    """The backdrop as a cube map uint8 (6, S, S, 3). The second axis of a sky box points up."""
    points = cube_points(size).reshape(-1, 3)
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    world = np.stack([directions[:, 0], -directions[:, 2], directions[:, 1]], axis=1)
    return sky_colour(backdrop, world).reshape(6, size, size, 3)


def _blend(first: Colour, second: Colour, mix: np.ndarray) -> np.ndarray:
    colours = np.array(first) + mix[..., None] * (np.array(second) - np.array(first))
    return (255 * np.clip(colours, 0, 1) + 0.5).astype(np.uint8)
