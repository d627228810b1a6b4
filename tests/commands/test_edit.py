"""`dynamics edit`: what it writes, and what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest
import small_clip
from command_run import Run

from pipeline.editing.filmed_clip import CLIP, FilmedClip, write_clip
from pipeline.scene.text import load_scene
from pipeline.vision.recordings.video import read_clip

FILES = ["beside.mp4", "edited.mp4", "recording.rrd", "result.json", "scene.xml", "scene.yaml", "times.json"]


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as `dynamics infer` writes it, as far as `dynamics edit` reads it."""
    folder = tmp_path_factory.mktemp("found")
    (folder / "scene.yaml").write_text(small_clip.TEXT)
    write_clip(folder / CLIP, FilmedClip(small_clip.frames(), small_clip.masks(), small_clip.SCHEDULE.times))
    return folder


def test_an_edit_writes_the_edited_clip_and_where_its_pixels_come_from(run: Run, found: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("edit", found, "--set", "objects[ball].mass=4", "--remove", "crate", "--at", "0.5", "-o", out)
    assert done.code == 0, done.err
    assert sorted(p.name for p in out.iterdir()) == FILES
    assert read_clip(out / "edited.mp4", size=(240, 160)).source_size == (240, 160)
    scene = load_scene(out / "scene.yaml")
    assert [(o.name, o.mass) for o in scene.objects] == [("ball", 4)]
    result = json.loads((out / "result.json").read_text())
    assert result["files"] == FILES
    assert [e["at"] for e in result["edits"]] == [0.5, 0.5]
    assert sum(result["pixels"].values()) == pytest.approx(1, abs=1e-3)
    assert result["first_edited_frame"] == 15


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--remove", "crat"], "did you mean 'crate'"),
        (["--set", "objects[9].mass=2"], "valid: 0 to 1"),
        (["--set", "objects[0].mass=2", "--at", "3"], "the clip is 1 s long"),
        (["--set", "objects[0].position=[0.35, 0.3, 0.5]"], "mm inside"),
        (["--add", "none.yaml"], "there is no such file"),
        (["--edits", "none.yaml"], "there is no such file"),
    ],
)
def test_a_wrong_edit_ends_with_one_line_and_writes_nothing(
    run: Run, found: Path, tmp_path: Path, words: list[str], message: str
) -> None:
    done = run("edit", found, *words, "-o", tmp_path / "out")
    assert done.code == 2
    assert message in done.err
    assert done.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_without_a_clip_is_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "scene.yaml").write_text(small_clip.TEXT)
    done = run("edit", tmp_path / "found", "-o", tmp_path / "out")
    assert done.code == 2
    assert "clip.npz: there is no such file; valid: a folder that `dynamics infer` wrote" in done.err
    np.savez(tmp_path / "found" / CLIP, frames=np.zeros(3))
    assert "no clip of `dynamics infer`" in run("edit", tmp_path / "found", "-o", tmp_path / "out").err
