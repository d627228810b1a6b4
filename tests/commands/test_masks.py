"""`dynamics masks` from end to end on a drawn clip, what it writes for `--masks`, and bad input."""

import json
from pathlib import Path

import drawn_clips
import numpy as np
import pytest
from command_run import Run
from PIL import Image

from pipeline.api.masks import masks
from pipeline.bodies.mask_source import FAMILIES, MaskSource
from pipeline.bodies.networks import published_models
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import read_frames, with_masks
from pipeline.errors import VideoError
from pipeline.vision.recordings.video import read_clip, write_video
from tests.bodies.tiny_segmenters import save_sam2

FILES = ["masks", "masks.npz", "masks.png", "overlay.mp4", "result.json", "times.json"]
PATH = drawn_clips.line((30, 60), (200, 90))


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A disc that moves over a backdrop for 1 s, from 0.2 s on."""
    rng = np.random.default_rng(6)
    frames = drawn_clips.with_disc(drawn_clips.still(rng), PATH, 12, (230, 60, 40))
    place = tmp_path_factory.mktemp("masks") / "clip.mp4"
    write_video(place, drawn_clips.recorded(rng, np.concatenate([frames[:1].repeat(6, 0), frames])), 30)
    return place


def test_what_is_found_is_written_and_read_by_infer(run: Run, video: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    done = run("masks", video, "-o", out, "--start", 0.2)
    assert done.code == 0
    assert "1 body, from the network for masks: 1 (0." in done.out
    assert sorted(p.name for p in out.iterdir()) == FILES
    result = json.loads((out / "result.json").read_text())
    assert result["files"] == FILES
    assert [b["found_by"] for b in result["bodies"]] == ["network"]
    with np.load(out / "masks.npz") as kept:
        ids, times = kept["masks"], kept["times"]
        assert (kept["ids"].tolist(), kept["scores"].shape) == ([1], (1,))
    assert ids.shape == (30, drawn_clips.HEIGHT, drawn_clips.WIDTH)
    np.testing.assert_allclose(times, 0.2 + np.arange(30) / 30, atol=1e-3)
    centres = np.array([np.argwhere(i == 1).mean(0)[::-1] + 0.5 for i in ids])
    assert np.abs(centres - PATH)[2:-2].max() < 2
    pictures = [np.asarray(Image.open(p)) for p in sorted((out / "masks").iterdir())]
    np.testing.assert_array_equal(pictures, ids)
    assert len(read_clip(out / "overlay.mp4").frames) == 30

    again = with_masks(read_frames(video, start=0.2, source=MaskSource(out / "masks.npz")), Prompts())
    np.testing.assert_array_equal(again.masks[:, 1::2, 1::2], ids)
    later = with_masks(read_frames(video, start=0.4, seconds=0.5, source=MaskSource(out / "masks.npz")), Prompts())
    np.testing.assert_array_equal(later.masks[:, 1::2, 1::2], ids[6:21])
    with pytest.raises(VideoError, match=r"has masks from 0\.20 to 1\.17 s .*needs them from 0\.00 to 0\.97 s"):
        with_masks(read_frames(video, source=MaskSource(out / "masks.npz")), Prompts())


def test_python_finds_the_same_and_saves_it(video: Path, tmp_path: Path) -> None:
    found = masks(video, start=0.2)
    assert found.masks.max() == len(found.found.bodies) == 1
    found.save(tmp_path / "out")
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == FILES


def test_a_clip_in_slow_motion_is_looked_at_in_at_least_thirty_frames(tmp_path: Path) -> None:
    frames = np.stack([np.full((32, 48, 3), k, np.uint8) for k in range(120)])
    write_video(tmp_path / "slow.mp4", frames, 30)
    read = read_frames(tmp_path / "slow.mp4", seconds=0.4, assume_fps=240)
    assert read.filmed is not None
    assert len(read.clip.frames) == len(read.filmed.frames) == 32  # one of three
    usual = read_frames(tmp_path / "slow.mp4", seconds=0.4)
    assert usual.filmed is not None
    assert len(usual.filmed.frames) == 12  # all that there are, each but once
    assert (np.diff(usual.filmed.source_times) > 0.02).all()


def test_a_published_segmenter_follows_what_is_found_and_what_the_user_points_at(
    run: Run, video: Path, tmp_path: Path
) -> None:
    assert tuple(published_models.FAMILIES) == FAMILIES
    weights = save_sam2(tmp_path / "sam2")
    done = run("masks", video, "-o", tmp_path / "out", "--masks", f"sam2:{weights}", "--point", "200,20")
    assert done.code in (0, 2)  # its weights are random: it may find nothing
    if done.code == 0:
        result = json.loads((tmp_path / "out" / "result.json").read_text())
        assert {b["found_by"] for b in result["bodies"]} == {"sam2"}
        assert any("sam2 follows 1 bodies" in note for note in result["notes"])
    else:
        assert "sam2 finds none of the 2 bodies" in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--point", "500,20"), "--point 500,20: it is outside of the picture; valid: x from 0 to 239"),
        (("--point", "20,20,7"), "7 s is outside of the clip; valid: "),
        (("--objects", "0"), "objects: 0; valid: 1 or more"),
        (("--masks", "sam2:"), "names no folder; valid: sam2:PATH"),
        (("--masks", "sam2:none"), "none is not a folder"),
        (("--masks", "masks.npz"), "is no segmenter; valid: sam2:PATH, edgetam:PATH"),
        (("--start", "9"), "is after its end"),
    ],
)
def test_bad_input_is_one_error_and_nothing_is_written(
    run: Run, video: Path, tmp_path: Path, words: tuple[str, ...], said: str
) -> None:
    done = run("masks", video, "-o", tmp_path / "out", *words)
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert said in done.err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("words", [("--point", "5"), ("--box", "1,2,3"), ("--ignore", "a,b"), ("--point", "1,nan")])
def test_prompts_of_another_form_are_refused(run: Run, video: Path, tmp_path: Path, words: tuple[str, ...]) -> None:
    done = run("masks", video, "-o", tmp_path / "out", *words)
    assert done.code == 2
    assert "argument" in done.err


def test_given_masks_and_prompts_contradict_each_other(run: Run, video: Path, tmp_path: Path) -> None:
    done = run("infer", video, "-o", tmp_path / "out", "--masks", "masks.npz", "--objects", 2)
    assert done.code == 2
    assert "--masks masks.npz: points, boxes and numbers of objects are for masks that are found" in done.err
