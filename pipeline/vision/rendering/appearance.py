"""The appearance of a scene: materials, floor, backdrop and lights; and the sensor of the camera.

Colours are RGB in [0, 1], in display space. An appearance does not affect geometry or motion.
"""

from __future__ import annotations

import colorsys
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from pipeline.vision.rendering.texture import TEXTURES

Colour = tuple[float, float, float]
BACKDROPS = ("plain", "gradient", "clouds")
_BRIGHTEST = 1.1  # upper bound of the sum of ambient light and all lights


@dataclass(frozen=True)
class Material:
    """The material of a surface.

    Attributes:
        colour: First colour.
        second_colour: Colour that the texture mixes in.
        texture: A key of `TEXTURES`.
        scale: Size of the texture's features, m.
        specular: Specular coefficient of Blinn-Phong shading.
        shininess: Specular exponent of Blinn-Phong shading.
        mirror: Share of the light that is reflected as by a mirror.
        seed: Variant of the texture.
    """

    colour: Colour
    second_colour: Colour = (0.0, 0.0, 0.0)
    texture: str = "plain"
    scale: float = 0.1
    specular: float = 0.2
    shininess: float = 30.0
    mirror: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Light:
    """A directional light or a point light, with soft shadows where its radius is not zero.

    Attributes:
        colour: Colour times intensity.
        towards: Unit vector towards a directional light; None for a point light.
        position: Position of a point light, (3,) m; None for a directional light.
        radius: Radius of its disc, m; for a directional light, of a disc at a distance of 1 m.
    """

    colour: Colour
    towards: tuple[float, float, float] | None = None
    position: tuple[float, float, float] | None = None
    radius: float = 0.0

    def __post_init__(self) -> None:
        assert (self.towards is None) != (self.position is None), "a light has either a direction or a position"


@dataclass(frozen=True)
class Backdrop:
    """The background behind objects and floor: a gradient with noise.

    Attributes:
        horizon: Colour at the horizon.
        zenith: Colour above.
        clouds: Strength of the noise, 0 to 1.
        seed: Variant of the noise.
    """

    horizon: Colour = (0.75, 0.82, 0.9)
    zenith: Colour = (0.35, 0.5, 0.75)
    clouds: float = 0.0
    seed: int = 0


@dataclass(frozen=True)
class Appearance:
    """What the objects and their surroundings look like.

    Attributes:
        materials: One for each object, in the order of the scene.
        floor: Material of the ground.
        backdrop: The background.
        lights: All lights.
        ambient: Intensity of the ambient light.
        haze: Distance over which the floor fades into the backdrop, m.
        fixed: Materials, one for each fixed body, in the order of the scene.
    """

    materials: tuple[Material, ...]
    floor: Material
    backdrop: Backdrop
    lights: tuple[Light, ...]
    ambient: float = 0.35
    haze: float = 12.0
    fixed: tuple[Material, ...] = ()


@dataclass(frozen=True)
class Sensor:
    """The sensor of a camera.

    Attributes:
        noise: Standard deviation, as a share of full scale.
        blur: Sigma of a Gaussian, px.
        gamma: Exponent.
        brightness: Factor.
    """

    noise: float = 0.0
    blur: float = 0.0
    gamma: float = 1.0
    brightness: float = 1.0


def clear_view(appearance: Appearance, eye: Sequence[float], positions: np.ndarray) -> Appearance:
    """The appearance with haze that begins behind the objects, however far they are.

    eye: (3,) m, the camera. positions: (F, N, 3) m.
    """
    if not positions.size:
        return appearance
    distance = float(np.linalg.norm(positions.reshape(-1, 3) - np.asarray(eye), axis=1).max())
    return replace(appearance, haze=max(appearance.haze, 2 * distance))


#: Object colours of the plain appearance, with well separated hues.
PALETTE: tuple[Colour, ...] = (
    (0.84, 0.24, 0.20),
    (0.18, 0.45, 0.80),
    (0.95, 0.72, 0.18),
    (0.25, 0.62, 0.33),
    (0.58, 0.32, 0.68),
    (0.20, 0.68, 0.70),
    (0.93, 0.50, 0.20),
    (0.85, 0.45, 0.62),
)


def object_colour(index: int) -> tuple[int, int, int]:
    """RGB in 0 to 255 in which object `index` is drawn in every picture, plot and viewer."""
    red, green, blue = PALETTE[index % len(PALETTE)]
    return round(255 * red), round(255 * green), round(255 * blue)


def plain_appearance(n_objects: int, n_fixed: int = 0) -> Appearance:
    """The default appearance: a checkerboard floor, checkered objects in the colours of `PALETTE`, one light.

    Fixed bodies are grey and checkered.
    """
    materials = tuple(
        Material(colour, tuple(0.55 * c for c in colour), "checker", 0.12, seed=i)  # type: ignore[arg-type]
        for i, colour in enumerate(PALETTE[i % len(PALETTE)] for i in range(n_objects))
    )
    floor = Material((0.62, 0.63, 0.65), (0.47, 0.48, 0.51), "checker", 0.4, specular=0.0)
    light = Light((0.75, 0.75, 0.72), towards=_unit((-0.35, -0.45, 1.0)), radius=0.05)
    fixed = tuple(Material((0.71, 0.69, 0.66), (0.6, 0.58, 0.55), "checker", 0.2, seed=i) for i in range(n_fixed))
    return Appearance(materials, floor, Backdrop(), (light,), fixed=fixed)


def sample_appearance(
    rng: np.random.Generator,
    n_objects: int,
    *,
    textures: dict[str, float] | None = None,
    floor_textures: dict[str, float] | None = None,
    backdrops: dict[str, float] | None = None,
    max_lights: int = 2,
    point_light_probability: float = 0.3,
    soft_shadow_probability: float = 0.6,
    metal_probability: float = 0.1,
    texture_scale: tuple[float, float] = (0.05, 0.16),
    floor_scale: tuple[float, float] = (0.1, 0.7),
    ambient: tuple[float, float] = (0.25, 0.5),
    n_fixed: int = 0,
) -> Appearance:
    """A random appearance.

    Args:
        rng: Random generator.
        n_objects: Number of objects.
        textures: Weights of the objects' textures, by key of `TEXTURES`; None: equal, but fewer plain ones.
        floor_textures: Weights of the floor's textures; None: mostly checkers and noise.
        backdrops: Weights of the backdrops, by `BACKDROPS`; None: equal.
        max_lights: Largest number of lights.
        point_light_probability: Share of lights that are point lights.
        soft_shadow_probability: Share of lights with soft shadows.
        metal_probability: Share of objects with a mirror reflection.
        texture_scale: Range of the size of features, m, log-uniform.
        floor_scale: Range of the size of the floor's features, m, log-uniform.
        ambient: Range of the ambient light.
        n_fixed: Number of fixed bodies, which have textures and scales like the floor's.

    Raises:
        ValueError: A kind is unknown, or all weights are zero.
    """
    textures = textures or {"plain": 0.5, "stripes": 1.0, "checker": 1.0, "noise": 1.0, "spots": 1.0}
    floor_textures = floor_textures or {"plain": 0.4, "stripes": 0.5, "checker": 1.5, "noise": 1.5, "spots": 0.3}
    backdrops = backdrops or {"plain": 1.0, "gradient": 1.0, "clouds": 1.0}
    _check_weights(textures, TEXTURES, "textures")
    _check_weights(floor_textures, TEXTURES, "floor_textures")
    _check_weights(backdrops, BACKDROPS, "backdrops")
    hue = rng.random()
    materials = tuple(
        _object_material(
            rng, (hue + (i + 0.5 * rng.random()) / n_objects) % 1.0, textures, texture_scale, metal_probability
        )
        for i in range(n_objects)
    )
    kind = _choice(rng, backdrops)
    horizon = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.0, 0.3), rng.uniform(0.35, 0.95))
    zenith = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.1, 0.6), rng.uniform(0.2, 0.9))
    backdrop = Backdrop(
        horizon,
        horizon if kind == "plain" else zenith,
        rng.uniform(0.3, 0.8) if kind == "clouds" else 0.0,
        int(rng.integers(1 << 16)),
    )
    count = int(rng.integers(1, max_lights + 1))
    around = float(rng.uniform(*ambient))
    lights = [_light(rng, i, point_light_probability, soft_shadow_probability) for i in range(count)]
    # A white surface that faces all lights is just saturated.
    dimming = min(1.0, (_BRIGHTEST - around) / sum(max(light.colour) for light in lights))
    lights = [replace(light, colour=tuple(dimming * c for c in light.colour)) for light in lights]  # type: ignore[arg-type]
    return Appearance(
        materials,
        _floor_material(rng, floor_textures, floor_scale),
        backdrop,
        tuple(lights),
        ambient=around,
        haze=float(rng.uniform(8.0, 20.0)),
        fixed=tuple(_floor_material(rng, floor_textures, floor_scale) for _ in range(n_fixed)),
    )


def sample_sensor(
    rng: np.random.Generator,
    *,
    noise: tuple[float, float] = (0.0, 0.02),
    blur: tuple[float, float] = (0.0, 0.8),
    gamma: tuple[float, float] = (0.85, 1.2),
    brightness: tuple[float, float] = (0.8, 1.2),
) -> Sensor:
    """A random sensor; each number is drawn uniformly from its range."""
    return Sensor(*(float(rng.uniform(*bounds)) for bounds in (noise, blur, gamma, brightness)))


def apply_sensor(frames: np.ndarray, sensor: Sensor, rng: np.random.Generator) -> np.ndarray:
    """Frames uint8 (F, H, W, 3) with the sensor's blur, then its gamma and brightness, then its noise."""
    tone = np.arange(256) / 255.0
    tone = np.clip(255.0 * sensor.brightness * tone**sensor.gamma, 0, 255).astype(np.float32)
    out = np.empty_like(frames)
    for k, frame in enumerate(frames):
        if sensor.blur > 0:
            frame = cv2.GaussianBlur(frame, (0, 0), sensor.blur)
        picture = tone[frame]
        if sensor.noise > 0:
            picture += (255.0 * sensor.noise) * rng.standard_normal(frame.shape, dtype=np.float32)
        out[k] = np.clip(picture + 0.5, 0, 255).astype(np.uint8)
    return out


def _object_material(
    rng: np.random.Generator,
    hue: float,
    textures: dict[str, float],
    scale: tuple[float, float],
    metal_probability: float,
) -> Material:
    value = rng.uniform(0.45, 0.95)
    colour = colorsys.hsv_to_rgb(hue, rng.uniform(0.25, 0.9), value)
    if rng.random() < 0.5:  # the same hue, or any
        second = colorsys.hsv_to_rgb(hue, rng.uniform(0.1, 0.8), value * rng.uniform(0.3, 0.7))
    else:
        second = colorsys.hsv_to_rgb(rng.random(), rng.uniform(0.0, 0.8), rng.uniform(0.1, 1.0))
    metal = rng.random() < metal_probability
    return Material(
        colour,
        second,
        _choice(rng, textures),
        _log_uniform(rng, scale),
        specular=float(rng.uniform(0.5, 0.9) if metal else rng.uniform(0.0, 0.5)),
        shininess=_log_uniform(rng, (40.0, 120.0) if metal else (8.0, 60.0)),
        mirror=float(rng.uniform(0.2, 0.5)) if metal else 0.0,
        seed=int(rng.integers(1 << 16)),
    )


def _floor_material(rng: np.random.Generator, textures: dict[str, float], scale: tuple[float, float]) -> Material:
    hue, value = rng.random(), rng.uniform(0.3, 0.9)
    return Material(
        colorsys.hsv_to_rgb(hue, rng.uniform(0.0, 0.35), value),
        colorsys.hsv_to_rgb((hue + rng.uniform(-0.1, 0.1)) % 1, rng.uniform(0.0, 0.4), value * rng.uniform(0.4, 0.9)),
        _choice(rng, textures),
        _log_uniform(rng, scale),
        specular=float(rng.uniform(0.0, 0.2)),
        shininess=_log_uniform(rng, (8.0, 40.0)),
        seed=int(rng.integers(1 << 16)),
    )


def _light(rng: np.random.Generator, index: int, point_probability: float, soft_probability: float) -> Light:
    strength = rng.uniform(0.5, 0.8) if index == 0 else rng.uniform(0.1, 0.4)
    colour = tuple(float(c) for c in strength * rng.uniform(0.85, 1.0, 3))
    radius = float(rng.uniform(0.03, 0.12)) if rng.random() < soft_probability else 0.0
    near = rng.random() < point_probability
    azimuth, elevation = rng.uniform(-math.pi, math.pi), math.radians(rng.uniform(50 if near else 30, 85))
    towards = (
        math.cos(azimuth) * math.cos(elevation),
        math.sin(azimuth) * math.cos(elevation),
        math.sin(elevation),
    )
    if near:
        distance = rng.uniform(3.0, 6.0)
        position = (distance * towards[0], distance * towards[1], distance * towards[2])
        return Light(colour, position=position, radius=radius * distance)  # type: ignore[arg-type]
    return Light(colour, towards=towards, radius=radius)  # type: ignore[arg-type]


def _choice(rng: np.random.Generator, weights: dict[str, float]) -> str:
    total = sum(weights.values())
    return str(rng.choice(list(weights), p=[w / total for w in weights.values()]))


def _check_weights(weights: dict[str, float], valid: Sequence[str] | dict[str, int], name: str) -> None:
    unknown = set(weights) - set(valid)
    if unknown or sum(weights.values()) <= 0:
        raise ValueError(f"{name}: {sorted(unknown) or 'no weight'}; valid kinds are {list(valid)}")


def _log_uniform(rng: np.random.Generator, bounds: tuple[float, float]) -> float:
    return float(math.exp(rng.uniform(math.log(bounds[0]), math.log(bounds[1]))))


def _unit(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    norm = math.sqrt(sum(v * v for v in vector))
    return (vector[0] / norm, vector[1] / norm, vector[2] / norm)
