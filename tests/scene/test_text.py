import contextlib
import re
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scene_strategies import scenes

from pipeline.errors import SceneError
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.text import load_scene, read_scene, write_scene

QUICK = settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow])
GOOD = """\
camera: {position: [0, -2, 0.80], pitch: -22.0, fov: 42.0}
gravity: 9.81
ground: {height: 0.0}
objects:
- shape: sphere
  radius: 0.12
  mass: 0.50
  sliding_friction: 0.40
  rolling_friction: 1e-5
  damping: 0.60
  position: [0.10, 0.32, 0.12]
  velocity: [0.90, -0.20, 0.00]
  angular_velocity: [0.0, 7.5, 0.0]
  orientation: [1.0, 0.0, 0.0, 0.0]
- name: crate
  shape: box
  width: 0.3
  depth: 0.2
  height: 0.1
  mass: 1
  sliding_friction: 0
  rolling_friction: 0
  damping: 1
  position: [1, 0, 0.05]
  velocity: [0, 0, 0]
  angular_velocity: [0, 0, 0]
  orientation: [2, 0, 0, -2]
effects: []
"""
FIXED = """\
fixed:
- name: ramp
  shape: box
  width: 1.5
  depth: 0.5
  height: 0.05
  position: [0, 0, 0.4]
  orientation: [0.98, 0, 0.2, 0]
  sliding_friction: 0.3
- shape: plane
  position: [2, 0, 0]
  orientation: [1, 0, -1, 0]
- {shape: cylinder, radius: 0.1, height: 1, position: [0, 1, 0.5]}
"""
WITH_FIXED = GOOD.replace("objects:", FIXED + "objects:")


@QUICK
@given(scenes())
def test_reading_what_was_written_gives_the_same_scene(scene: Scene) -> None:
    assert read_scene(write_scene(scene)) == scene


@QUICK
@given(scenes())
def test_writing_is_canonical(scene: Scene) -> None:
    text = write_scene(scene)
    assert write_scene(read_scene(text)) == text


@QUICK
@given(scenes())
def test_numbers_are_written_with_six_significant_digits(scene: Scene) -> None:
    text = re.sub(r'"[^"]*"|(?<=name: ).*', "", write_scene(scene))
    for number in re.findall(r"(?<![\w.])-?\d+\.?\d*(?:e[+-]?\d+)?", text):
        digits = number.lstrip("-").split("e")[0].replace(".", "").strip("0")
        assert len(digits) <= 6, number


def test_the_scene_of_the_format_reads_as_it_says() -> None:
    scene = read_scene(GOOD)
    assert scene.gravity == (0.0, 0.0, -9.81)
    assert scene.ground == 0.0
    assert [o.name for o in scene.objects] == ["sphere_0", "crate"]
    assert scene.camera == Camera((0.0, -2.0, 0.8), 42.0, -22.0)
    assert scene.objects[0].rolling_friction == 1e-5  # YAML 1.2: a number, and so is a bare integer
    assert scene.objects[1].orientation == (0.707107, 0.0, 0.0, -0.707107)


def test_none_is_said_as_null() -> None:
    text = GOOD.replace("ground: {height: 0.0}", "ground: null")
    assert read_scene(text).ground is None
    camera = GOOD.splitlines(keepends=True)[0]
    assert read_scene(GOOD.replace(camera, "camera: null\n")).camera is None


def test_gravity_may_be_a_vector_and_the_camera_may_turn_anyhow() -> None:
    text = GOOD.replace("gravity: 9.81", "gravity: [0.5, 0, -9]").replace("pitch: -22.0", "orientation: [0, 0, 3, 4]")
    scene = read_scene(text)
    assert scene.gravity == (0.5, 0.0, -9.0)
    assert scene.camera is not None
    assert scene.camera.orientation == (0.0, 0.0, 0.6, 0.8)
    assert read_scene(write_scene(scene)) == scene


@pytest.mark.parametrize("quaternion", ["[1e-200, 0, 0, 0]", "[1e300, 0, 0, 0]", "[-3, 0, 0, 0]"])
def test_quaternions_of_any_non_zero_length_are_accepted(quaternion: str) -> None:
    scene = read_scene(GOOD.replace("[1.0, 0.0, 0.0, 0.0]", quaternion))
    assert scene.objects[0].orientation == (1.0, 0.0, 0.0, 0.0)


def test_fixed_bodies_read_as_they_are_written() -> None:
    scene = read_scene(WITH_FIXED)
    ramp, wall, pole = scene.fixed
    assert (ramp.name, ramp.size, ramp.sliding_friction, ramp.damping) == ("ramp", (1.5, 0.5, 0.05), 0.3, None)
    assert (wall.name, wall.size) == ("fixed_1", ())
    assert wall.orientation == (0.707107, 0.0, -0.707107, 0.0)
    assert (pole.name, pole.orientation) == ("fixed_2", (1.0, 0.0, 0.0, 0.0))
    assert read_scene(write_scene(scene)) == scene
    assert read_scene(GOOD).fixed == ()
    assert "fixed" not in write_scene(read_scene(GOOD))


def test_hollow_is_written_where_it_is_not_zero() -> None:
    scene = read_scene(GOOD.replace("radius: 0.12", "radius: 0.12\n  hollow: 0.95"))
    assert scene.objects[0].hollow == 0.95
    assert "  hollow: 0.95\n" in write_scene(scene)
    assert "hollow" not in write_scene(read_scene(GOOD))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("radius: 0.1,", "radius: -1,", r"fixed\[2\]\.radius: must be greater than 0, not -1"),
        ("radius: 0.1,", "", r"fixed\[2\]\.radius: missing key; needed: shape, radius, height, position$"),
        ("  position: [2, 0, 0]\n", "", r"fixed\[1\]\.position: missing key; needed: shape, position$"),
        (
            "shape: plane",
            "shape: plane\n  width: 2",
            r"fixed\[1\]\.width: unknown key.*of a plane: shape, name, position",
        ),
        ("shape: plane", "shape: plane\n  mass: 2", r"fixed\[1\]\.mass: unknown key"),
        ("shape: plane", "shape: cone", r"fixed\[1\]\.shape: unknown or missing shape; valid: .*mesh, plane"),
        ("sliding_friction: 0.3", "sliding_friction: -1", r"fixed\[0\]\.sliding_friction: must be at least 0, not -1"),
        ("[1, 0, -1, 0]", "[0, 0, 0, 0]", r"fixed\[1\]\.orientation: a quaternion must be non-zero"),
        ("name: ramp", "name: crate", r"fixed\[0\]\.name: 'crate' is taken by objects\[1\]"),
        ("name: ramp", "name: fixed_1", r"fixed\[1\]\.name: 'fixed_1' is taken by fixed\[0\]"),
        ("name: ramp", "name: ground", r"fixed\[0\]\.name: 'ground' is reserved"),
        ("radius: 0.12", "radius: 0.12\n  hollow: 1.2", r"objects\[0\]\.hollow: must be at most 1, not 1\.2"),
        ("  depth: 0.2", "  depth: 0.2\n  hollow: 0.2", r"objects\[1\]\.hollow: unknown key"),
    ],
)
def test_a_fault_of_a_fixed_or_hollow_body_is_told_by_its_place(old: str, new: str, told: str) -> None:
    assert WITH_FIXED.count(old) == 1
    with pytest.raises(SceneError, match="^scene: " + told):
        read_scene(WITH_FIXED.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        # keys
        (
            "  radius: 0.12",
            "  radius: 0.12\n  height: 2",
            r"objects\[0\]\.height: unknown key.*of a sphere: shape, radius,",
        ),
        ("  radius: 0.12", "  raduis: 0.12", r"objects\[0\]\.raduis: unknown key \(did you mean 'radius'\?\)"),
        (
            "  depth: 0.2",
            "  radius: 0.2",
            r"objects\[1\]\.radius: unknown key.*valid keys of a box: shape, width, depth,",
        ),
        ("  shape: box", "  shape: box\n  box: 3", r"objects\[1\]\.box: unknown key"),
        ("  mass: 1\n", "", r"objects\[1\]\.mass: missing key; needed: shape, width, depth, height, mass"),
        ("gravity: 9.81\n", "", "gravity: missing key; needed: gravity, objects"),
        ("camera:", "camara:", r"camara: unknown key \(did you mean 'camera'\?\)"),
        ("ground: {height: 0.0}\n", "", r"ground: missing key; valid: \{height: 0\.0\}, or null for none"),
        ("height: 0.0", "hight: 0.0", r"ground\.hight: unknown key \(did you mean 'height'\?\)"),
        (", fov: 42.0", "", r"camera\.fov: missing key; needed: position, pitch \(or orientation\), fov"),
        ("effects: []", "3: 4", r"\[3\]: unknown key; valid keys: camera, gravity, ground, fixed, objects, effects"),
        ("  mass: 1\n", "  mass: 1\n  mass: 2\n", "not YAML at line 21: found duplicate key"),
        # numbers
        ("mass: 0.50", "mass: -1", r"objects\[0\]\.mass: must be greater than 0, not -1"),
        ("mass: 0.50", "mass: 0", r"objects\[0\]\.mass: must be greater than 0, not 0"),
        ("mass: 0.50", "mass: .nan", r"objects\[0\]\.mass: must be a finite number, not nan"),
        ("mass: 0.50", "mass: 1e999", r"objects\[0\]\.mass: must be a finite number, not inf"),
        ("mass: 0.50", "mass: true", r"objects\[0\]\.mass: must be a number, not True"),
        ("mass: 0.50", "mass: half a kilo", r"objects\[0\]\.mass: must be a number, not 'half a kilo'"),
        ("damping: 0.60", "damping: 0", r"objects\[0\]\.damping: must be greater than 0, not 0"),
        (
            "sliding_friction: 0.40",
            "sliding_friction: -0.1",
            r"objects\[0\]\.sliding_friction: must be at least 0, not",
        ),
        ("radius: 0.12", "radius: 0", r"objects\[0\]\.radius: must be greater than 0"),
        ("pitch: -22.0", "pitch: -91", r"camera\.pitch: must be at least -90, not -91"),
        ("fov: 42.0", "fov: 180", r"camera\.fov: must be less than 180, not 180"),
        # vectors and quaternions
        ("[0.10, 0.32, 0.12]", "[1, 2]", r"objects\[0\]\.position: valid: a list of 3 numbers, not \[1, 2\]"),
        ("[0.10, 0.32, 0.12]", "7", r"objects\[0\]\.position: valid: a list of 3 numbers, not 7"),
        ("[0.10, 0.32, 0.12]", "[1, 2, up]", r"objects\[0\]\.position\[2\]: must be a number, not 'up'"),
        ("[0.10, 0.32, 0.12]", "[1, 2, .inf]", r"objects\[0\]\.position\[2\]: must be a finite number, not inf"),
        (
            "[1.0, 0.0, 0.0, 0.0]",
            "[0, 0, 0, 0]",
            r"objects\[0\]\.orientation: a quaternion must be non-zero; valid: w, x,",
        ),
        ("[1.0, 0.0, 0.0, 0.0]", "[1, 0, 0]", r"objects\[0\]\.orientation: valid: a list of 4 numbers"),
        (
            "gravity: 9.81",
            "gravity: [0, -9.81]",
            r"gravity: valid: a number .* or a vector \[x, y, z\], not \[0, -9.81\]",
        ),
        ("gravity: 9.81", "gravity: down", "gravity: valid: a number"),
        # shapes, names, cameras
        (
            "shape: sphere",
            "shape: cone",
            r"objects\[0\]\.shape: unknown or missing shape; valid: sphere, cylinder, box",
        ),
        ("- shape: sphere\n  radius", "- radius", r"objects\[0\]\.shape: unknown or missing shape"),
        (
            "shape: sphere\n",
            "shape: capsule\n  height: 0.24\n",
            r"objects\[0\]: height includes both caps; valid: more than",
        ),
        ("name: crate", "name: sphere_0", r"objects\[1\]\.name: 'sphere_0' is taken by objects\[0\]"),
        ("name: crate", "name: ground", r"objects\[1\]\.name: 'ground' is reserved"),
        ("name: crate", "name: 2nd crate", r"objects\[1\]\.name: must be a letter and then letters"),
        ("pitch: -22.0, ", "", "camera: give either pitch .* or orientation"),
        ("pitch: -22.0", "pitch: -22, orientation: [1, 0, 0, 0]", "camera: give either pitch .* or orientation"),
        # the wrong kind of thing
        ("effects: []", "effects: 3", "effects: must be a list, not 3"),
        ("effects: []", "effects: [{name: telepathy}]", r"effects\[0\]\.name: unknown effect 'telepathy'"),
        ("ground: {height: 0.0}", "ground: 0", "ground: must be a mapping with the keys height, not 0"),
        ("mass: 0.50", "mass: 2001-13-45", "not YAML"),
        ("gravity: 9.81", "gravity: [", "not YAML at line"),
    ],
)
def test_a_fault_is_told_by_its_place_and_what_is_valid(old: str, new: str, told: str) -> None:
    assert GOOD.count(old) >= 1
    with pytest.raises(SceneError, match="^clip_7.yaml: " + told) as caught:
        read_scene(GOOD.replace(old, new, 1), "clip_7.yaml")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["", "3", "- 1", "just words", "camera"])
def test_what_is_no_mapping_is_told_which_keys_a_scene_has(text: str) -> None:
    with pytest.raises(
        SceneError, match="mapping with the keys camera, gravity, ground, fixed, objects, effects is expected"
    ):
        read_scene(text)


@pytest.mark.parametrize("objects", ["3", "[3]", "{a: 1}", "[[1]]", "null", "[null]"])
def test_objects_that_are_no_list_of_mappings_are_refused(objects: str) -> None:
    head = GOOD[: GOOD.index("objects:")]
    with pytest.raises(SceneError, match=r"objects(\[0\])?: must be a"):
        read_scene(f"{head}objects: {objects}\n")


@settings(max_examples=100, deadline=None)
@given(st.integers(0, len(GOOD)), st.integers(0, 8), st.text("[]{}:,-\n \"'*&!|>%@#0.e9nul\x00\u2028", max_size=6))
def test_whatever_the_text_reading_gives_a_scene_or_a_scene_error(place: int, cut: int, put: str) -> None:
    with contextlib.suppress(SceneError):
        assert isinstance(read_scene(GOOD[:place] + put + GOOD[place + cut :]), Scene)


def test_text_too_deep_to_read_is_a_scene_error() -> None:
    with pytest.raises(SceneError, match="not YAML"):
        read_scene("[" * 1200)


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"missing\.yaml: there is no such file"):
        load_scene(tmp_path / "missing.yaml")
    (tmp_path / "binary.yaml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SceneError, match=r"binary\.yaml: cannot be read as text"):
        load_scene(tmp_path / "binary.yaml")
    with pytest.raises(SceneError, match="is a folder"):
        load_scene(tmp_path)
    (tmp_path / "bad.yaml").write_text("gravity: 3")
    with pytest.raises(SceneError, match=r"bad\.yaml: camera: missing key"):
        load_scene(tmp_path / "bad.yaml")


def test_a_mesh_file_is_looked_for_from_the_scenes_folder(tmp_path: Path) -> None:
    scene = Scene((SceneObject("mesh", (1.0,), 1.0, file="bunny.obj"),))
    (tmp_path / "scene.yaml").write_text(write_scene(scene))
    assert load_scene(tmp_path / "scene.yaml").objects[0].file == str(tmp_path / "bunny.obj")
