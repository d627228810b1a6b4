"""`dynamics simulate`: the edited motion is MuJoCo's, and the outputs say the same."""

import csv
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest
import small_clip
from command_run import Run, files_no_larger_than

from pipeline.api.scene_source import read_scene_source, with_camera
from pipeline.model.language.completion import write_completion
from pipeline.physics.simulate import simulate
from pipeline.scene.canonical import rounded_scene
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.text import load_scene, write_scene
from pipeline.vision.recordings.video import read_clip
from pipeline.vision.rendering.camera import pinhole, project

FILES = ["recording.rrd", "replay.mp4", "result.json", "scene.xml", "scene.yaml", "trajectory.csv"]


def test_a_what_if_writes_the_scene_the_motion_and_both_videos(run: Run, shelf: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("simulate", shelf / "scene.yaml", "--set", "gravity=3.7", "--set", "objects[ball].mass=4", "-o", out)
    assert done.code == 0
    assert sorted(p.name for p in out.iterdir()) == FILES
    scene = load_scene(out / "scene.yaml")
    assert (scene.gravity, scene.objects[0].mass) == ((0, 0, -3.7), 4)

    clip = read_clip(out / "replay.mp4", size=(964, 320))
    assert clip.source_size == (964, 320)

    rows = list(csv.DictReader((out / "trajectory.csv").open()))
    edited = simulate(scene, 1.0)
    mine = [r for r in rows if (r["clip"], r["object"]) == ("edited", "crate")]
    got = np.array([[float(r[k]) for k in "xyz"] for r in mine])
    np.testing.assert_allclose(got, edited.position[:, 1], atol=1e-5)

    model = mujoco.MjModel.from_xml_string((out / "scene.xml").read_text())  # plain MuJoCo moves likewise
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    for _ in range(240):
        mujoco.mj_step(model, data)
    np.testing.assert_allclose(data.body("crate").xpos, edited.position[-1, 1], atol=5e-3)

    result = json.loads((out / "result.json").read_text())
    assert result["files"] == FILES
    assert result["departures"][1]["end"] == pytest.approx(
        np.linalg.norm(edited.position[-1, 1] - small_clip.trace().position[-1, 1])
    )


def test_without_a_change_nothing_departs_and_nothing_is_written(run: Run, shelf: Path, tmp_path: Path) -> None:
    before = sorted(tmp_path.iterdir())
    done = run("simulate", shelf / "scene.yaml", "--seconds", "0.5")
    lines = done.out.splitlines()
    assert [line.split()[:3] for line in lines[1:3]] == [["ball", "sphere", "0.000"], ["crate", "box", "0.000"]]
    assert "nothing was changed" in lines[3]
    assert sorted(tmp_path.iterdir()) == before


BALL = """\
{name: new, shape: sphere, radius: 0.05, mass: 0.1, sliding_friction: 0.5, rolling_friction: 0.0, damping: 1.0,
 position: [0, 0.5, 0.6], velocity: [0, 0, 0], angular_velocity: [0, 0, 0], orientation: [1, 0, 0, 0]}
"""


def test_bodies_are_removed_and_added_at_a_time_as_by_edit(run: Run, shelf: Path, tmp_path: Path) -> None:
    (tmp_path / "ball.yaml").write_text(BALL)
    edits = f"edits:\n- {{at: 0.5, remove: crate}}\n- {{at: 0.5, add: {BALL.strip()}}}\n"
    (tmp_path / "edits.yaml").write_text(edits)
    words = ("--remove", "crate", "--add", tmp_path / "ball.yaml", "--at", "0.5")
    one = run("simulate", shelf / "scene.yaml", *words, "-o", tmp_path / "one")
    other = run("simulate", shelf / "scene.yaml", "--edits", tmp_path / "edits.yaml", "-o", tmp_path / "other")
    assert (one.code, other.code) == (0, 0)
    for name in ("scene.yaml", "trajectory.csv"):
        assert (tmp_path / "one" / name).read_text() == (tmp_path / "other" / name).read_text()
    assert [o.name for o in load_scene(tmp_path / "one" / "scene.yaml").objects] == ["ball", "new"]
    assert [line.split()[2] for line in one.out.splitlines()[1:4]] == ["0.000", "removed", "added"]
    rows = list(csv.DictReader((tmp_path / "one" / "trajectory.csv").open()))
    times = {k: [float(r["time"]) for r in rows if (r["clip"], r["object"]) == ("edited", k)] for k in ("crate", "new")}
    assert times["crate"] == pytest.approx(np.arange(120) / 240, abs=1e-6)
    assert times["new"] == pytest.approx(np.arange(120, 241) / 240, abs=1e-6)
    falls = [float(r["z"]) for r in rows if (r["clip"], r["object"]) == ("edited", "new")][:24]
    t = np.arange(24) / 240
    np.testing.assert_allclose(falls, 0.6 - 0.5 * 9.81 * t**2, atol=5e-3)


def test_an_edit_after_the_end_is_refused_and_nothing_is_written(run: Run, shelf: Path, tmp_path: Path) -> None:
    done = run("simulate", shelf / "scene.yaml", "--remove", "crate", "--at", "1.5", "-o", tmp_path / "out")
    assert done.code == 2
    assert "remove crate at 1.5 s: the run is 1 s long; valid: 0 to less than 1" in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [300, 20_000, 400_000])
def test_a_full_disk_is_one_error_and_leaves_nothing(run: Run, shelf: Path, tmp_path: Path, size: int) -> None:
    words = ("simulate", shelf / "scene.yaml", "--set", "gravity=3", "-o", tmp_path / "new" / "out")
    with files_no_larger_than(size):
        done = run(*words)
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert done.err.startswith("error: cannot write")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "there is no such file"),
        ("", "a mapping with the keys"),
        ("objects: [", "not YAML"),
        (small_clip.TEXT.replace("radius", "radios"), "did you mean 'radius'"),
        (small_clip.TEXT[: small_clip.TEXT.index("objects:")] + "objects: []\n", "there are none"),
    ],
)
def test_a_bad_scene_is_one_error(run: Run, tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / "scene.yaml").write_text(text)
    before = sorted(tmp_path.iterdir())
    done = run("simulate", tmp_path / "scene.yaml", "--set", "gravity=1", "-o", tmp_path / "out")
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert words in done.err
    assert sorted(tmp_path.iterdir()) == before


def test_a_scene_is_read_from_a_file_an_answer_or_a_folder(shelf: Path, tmp_path: Path) -> None:
    scene = rounded_scene(small_clip.scene())
    answer = tmp_path / "answer.txt"
    answer.write_text(write_completion(scene, [], 1.0) + "\n")
    from_answer = read_scene_source(answer)
    assert [(o.shape, o.size, o.velocity) for o in from_answer.objects] == [
        (o.shape, o.size, o.velocity) for o in scene.objects
    ]
    assert read_scene_source(shelf) == read_scene_source(shelf / "scene.yaml") == small_clip.scene()


def test_a_camera_that_is_made_sees_the_whole_motion(rng: np.random.Generator) -> None:
    for _ in range(50):
        objects = tuple(
            SceneObject("sphere", (float(rng.uniform(0.05, 0.5)),), 1.0) for _ in range(int(rng.integers(1, 4)))
        )
        positions = rng.uniform(-2, 2, (20, len(objects), 3)) * rng.uniform(0, 1) + [0, 0, 2]
        seen, note = with_camera(Scene(objects), positions)
        assert note is not None
        assert seen.camera is not None
        uv, depth = project(positions, pinhole(seen.camera), 480, 320)
        assert (depth > 0).all()
        assert ((uv >= 0) & (uv <= [480, 320])).all()
    with_one = Scene(objects, Camera((0, 0, 0), 30, 0.0))
    assert with_camera(with_one, positions) == (with_one, None)


@pytest.mark.parametrize("seconds", [2 / 30, 0.2, 10 / 30])
def test_short_runs_are_shown_too(run: Run, shelf: Path, tmp_path: Path, seconds: float) -> None:
    done = run("simulate", shelf / "scene.yaml", "--seconds", seconds, "-o", tmp_path / "out")
    assert done.code == 0
    frames = read_clip(tmp_path / "out" / "replay.mp4", seconds=seconds).frames
    assert len(frames) == round(30 * seconds)


def test_a_scene_without_a_camera_gets_one_that_is_said(run: Run, tmp_path: Path) -> None:
    scene = small_clip.scene()
    (tmp_path / "bare.yaml").write_text(write_scene(Scene(scene.objects, None, scene.gravity, scene.ground)))
    done = run("simulate", tmp_path / "bare.yaml", "--set", "gravity=4", "--seconds", "0.2", "-o", tmp_path / "out")
    assert done.code == 0
    assert "the scene has no camera" in done.out
    assert load_scene(tmp_path / "out" / "scene.yaml").camera is None
