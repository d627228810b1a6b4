"""A scene as a vector of fixed length and back: what a regression answers.

It has a head (camera and gravity) and a slot for each object that a scene may have, in the order in which the text
lists them. Numbers are scaled so that the sampler's ranges are [0, 1].
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pipeline.model.language.completion import (
    ANGLE_FREE,
    FOV,
    GRAVITY,
    HEIGHT,
    IMAGINARY_PART,
    MATERIAL,
    MAX_OBJECTS,
    PITCH,
    REAL_PART,
    SIZE,
    VECTORS,
)
from pipeline.model.language.grammar import Number
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import BASIC_SHAPES, SIZE_KEYS, Camera, Scene, SceneObject
from pipeline.scene.solid import reach_below

SLOTS = MAX_OBJECTS
CLASSES = (None, *BASIC_SHAPES)  # of a slot; None: no object
HEAD = (HEIGHT, PITCH, FOV, GRAVITY)
#: A slot's numbers, with the bounds that the text gives them.
SLOT: tuple[Number, ...] = (
    *[SIZE] * 3,
    *MATERIAL.values(),
    *[v for v in VECTORS.values() for _ in range(3)],
    REAL_PART,
    *[IMAGINARY_PART] * 3,
)
MASS = 3  # where the mass stands in a slot; it is scaled in the logarithm
SIZES, MATERIALS = slice(0, 3), slice(3, 7)
POSITION, VELOCITY, ANGULAR_VELOCITY, ORIENTATION = slice(7, 10), slice(10, 13), slice(13, 16), slice(16, 20)
_SMALL = 1e-9  # the span of a range that is one number


@dataclass(frozen=True)
class SceneVector:
    """head (4,); shapes (SLOTS,) indices of CLASSES; numbers (SLOTS, 20), and which of them the object has."""

    head: np.ndarray
    shapes: np.ndarray
    numbers: np.ndarray
    present: np.ndarray


@dataclass(frozen=True)
class Scale:
    """Lows and highs of the head (2, 4) and of a slot of each basic shape (2, 3, 20); the camera's distance, m."""

    head: np.ndarray
    slot: np.ndarray
    distance: float


def scale_of(d: Distribution) -> Scale:
    """The ranges of everything that is drawn from a distribution."""
    height, target, distance = d.camera_height, d.camera_target_height, d.camera_distance
    steepest, flattest = (
        -np.degrees(np.arctan2(h - t, distance)) for h, t in ((height[1], target[0]), (height[0], target[1]))
    )
    head = np.array([height, (steepest, flattest), d.camera_fov, d.gravity]).T
    nothing = (0.0, 1.0)
    sizes = {
        "sphere": (d.sphere_radius, nothing, nothing),
        "cylinder": (d.cylinder_radius, d.cylinder_height, nothing),
        "box": (d.box_side, d.box_side, d.box_side),
    }
    reach = max(
        d.sphere_radius[1], np.hypot(d.cylinder_radius[1], d.cylinder_height[1] / 2), np.sqrt(3) / 2 * d.box_side[1]
    )
    fastest, spin = d.speed[1], max(d.spin[1], d.speed[1] / min(d.sphere_radius[0], d.cylinder_radius[0]))
    rest = [
        tuple(np.log(d.mass)),
        d.sliding_friction,
        d.rolling_friction,
        d.damping,
        d.x,
        d.y,
        (0.0, reach + d.drop_height[1]),
        *[(-fastest, fastest)] * 3,
        *[(-spin, spin)] * 3,
        *[(n.low, n.high) for n in SLOT[ORIENTATION]],
    ]
    slot = np.array([[*sizes[shape], *rest] for shape in BASIC_SHAPES])
    return Scale(head, np.moveaxis(slot, -1, 0), distance)


def encode(scene: Scene, scale: Scale) -> SceneVector:
    """The vector of a scene of at most SLOTS basic shapes in canonical form, with a camera with pitch."""
    camera = scene.camera
    assert camera is not None and camera.pitch is not None
    head = _shrink(np.array([camera.position[2], camera.pitch, camera.fov, -scene.gravity[2]]), scale.head)
    shapes, numbers = np.zeros(SLOTS, int), np.zeros((SLOTS, len(SLOT)))
    present = np.zeros(numbers.shape, bool)
    for i, obj in enumerate(scene.objects):
        kind = BASIC_SHAPES.index(obj.shape)
        shapes[i], present[i] = kind + 1, _has(obj.shape)
        material = [getattr(obj, key) for key in MATERIAL]
        values = np.array(
            [
                *obj.size,
                *[1.0] * (3 - len(obj.size)),
                *material,
                *obj.position,
                *obj.velocity,
                *obj.angular_velocity,
                *obj.orientation,
            ]
        )
        values[MASS] = np.log(values[MASS])
        numbers[i] = np.where(present[i], _shrink(values, scale.slot[:, kind]), 0.0)
    return SceneVector(head, shapes, numbers, present)


def decode(head: np.ndarray, shapes: np.ndarray, numbers: np.ndarray, scale: Scale) -> Scene:
    """The scene of head (4,), shapes (SLOTS,) and numbers (SLOTS, 20): a valid one whatever the numbers are, since they
    are moved into the text's bounds, and objects up to the ground. Slots without an object are passed over."""
    height, pitch, fov, gravity = _bounded(_stretch(head, scale.head), HEAD)
    objects = tuple(_object(CLASSES[k], numbers[i], scale.slot[:, k - 1]) for i, k in enumerate(shapes) if k)
    return Scene(objects, Camera((0.0, -scale.distance, height), fov, pitch), (0.0, 0.0, -gravity))


def likeliest_shapes(logits: np.ndarray) -> np.ndarray:
    """(SLOTS,) the likeliest class of each slot's logits (SLOTS, 4); where none would have an object, the one likeliest
    to have one gets it."""
    shapes = logits.argmax(1)
    if not shapes.any():
        gain = logits[:, 1:].max(1) - logits[:, 0]
        slot = int(gain.argmax())
        shapes[slot] = 1 + logits[slot, 1:].argmax()
    return shapes


def _object(shape: str | None, numbers: np.ndarray, span: np.ndarray) -> SceneObject:
    assert shape is not None
    values = _stretch(numbers, span)
    values[MASS] = np.exp(values[MASS])
    values = np.where(_has(shape), _bounded(values, SLOT), 0.0)
    obj = SceneObject(
        shape,
        tuple(values[SIZES][: len(SIZE_KEYS[shape])]),
        **dict(zip(MATERIAL, values[MATERIALS], strict=True)),
        velocity=tuple(values[VELOCITY]),
        angular_velocity=tuple(values[ANGULAR_VELOCITY]),
        orientation=tuple(values[ORIENTATION]) if ANGLE_FREE[shape] else (1.0, 0.0, 0.0, 0.0),
    )
    x, y, z = values[POSITION]
    lowest = np.ceil(1000 * reach_below(obj)) / 1000  # as the sampler puts what rests
    return replace(obj, position=(x, y, max(z, lowest)))


def _has(shape: str) -> np.ndarray:
    """(20,) which numbers of a slot a shape has."""
    has = np.ones(len(SLOT), bool)
    has[SIZES] = np.arange(3) < len(SIZE_KEYS[shape])
    free = ANGLE_FREE[shape]
    has[ORIENTATION] = np.arange(4) < (1 + free if free else 0)
    return has


def _shrink(values: np.ndarray, span: np.ndarray) -> np.ndarray:
    low, high = span
    return (values - low) / np.maximum(high - low, _SMALL)


def _stretch(scaled: np.ndarray, span: np.ndarray) -> np.ndarray:
    low, high = span
    return low + scaled * np.maximum(high - low, _SMALL)


def _bounded(values: np.ndarray, bounds: tuple[Number, ...]) -> np.ndarray:
    return np.clip(values, [n.low for n in bounds], [n.high for n in bounds])
