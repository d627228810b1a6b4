"""`dynamics discover` from videos: what it writes, and bad input."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from command_run import Run

from pipeline.editing.filmed_clip import CLIP, FilmedClip, write_clip
from pipeline.scene.scene import Camera, Scene, SceneObject
from pipeline.scene.text import save_scene
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.rasteriser import rasterise

TIMES = np.arange(24) / 30
CAMERA = Camera((0.1, -1.9, 1.7), 42.0, pitch=-41.0)
BALL = SceneObject("sphere", (0.07,), 0.2, 0.5, name="ball")
BRAKES = 0.6  # 1/s, of the speed
WAYS = ((1.2, 0.4), (-0.5, 1.0), (0.3, -1.2), (-0.7, -0.2))


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Clips of a ball that brakes as it rolls, as `infer` leaves them; its scene does not know of that."""
    place = tmp_path_factory.mktemp("clips")
    out = []
    for number, way in enumerate(WAYS):
        path = (1 - np.exp(-BRAKES * TIMES))[:, None] / BRAKES * way - 0.4 * np.array(way)
        position = np.column_stack([path, np.full(len(TIMES), 0.07)])[:, None]
        turn = np.tile([1.0, 0, 0, 0], (len(TIMES), 1, 1))
        masks = rasterise((BALL,), position, turn, pinhole(CAMERA), 480, 320, 0.0, ()).mask
        frames = np.repeat(np.where(masks > 0, 200, 60).astype(np.uint8)[..., None], 3, -1)
        folder = place / f"roll_{number}"
        folder.mkdir()
        write_clip(folder / CLIP, FilmedClip(frames, masks, np.arange(len(frames)) / 30))
        save_scene(Scene((BALL,), CAMERA), folder / "scene.yaml")
        out.append(folder)
    return out


def test_from_clips_the_effect_is_named_and_shows(run: Run, folders: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "found"
    done = run("discover", *folders, "-o", out, "--view", "table", "--effects", "linear_drag,rolling_resistance")
    assert done.code == 0, done.err
    report = json.loads((out / "report.json").read_text())
    assert report["verdict"]["effects"] == ["linear_drag"]
    assert report["gap"]["sequence_iou_after"] > report["gap"]["sequence_iou_before"]
    assert report["notes"][0] == "bodies were matched by their names"
    assert "sequence IoU" in done.out
    assert "forecast of frames not fitted" in (out / "report.html").read_text()
    tracks = pd.read_parquet(out / "tracks.parquet")
    assert set(tracks["clip"]) == {folder.name for folder in folders}
    assert (out / "replay.mp4").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("clip.mp4",), "--scene"),
        (("a.csv", "b.yaml", "c.yaml"), "one table of measured motion and one scene"),
        (("a.csv", "b.yaml", "--view", "side"), "--view: it is for videos"),
    ],
)
def test_inputs_that_do_not_fit_are_one_error(run: Run, tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    out = tmp_path / "found"
    done = run("discover", *words, "-o", out)
    assert (done.code, done.out) == (2, "")
    assert says in done.err
    assert not out.exists()


@pytest.mark.parametrize(
    ("text", "options", "says"),
    [
        ("a\tb\tc\n" + "\n".join(f"{9 - i}\t{i}\t{i}" for i in range(9)), (), "no header over 3 columns"),
        ("t;x;y\n" + "\n".join(f"{i};{i};{i}" for i in range(9)), ("--unit", "px"), "needs --length"),
        ("t;x;y\n" + "\n".join(f"{i};{i};{i}" for i in range(9)), ("--columns", "time=t,x=q"), "no column 'q'"),
        ("t;x;y\n" + "\n".join(f"{i};{i};{i}" for i in range(9)), ("--length", "12"), "two points in the table's unit"),
    ],
)
def test_a_table_that_cannot_be_read_is_one_error(
    run: Run, tmp_path: Path, text: str, options: tuple[str, ...], says: str
) -> None:
    (tmp_path / "drop.txt").write_text(text)
    (tmp_path / "scene.yaml").write_text("objects: [{name: ball, shape: sphere, radius: 0.02, mass: 0.01}]")
    done = run("discover", tmp_path / "drop.txt", tmp_path / "scene.yaml", "-o", tmp_path / "found", *options)
    assert (done.code, done.out) == (2, "")
    assert says in done.err
    assert not (tmp_path / "found").exists()


def test_a_clip_that_is_given_twice_is_refused(run: Run, folders: list[Path], tmp_path: Path) -> None:
    done = run("discover", folders[0], folders[0], "-o", tmp_path / "found")
    assert done.code == 2
    assert "given twice" in done.err
