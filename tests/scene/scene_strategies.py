"""Hypothesis strategies for scenes of all shapes."""

import string
from typing import Any

from hypothesis import strategies as st

from pipeline.scene.scene import SIZE_KEYS, Camera, Scene, SceneObject

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
    size = tuple(draw(positive) for _ in SIZE_KEYS[shape])
    if shape == "capsule":
        size = (size[0], 2.1 * size[0] + size[1])
    values: dict[str, Any] = {key: draw(positive) for key in ("mass", "damping")}
    values |= {key: abs(draw(finite)) for key in ("sliding_friction", "rolling_friction")}
    values |= {key: draw(vectors) for key in ("position", "velocity", "angular_velocity")}
    file = draw(st.text(min_size=1, max_size=8)) if shape == "mesh" else None
    return SceneObject(shape, size, name=name, file=file, orientation=draw(quaternions), **values)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    fov = draw(st.floats(0.1, 179))
    if draw(st.booleans()):
        return Camera(draw(vectors), fov, pitch=draw(st.floats(-90, 90)))
    return Camera(draw(vectors), fov, orientation=draw(quaternions))


@st.composite
def scenes(draw: st.DrawFn) -> Scene:
    named = draw(st.lists(names, max_size=4, unique=True))
    gravity = draw(vectors | finite.map(lambda g: (0.0, 0.0, g)))
    camera, ground = draw(st.none() | cameras()), draw(st.none() | finite)
    return Scene(tuple(draw(objects(n)) for n in named), camera, gravity, ground)
