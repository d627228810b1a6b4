"""How solid bodies of training clips look: the project's appearances, and darker, greyer, glossier ones."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from pipeline.vision.rendering.appearance import Appearance, Light, Material, plain_appearance, sample_appearance

PATTERNS = {"plain": 0.5, "stripes": 1.0, "checker": 1.0, "noise": 1.0, "spots": 1.0}
FLOORS = {"plain": 0.3, "stripes": 0.5, "checker": 1.5, "noise": 1.5, "spots": 0.3}


def sample_looks(rng: np.random.Generator, count: int) -> Appearance:
    """A random appearance of `count` bodies."""
    if rng.random() < 0.05:
        return plain_appearance(count)
    look = sample_appearance(
        rng,
        count,
        textures={"plain": 1.0} if rng.random() < 0.5 else PATTERNS,
        floor_textures={"plain": 1.0} if rng.random() < 0.5 else FLOORS,
        max_lights=3,
        point_light_probability=0.45,
        soft_shadow_probability=0.75,
        metal_probability=float(rng.choice([0.05, 0.5])),
        texture_scale=(0.03, 0.25),
        floor_scale=(0.05, 1.0),
        ambient=(0.15, 0.6),
    )
    widen = math.exp(rng.uniform(0, 1.2))
    materials = tuple(_material(rng, m, look.floor) for m in look.materials)
    backdrop = look.backdrop
    if rng.random() < 0.3:
        grey = rng.uniform(0.02, 0.95)
        backdrop = replace(backdrop, horizon=(grey,) * 3, zenith=(grey,) * 3, clouds=0.0)
    return replace(
        look, materials=materials, lights=tuple(_light(rng, li, widen) for li in look.lights), backdrop=backdrop
    )


def _light(rng: np.random.Generator, light: Light, widen: float) -> Light:
    """With a wider disc; sometimes as strong as the first, so that a body has several shadows."""
    colour = light.colour
    if rng.random() < 0.3:
        scale = rng.uniform(0.25, 0.55) / max(colour)
        colour = tuple(scale * c for c in colour)  # type: ignore[assignment]
    return replace(light, radius=light.radius * widen, colour=colour)


def _material(rng: np.random.Generator, material: Material, floor: Material) -> Material:
    kind = rng.random()
    if kind < 0.2:  # grey, down to very dark
        grey = rng.uniform(0.02, 0.95)
        material = replace(material, colour=tuple(float(np.clip(grey + rng.normal(0, 0.04), 0, 1)) for _ in range(3)))  # type: ignore[arg-type]
    elif kind < 0.27:  # nearly the floor's
        near = tuple(float(np.clip(c * rng.uniform(0.7, 1.3), 0, 1)) for c in floor.colour)
        material = replace(material, colour=near)  # type: ignore[arg-type]
    elif kind < 0.45:
        material = replace(material, colour=tuple(float(c) for c in rng.uniform(0.02, 1, 3)))  # type: ignore[arg-type]
    if material.mirror > 0:
        mirror, specular = float(rng.uniform(0.15, 0.75)), float(rng.uniform(0.3, 1.0))
        material = replace(material, mirror=mirror, specular=specular)
    return material
