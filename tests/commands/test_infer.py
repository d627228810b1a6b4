"""`dynamics infer` from end to end on a short drawn clip with a model that has learned nothing, and on bad input."""

import json
import os
import shutil
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import small_clip
from command_run import Run, files_no_larger_than
from PIL import Image
from rerun.chunk import RrdReader

from pipeline.api.infer_files import relabelled
from pipeline.bodies.mask_source import MaskSource
from pipeline.bodies.prompts import Prompts
from pipeline.bodies.user_clip import NETWORK, read_frames, with_masks
from pipeline.clips.overlap import overlap
from pipeline.clips.replay import replay
from pipeline.errors import VideoError
from pipeline.inference.find_scenes import SEARCH_SIZE
from pipeline.inference.measured_clip import MeasuredClip, check_motion, clip_schedule, limits, measured_clip
from pipeline.inference.scene_search import clip_evaluator
from pipeline.physics.simulate import simulate
from pipeline.scene.edited import edited
from pipeline.scene.text import load_scene
from pipeline.search.best_of_k import rank
from pipeline.vision.flow.dis import DIS
from pipeline.vision.flow.measured_flow import measured_flow, recorded_pairs
from pipeline.vision.flow.raft import RAFT
from pipeline.vision.recordings.video import read_clip

FILES = [
    "clip.npz",
    "masks.png",
    "motion.png",
    "overlay.png",
    "recording.rrd",
    "replay.mp4",
    "result.json",
    "scene.xml",
    "scene.yaml",
    "tracks.parquet",
]


def words(shelf: Path, clip: Path, out: Path, *more: object) -> tuple[object, ...]:
    return ("infer", clip, "-o", out, "--model", shelf / "model", "--flow", "dis", "--samples", 2, *more)


def measured(clip: Path, masks: Path) -> MeasuredClip:
    """A clip with masks, and its flow by DIS."""
    taken = with_masks(read_frames(clip, source=MaskSource(masks)), Prompts())
    schedule = clip_schedule(clip, taken.clip.times)
    seen, pairs = taken.clip, schedule.pairs
    flow = measured_flow(DIS(), seen.frames, seen.source_times, pairs, 1 / schedule.fps, 1, (240, 160))
    return measured_clip("clip", taken, schedule, flow)


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the first test writes its results and later ones find them."""
    return tmp_path_factory.mktemp("infer") / "new" / "out"


def test_a_clip_becomes_a_folder_of_results(run: Run, shelf: Path, out: Path) -> None:
    asked = "--view", "table", "--search", 210, "--masks", shelf / "masks.npz", "--seed", 7
    done = run(*words(shelf, shelf / "clip.mp4", out, *asked))
    assert done.code == 0
    assert sorted(p.name for p in out.iterdir()) == FILES
    result = json.loads((out / "result.json").read_text())
    assert result["files"] == FILES
    assert result["assumed"]["masks_from"] == "masks.npz"
    assert result["assumed"]["instances"] == 2

    methods = {m["method"]: m for m in result["methods"]}
    assert list(methods) == ["greedy", "best of K", "search"]  # tracks of boxes on a table give no scene
    assert methods["greedy"]["reward"] <= methods["best of K"]["reward"]  # the search parts bodies first, and may lose
    assert result["answer"]["from"] == max(methods, key=lambda name: methods[name]["reward"])
    assert methods["search"]["simulations"] <= 3 + 210
    assert all(0 <= m["sequence_iou"] <= 1 for m in methods.values())
    for name, method in methods.items():
        assert name in done.out
        assert method["composition"] in done.out

    scene = load_scene(out / "scene.yaml")
    assert scene.composition == result["answer"]["composition"]
    simulate(scene)
    model = mujoco.MjModel.from_xml_string((out / "scene.xml").read_text())
    assert model.nbody == len(scene.objects) + 1
    assert len(read_clip(out / "replay.mp4").frames) == small_clip.SCHEDULE.frames
    with Image.open(out / "overlay.png") as picture:
        assert picture.size[0] > 1500
    (store,) = RrdReader(out / "recording.rrd").recordings()
    assert (store.application_id, store.recording_id) == ("dynamics", "clip")


def test_a_folder_brings_its_masks_and_the_same_seed_gives_the_same_scene(
    run: Run, shelf: Path, out: Path, tmp_path: Path
) -> None:
    if not out.exists():
        pytest.skip("test_a_clip_becomes_a_folder_of_results did not run here")
    folder = tmp_path / "recorded"
    folder.mkdir()
    os.link(shelf / "clip.mp4", folder / "clip.mp4")
    os.link(shelf / "masks.npz", folder / "masks.npz")
    assert run(*words(shelf, folder, tmp_path / "again", "--view", "table", "--search", 210, "--seed", 7)).code == 0
    assert (tmp_path / "again" / "scene.yaml").read_text() == (out / "scene.yaml").read_text()


def test_a_portrait_clip_with_raft_and_without_masks(run: Run, shelf: Path, tmp_path: Path) -> None:
    RAFT("small").save(tmp_path / "raft")
    small_clip.write(tmp_path / "portrait.mp4", np.ascontiguousarray(small_clip.frames().swapaxes(1, 2)))
    model = small_clip.write_model(tmp_path / "model", replace(small_clip.INPUT, flow_iterations=1))
    done = run(
        "infer",
        tmp_path / "portrait.mp4",
        "-o",
        tmp_path / "out",
        "--model",
        model,
        "--raft",
        tmp_path / "raft",
        "--samples",
        0,
    )
    assert done.code == 0
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["assumed"]["masks_from"] == NETWORK
    assert result["assumed"]["size_px"] == [320, 480]
    assert result["methods"][0]["method"] == "greedy"


def test_at_a_variable_frame_rate_masks_of_the_recordings_frames_are_those_of_the_clips(tmp_path: Path) -> None:
    clip, masks = small_clip.write_uneven(tmp_path / "uneven.mp4"), small_clip.masks()
    recorded = [k for k in range(len(masks)) if k % 3 != 1]
    np.savez(tmp_path / "masks.npz", masks=masks[recorded])
    found = measured(clip, tmp_path / "masks.npz")
    assert any("variable frame rate" in note for note in found.notes)
    np.testing.assert_array_equal(found.taken.masks[:, 1::2, 1::2], masks[recorded])
    np.testing.assert_allclose(found.schedule.times, np.array(recorded) / 30, atol=1e-3)


def test_flow_is_measured_over_recorded_times_and_told_per_frame_interval() -> None:
    interval, pairs = 1 / 30, np.array([[0, 1], [1, 2], [2, 3], [3, 4]])
    recorded = np.array([0.0, 0.0, 0.05, 0.08, 0.08])  # frames 1 and 4 repeat those before
    first, second, scale = recorded_pairs(recorded, pairs, interval)
    assert first.tolist() == [0, 1, 2, 2]
    assert second.tolist() == [2, 2, 3, 4]
    np.testing.assert_allclose(scale * (recorded[second] - recorded[first]), interval)
    first, second, scale = recorded_pairs(np.arange(5) * interval, pairs, interval)
    np.testing.assert_array_equal(np.stack([first, second], 1), pairs)
    np.testing.assert_allclose(scale, 1)


def test_the_scene_that_was_filmed_is_the_one_that_fits_its_clip(shelf: Path) -> None:
    truth = small_clip.scene()
    moved = edited(truth, ["objects[ball].velocity=[-0.6, 0, 0]", "objects[crate].position[0]=0.6"])
    clip = measured(shelf / "clip.mp4", shelf / "masks.npz")
    ranking = rank(clip_evaluator(clip.taken.masks, clip.flow, clip.schedule, SEARCH_SIZE, 1), [moved, truth])
    assert ranking.order.tolist() == [1, 0]
    assert ranking.rewards.iou[1] > 0.92  # at 120x80
    assert ranking.rewards.epe_frame[1] < ranking.rewards.epe_frame[0]
    seen = overlap(replay(truth, clip.schedule).masks, clip.taken.masks, 2, clip.objects)
    assert min(seen.sequence, seen.initial, seen.foreground) > 0.95
    assert seen.pairs.tolist() == [[0, 0], [1, 1]]


@pytest.fixture
def broken(shelf: Path, tmp_path: Path) -> Path:
    """A folder with videos and masks that cannot be used."""
    folder = tmp_path / "broken"
    folder.mkdir()
    frames = small_clip.frames()
    (folder / "empty.mp4").touch()
    (folder / "text.mp4").write_text("not a video")
    whole = (shelf / "clip.mp4").read_bytes()
    (folder / "cut.mp4").write_bytes(whole[: len(whole) * 4 // 5])
    (folder / "head.mp4").write_bytes(whole[:600])
    small_clip.write(folder / "one.mp4", frames[:1])
    small_clip.write(folder / "short.mp4", frames[:12])
    small_clip.write(folder / "still.mp4", np.repeat(frames[:1], 30, 0))
    (folder / "folder").mkdir()
    np.savez(folder / "few.npz", masks=small_clip.masks()[:7])
    np.savez(folder / "blank.npz", masks=np.zeros((30, 160, 240), np.uint8))
    np.savez(folder / "still.npz", masks=np.repeat(small_clip.masks()[:1], 30, 0))
    (folder / "weights").mkdir()
    for name, model_input in (
        ("unrecorded", None),
        ("other", {"picture": "wheels"}),
        ("raft", {"flow_source": "raft"}),
    ):
        shutil.copytree(shelf / "model", folder / name)
        record = folder / name / "model_input.json"
        if model_input is None:
            record.unlink()
        else:
            record.write_text(json.dumps(json.loads(record.read_text()) | model_input))
    return folder


@pytest.mark.parametrize(
    ("clip", "more", "said"),
    [
        ("none.mp4", (), "there is no such file"),
        ("empty.mp4", (), "is empty"),
        ("text.mp4", (), "is not a video"),
        ("cut.mp4", ("--seconds", 1), "s from 0 s on does not fit"),
        ("head.mp4", (), "broken"),
        ("one.mp4", (), "has one frame only"),
        ("short.mp4", ("--seconds", 1), "at most 0.40 s do"),
        ("short.mp4", ("--start", 3), "is after its end"),
        ("short.mp4", ("--seconds", 0.1), "are too short"),
        ("short.mp4", ("--start", -1), "the start must be 0 or more"),
        ("still.mp4", (), "nothing moves"),
        ("still.mp4", ("--masks", "broken/still.npz"), "nothing moves"),
        ("folder", (), "has no video"),
        ("../clip.mp4", ("--masks", "broken/none.npz"), "there are no masks"),
        ("../clip.mp4", ("--masks", "broken/few.npz"), "has 7 masks; valid: 30"),
        ("../clip.mp4", ("--masks", "broken/blank.npz"), "masks are empty"),
        ("../clip.mp4", ("--masks", "broken/text.mp4"), "is no mask file"),
        ("../clip.mp4", ("--model", "broken/none"), "error: --model: 'broken/none' is neither a folder"),
        ("../clip.mp4", ("--model", "broken/weights"), "neither a folder"),
        ("../clip.mp4", ("--model", "Qwen/Qwen2.5-VL-3B-Instruct"), "hf download Qwen/Qwen2.5-VL-3B-Instruct"),
        ("../clip.mp4", ("--flow", "raft", "--raft", "broken/none"), "no RAFT weights"),
        ("../clip.mp4", ("--flow", "raft", "--raft", "broken/weights"), "has no model.safetensors"),
        ("../clip.mp4", ("--search", 7), "at least 200"),
        ("../clip.mp4", ("--distortion", 0.9), "--distortion 0.9: valid: -0.3 to 0.3"),
        ("../clip.mp4", ("--steady", "--masks", "broken/few.npz"), "are those of frames that are not corrected"),
        ("../clip.mp4", ("--model", "broken/unrecorded"), "has no model_input.json"),
        (
            "../clip.mp4",
            ("--model", "broken/other"),
            'model_input.json: `picture` is "wheels"; valid: "channels", "wheel"',
        ),
        (
            "../clip.mp4",
            ("--model", "broken/raft", "--flow", "dis"),
            'flow is "dis", but broken/raft was trained with flow_source "raft" (model_input.json); valid: "raft"',
        ),
    ],
)
def test_bad_input_is_one_error_and_nothing_is_written(
    run: Run,
    shelf: Path,
    tmp_path: Path,
    broken: Path,
    monkeypatch: pytest.MonkeyPatch,
    clip: str,
    more: tuple[object, ...],
    said: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HF_HOME", str(tmp_path / "hub"))
    monkeypatch.setenv("HF_HUB_OFFLINE", "1")
    os.link(shelf / "clip.mp4", tmp_path / "clip.mp4")
    before = sorted(p for p in tmp_path.rglob("*") if "hub" not in p.parts)
    done = run(*words(shelf, broken / clip, tmp_path / "new" / "out", *more))
    assert done.code == 2
    assert done.err.startswith("error: ")
    assert done.err.count("\n") == 1
    assert said in done.err
    assert sorted(p for p in tmp_path.rglob("*") if "hub" not in p.parts) == before


@pytest.mark.parametrize("place", ["file", "file/out"])
def test_an_output_folder_that_cannot_be_made_is_said_before_any_work(
    run: Run, shelf: Path, tmp_path: Path, place: str
) -> None:
    (tmp_path / "file").write_text("mine")
    done = run(*words(shelf, shelf / "clip.mp4", tmp_path / place))
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert "masks" not in done.out
    assert [p.name for p in tmp_path.iterdir()] == ["file"]


def test_a_full_disk_leaves_nothing(run: Run, shelf: Path, tmp_path: Path) -> None:
    with files_no_larger_than(9_000):  # the scene fits, the video does not
        done = run(*words(shelf, shelf / "clip.mp4", tmp_path / "out", "--samples", 0, "--masks", shelf / "masks.npz"))
    assert done.code == 2
    assert done.err.startswith("error: cannot write")
    assert done.err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_existing_result_is_replaced_with_force_alone(run: Run, shelf: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "result.json").write_text('{"command": "infer", "files": ["result.json"]}')
    refused = run(*words(shelf, shelf / "clip.mp4", out))
    assert refused.code == 2
    assert "--force" in refused.err
    assert [p.name for p in out.iterdir()] == ["result.json"]


def test_masks_take_the_ids_of_the_objects_they_belong_to() -> None:
    masks = np.array([[[0, 1, 2, 3]]], np.uint8)
    pairs = np.array([[0, 2], [1, 0]])  # object 0 is instance 3, object 1 is instance 1
    np.testing.assert_array_equal(relabelled(masks, pairs, 2), [[[0, 2, 3, 1]]])


def test_motion_is_looked_for_in_the_masks() -> None:
    masks = np.zeros((10, 8, 8), np.uint8)
    masks[:, 2:4, 2:4] = 1
    moving = np.where(masks > 0, 2.0, 0.0)
    check_motion("clip", moving, masks)
    with pytest.raises(VideoError, match="nothing moves"):
        check_motion("clip", 2 - moving, masks)
    assert limits(masks, 1.0) == []
    assert "1 s" in limits(masks, 2.0)[0]
    assert "--objects" in limits(masks * 9, 1.0)[0]
