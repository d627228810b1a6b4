"""Hypothesis strategies for scenes of all shapes."""

import string
from typing import Any

from hypothesis import strategies as st

from pipeline.scene.scene import FIXED_SIZE_KEYS, HOLLOW_SHAPES, SIZE_KEYS, Camera, FixedBody, Scene, SceneObject

finite = st.floats(-1e6, 1e6)
positive = st.floats(1e-6, 1e6)
vectors = st.tuples(finite, finite, finite)
quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: max(map(abs, q)) > 1e-3)
names = st.text(string.ascii_letters, min_size=1, max_size=1).flatmap(
    lambda first: st.text(string.ascii_letters + string.digits + "_-", max_size=8).map(lambda rest: first + rest)
)
names = (names | st.sampled_from(["null", "true", "False"])).filter(lambda n: n not in ("world", "camera", "ground"))


@st.composite
def objects(draw: st.DrawFn, name: str) -> SceneObject:
    shape = draw(st.sampled_from(list(SIZE_KEYS)))
    size = draw(sizes(shape))
    values: dict[str, Any] = {key: draw(positive) for key in ("mass", "damping")}
    values |= {key: abs(draw(finite)) for key in ("sliding_friction", "rolling_friction")}
    values |= {key: draw(vectors) for key in ("position", "velocity", "angular_velocity")}
    values["hollow"] = draw(st.floats(0, 1)) if shape in HOLLOW_SHAPES else 0.0
    return SceneObject(shape, size, name=name, file=draw(files(shape)), orientation=draw(quaternions), **values)


@st.composite
def fixed_bodies(draw: st.DrawFn, name: str) -> FixedBody:
    shape = draw(st.sampled_from(list(FIXED_SIZE_KEYS)))
    own = {"sliding_friction": draw(st.none() | finite.map(abs)), "rolling_friction": draw(st.none() | finite.map(abs))}
    own["damping"] = draw(st.none() | positive)
    pose = (draw(vectors), draw(quaternions))
    return FixedBody(shape, draw(sizes(shape)), *pose, name=name, file=draw(files(shape)), **own)


@st.composite
def sizes(draw: st.DrawFn, shape: str) -> tuple[float, ...]:
    size = tuple(draw(positive) for _ in FIXED_SIZE_KEYS[shape])
    return (size[0], 2.1 * size[0] + size[1]) if shape == "capsule" else size


def files(shape: str) -> st.SearchStrategy[str | None]:
    return st.text(min_size=1, max_size=8) if shape == "mesh" else st.none()


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    fov = draw(st.floats(0.1, 179))
    if draw(st.booleans()):
        return Camera(draw(vectors), fov, pitch=draw(st.floats(-90, 90)))
    return Camera(draw(vectors), fov, orientation=draw(quaternions))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    named = draw(st.lists(names, max_size=5, unique=True))
    moving = draw(st.integers(0, len(named)))
    gravity = draw(vectors | finite.map(lambda g: (0.0, 0.0, g)))
    camera, ground = draw(st.none() | cameras()), draw(st.none() | finite)
    fixed = tuple(draw(fixed_bodies(n)) for n in named[moving:])
    return Scene(tuple(draw(objects(n)) for n in named[:moving]), camera, gravity, ground, fixed=fixed)
