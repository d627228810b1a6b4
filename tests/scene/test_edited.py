"""Laws of editing a scene by path."""

import re
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
import small_clip
from ruamel.yaml import YAML

from pipeline.errors import SceneError
from pipeline.scene.edited import edited
from pipeline.scene.scene import FixedBody
from pipeline.scene.text import write_scene


def leaves(data: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Paths of all numbers and texts of parsed YAML, as --set takes them."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from leaves(value, f"{path}.{key}".lstrip("."))
    elif isinstance(data, list):
        for i, value in enumerate(data):
            yield from leaves(value, f"{path}[{i}]")
    else:
        yield path, data


def test_every_number_of_a_scene_can_be_set_to_itself() -> None:
    scene = small_clip.scene()
    found = list(leaves(YAML(typ="safe", pure=True).load(write_scene(scene))))
    assert len(found) > 30
    for path, value in found:
        assert edited(scene, [f"{path}={value}"]) == scene, path


def test_an_edit_changes_its_place_and_nothing_else() -> None:
    scene = small_clip.scene()
    heavier = edited(scene, ["objects[1].mass=2"])
    assert heavier.objects[1].mass == 2
    assert edited(heavier, ["objects[crate].mass=0.5"]) == scene
    assert edited(scene, ["gravity=[1, 0, -3]"]).gravity == (1, 0, -3)
    assert edited(scene, ["objects[ball].position[2]=0.4"]).objects[0].position == (-0.5, 0.0, 0.4)
    assert edited(scene, ["ground=null"]).ground is None


def test_fixed_bodies_and_hollow_ones_are_edited_too() -> None:
    ramp = FixedBody("box", (1, 1, 0.1), (0, 0, 0.2), name="ramp")
    scene = replace(small_clip.scene(), fixed=(ramp,))
    icy = edited(scene, ["fixed[ramp].sliding_friction=0.01", "fixed[0].position[2]=0.3", "objects[ball].hollow=0.9"])
    assert icy.fixed == (replace(ramp, sliding_friction=0.01, position=(0, 0, 0.3)),)
    assert icy.objects[0].hollow == 0.9
    wall = edited(small_clip.scene(), ["fixed=[{shape: plane, position: [1, 0, 0], orientation: [1, 0, -1, 0]}]"])
    assert [b.shape for b in wall.fixed] == ["plane"]


def test_edits_apply_in_order() -> None:
    twice = edited(small_clip.scene(), ["gravity=1", "objects[0].name=first", "objects[first].mass=3", "gravity=2"])
    assert (twice.gravity[2], twice.objects[0].mass) == (-2, 3)


def test_a_camera_turns_by_pitch_or_by_orientation() -> None:
    scene = small_clip.scene()
    turned = edited(scene, ["camera.orientation=[0.8, 0.6, 0, 0]"])
    assert turned.camera is not None
    assert turned.camera.pitch is None
    assert edited(turned, ["camera.pitch=-18"]) == scene


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        ("objects[0].mas=2", "unknown key 'mas' of objects[0], a sphere, (did you mean 'mass'?)"),
        ("objects[0].width=2", "valid: name, shape, radius"),
        ("gravty=2", "did you mean 'gravity'"),
        ("objects[2].mass=2", "valid: 0 to 1, or by name: ball, crate"),
        ("objects[bal].mass=2", "did you mean 'ball'"),
        ("objects[0].position[3]=2", "valid: 0 to 2"),
        ("gravity.x=2", "gravity is 9.81, which has no parts"),
        ("objects[0].mass=heavy", "objects[0].mass: must be a number, not 'heavy'"),
        ("objects[0].mass=-1", "objects[0].mass: must be greater than 0, not -1"),
        ("objects[0].mass=[1", "is no value"),
        ("objects[0].shape=box", "objects[0]"),
        ("mass", "path=value is expected"),
        ("=2", "path=value is expected"),
        ("objects..mass=2", "is no path"),
        ("[0].mass=2", "is no path"),
    ],
)
def test_a_wrong_edit_is_named_with_what_is_valid(edit: str, words: str) -> None:
    with pytest.raises(SceneError, match=re.escape(words)) as raised:
        edited(small_clip.scene(), [edit])
    assert edit in str(raised.value)
