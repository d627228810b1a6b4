"""What is known of a scene: defaults, what is fitted, overrides."""

from typing import Any

import pytest

from pipeline.discovery.tracks.known_scene import FITTED, known_scene
from pipeline.errors import SceneError

BALL: dict[str, Any] = {"name": "ball", "shape": "sphere", "radius": 0.05, "mass": 0.2}


def test_name_shape_sizes_and_mass_are_enough() -> None:
    known = known_scene({"objects": [BALL]})
    (ball,) = known.scene.objects
    assert (ball.sliding_friction, ball.rolling_friction, ball.damping) == (0.5, 0.0, 1.0)
    assert known.scene.gravity == (0, 0, -9.81) and known.scene.ground == 0 and known.scene.camera is None
    assert known.fit == FITTED


def test_a_clip_may_override_a_mass() -> None:
    known = known_scene({"objects": [BALL], "clips": {"c7": {"objects": {"ball": {"mass": 0.5}}}}})
    assert known.of_clip("c7").objects[0].mass == 0.5 and known.of_clip("c1").objects[0].mass == 0.2


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ({"fit": ["colour"]}, r"fit\[0\]: 'colour' cannot be fitted; valid: sliding_friction"),
        ({"fit": "damping"}, r"fit: must be a list"),
        (
            {"clips": {"c": {"objects": {"cube": {"mass": 1.0}}}}},
            r"clips\.c\.objects: there is no object 'cube'; valid: ball",
        ),
        (
            {"clips": {"c": {"objects": {"ball": {"mass": -1.0}}}}},
            r"clips\.c: objects\[0\]\.mass: must be greater than 0",
        ),
        ({"clips": {"c": {"camera": None}}}, r"clips\.c\.camera: cannot be overridden"),
        ({"objects": [{"name": "ball", "shape": "sphere", "radius": 0.1}]}, r"objects\[0\]\.mass: missing key"),
        ({"objects": []}, r"objects: there are none"),
        ({"weather": "fine"}, r"weather: unknown key"),
    ],
)
def test_faults_name_their_place(more: dict[str, Any], said: str) -> None:
    with pytest.raises(SceneError, match=said):
        known_scene({"objects": [BALL], **more})


@pytest.mark.parametrize(
    ("key", "value", "told"),
    [
        ("fixed", [{"shape": "plane", "position": [0, 0, 0]}], "fixed: motion on or against fixed bodies"),
        ("hollow", 0.9, r"objects\[0\]\.hollow: motion of hollow bodies"),
    ],
)
def test_what_the_models_of_motion_lack_is_refused(key: str, value: object, told: str) -> None:
    ball: dict[str, object] = {"name": "ball", "shape": "sphere", "radius": 0.1, "mass": 1.0}
    data = {"objects": [ball]}
    (ball if key == "hollow" else data)[key] = value  # type: ignore[index]
    with pytest.raises(SceneError, match=told):
        known_scene(data)
