"""Effects in scene texts."""

import pytest

from pipeline.errors import SceneError
from pipeline.scene.scene import Effect
from pipeline.scene.text import read_scene, write_scene

SCENE = """\
camera: null
gravity: 9.81
ground: {height: 0.0}
objects:
- {name: ball, shape: sphere, radius: 0.1, mass: 1, sliding_friction: 0.5, rolling_friction: 0, damping: 1,
   position: [0, 0, 1], velocity: [0, 0, 0], angular_velocity: [0, 0, 0], orientation: [1, 0, 0, 0]}
effects:
"""


def test_effects_are_read_and_written_canonically() -> None:
    lines = [
        "- {name: air_drag, coefficient: 0.003, objects: [ball]}",
        "- {name: wind, velocity: [1.0, 2.0, 0.0], coefficient: 0.01}",
        "- {name: impulse, time: 0.5, momentum: [0.0, 0.0, 1.0], objects: [ball]}",
    ]
    scene = read_scene(SCENE + "\n".join(lines))
    assert scene.effects[0] == Effect("air_drag", (("coefficient", 0.003),), ("ball",))
    assert scene.effects[1].values["velocity"] == (1, 2, 0)
    text = write_scene(scene)
    assert text.splitlines()[-3:] == lines and read_scene(text) == scene


def test_object_is_short_for_a_list_of_one() -> None:
    scene = read_scene(SCENE + "- {name: impulse, time: 0.5, momentum: [0, 0, 1], object: ball}")
    assert scene.effects[0].objects == ("ball",)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (
            "{name: air_dragg, coefficient: 1}",
            r"effects\[0\]\.name: unknown effect 'air_dragg' \(did you mean 'air_drag'\?\)",
        ),
        ("{name: air_drag}", r"effects\[0\]\.coefficient: missing key; needed by air_drag: coefficient \(kg/m\)"),
        ("{name: air_drag, coefficient: -1}", r"effects\[0\]\.coefficient: -1 is out of range"),
        (
            "{name: air_drag, coefficient: fast}",
            r"effects\[0\]\.coefficient: must be a finite number \(kg/m\), not 'fast'",
        ),
        ("{name: air_drag, coefficient: .nan}", r"effects\[0\]\.coefficient: must be a finite number"),
        ("{name: air_drag, coeficient: 1}", r"effects\[0\]\.coeficient: unknown key \(did you mean 'coefficient'\?\)"),
        (
            "{name: air_drag, coefficient: 1, objects: [cube]}",
            r"effects\[0\]\.objects\[0\]: there is no object 'cube'; valid: ball",
        ),
        ("{name: air_drag, coefficient: 1, objects: []}", r"effects\[0\]\.objects: must be a list of names"),
        (
            "{name: wind, velocity: [1, 2], coefficient: 1}",
            r"effects\[0\]\.velocity: valid: a list of 3 numbers \(m/s\)",
        ),
        ("drag", r"effects\[0\]: must be a mapping with a name and its parameters"),
    ],
)
def test_faults_name_their_place(line: str, said: str) -> None:
    with pytest.raises(SceneError, match=said):
        read_scene(SCENE + f"- {line}")
