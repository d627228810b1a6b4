"""`dynamics view`: every stage's shards, scenes and results become recordings."""

import shutil
from pathlib import Path

import pytest
import small_clip
from command_run import Run
from rerun.chunk import RrdReader
from toy_suite import CLIPS, make_suite


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """data/<stage>/toy with two clips, a shard each, as the stages write them; tests only read it."""
    root = tmp_path_factory.mktemp("suite")
    make_suite(root)
    return root / "data"


def entities(path: Path) -> set[str]:
    return {chunk.entity_path for chunk in RrdReader(path).stream().to_chunks()}


def recording_id(path: Path) -> str:
    (store,) = RrdReader(path).recordings()
    assert store.application_id == "dynamics"
    return store.recording_id


@pytest.mark.parametrize("stage", ["sample", "simulate", "render", "events", "flow", "infer"])
def test_whichever_stage_is_opened_the_others_of_the_suite_are_shown_along(
    run: Run, data: Path, tmp_path: Path, stage: str
) -> None:
    done = run("view", data / stage / "toy", "--clip", 1, "--save", tmp_path / "a.rrd")
    assert done.code == 0
    assert recording_id(tmp_path / "a.rrd") == "toy/1"
    there = entities(tmp_path / "a.rrd")
    truth = {f"/world/truth/{name}" for name in ("ball", "crate")}
    camera = {f"/world/camera/{kind}" for kind in ("rgb", "masks", "depth", "flow")}
    answer = {"/world/infer/ball", "/replayed/rgb", "/replayed/masks"}
    assert truth | camera | answer | {"/events/truth", "/plots/speed/truth/ball", "/notes"} <= there


@pytest.mark.parametrize("file", ["sample/toy/{}.parquet", "events/toy/events/{}.parquet", "render/toy/{}.zarr"])
def test_a_file_of_a_shard_opens_the_shards_first_clip(run: Run, data: Path, tmp_path: Path, file: str) -> None:
    assert run("view", data / file.format("shard-00001-of-00002"), "--save", tmp_path / "a.rrd").code == 0
    assert recording_id(tmp_path / "a.rrd") == "toy/1"


def test_files_without_their_manifest_show_what_they_have(run: Run, data: Path, tmp_path: Path) -> None:
    shutil.copyfile(data / "sample" / "toy" / "shard-00001-of-00002.parquet", tmp_path / "table.parquet")
    shutil.copytree(data / "render" / "toy" / "shard-00001-of-00002.zarr", tmp_path / "arrays.zarr")
    assert run("view", tmp_path / "table.parquet", "--save", tmp_path / "a.rrd").code == 0
    assert recording_id(tmp_path / "a.rrd") == "table/1"
    assert run("view", tmp_path / "arrays.zarr", "--save", tmp_path / "b.rrd").code == 0
    assert {"/world/camera/rgb", "/world/camera/masks"} <= entities(tmp_path / "b.rrd")


def test_a_scene_and_a_folder_of_results_are_shown(run: Run, shelf: Path, tmp_path: Path) -> None:
    assert run("view", shelf / "scene.yaml", "--seconds", 0.4, "--save", tmp_path / "a.rrd").code == 0
    assert recording_id(tmp_path / "a.rrd") == "scene"
    assert {"/world/scene/ball", "/world/scene/contacts", "/world/camera/depth"} <= entities(tmp_path / "a.rrd")
    (tmp_path / "out").mkdir()
    shutil.copyfile(tmp_path / "a.rrd", tmp_path / "out" / "recording.rrd")
    assert run("view", tmp_path / "out", "--save", tmp_path / "b.rrd").code == 0
    assert (tmp_path / "b.rrd").read_bytes() == (tmp_path / "a.rrd").read_bytes()


def test_without_a_display_the_way_out_is_said(run: Run, data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = run("view", data / "render" / "toy")
    assert done.code == 2
    assert "--save FILE.rrd" in done.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("render/toy", "--clip", CLIPS), f"has the clips 0 to {CLIPS - 1}"),
        (("render/none",), "there is nothing"),
        (("bad.parquet",), "damaged"),
        (("bad.zarr",), "damaged"),
        (("bad.yaml",), "not YAML"),
        (("scene.yaml", "--clip", 1), "is a scene, not clips"),
        (("empty",), "has no scene.yaml"),
    ],
)
def test_bad_input_is_one_error_and_nothing_is_written(
    run: Run, data: Path, tmp_path: Path, words: tuple[object, ...], said: str
) -> None:
    for name in ("bad.parquet", "bad.zarr", "bad.yaml"):
        (tmp_path / name).write_text("objects: [")
    (tmp_path / "scene.yaml").write_text(small_clip.TEXT)
    (tmp_path / "empty").mkdir()
    place = tmp_path / str(words[0]) if (tmp_path / str(words[0])).exists() else data / str(words[0])
    done = run("view", place, *words[1:], "--save", tmp_path / "out.rrd")
    assert done.code == 2
    assert done.err.count("\n") == 1
    assert said in done.err
    assert not (tmp_path / "out.rrd").exists()


def test_a_recording_has_its_own_suffix_and_a_missing_folder_is_named(run: Run, data: Path, tmp_path: Path) -> None:
    assert "ends in .rrd" in run("view", data / "render" / "toy", "--save", tmp_path / "a.mp4").err
    done = run("view", data / "render" / "toy", "--save", tmp_path / "none" / "a.rrd")
    assert (done.code, "none/a.rrd" in done.err) == (2, True)
