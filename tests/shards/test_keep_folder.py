"""Laws of results that are kept whole."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from toy_stage import make

from pipeline.errors import ShardError
from pipeline.shards.contents import check_contents
from pipeline.shards.dataset import ShardedDataset
from pipeline.shards.keep_folder import keep_folder
from pipeline.shards.prune import prune
from pipeline.shards.store import Store


@dataclass(frozen=True)
class Training:
    """stop: a file; where it is there, a first run stops half way."""

    stop: Path


def train(folder: Path, scratch: Path, inputs: Sequence[ShardedDataset], parameters: Training) -> dict[str, float]:
    """The mean mass, in steps that are counted in `scratch`; a run may stop after some."""
    (dropped,) = inputs
    done = scratch / "steps"
    first = int(done.read_text()) if done.exists() else 0
    for step in range(first, 4):
        if step == 2 and first == 0 and parameters.stop.exists():
            raise KeyboardInterrupt
        done.write_text(str(step + 1))
    (folder / "weights").mkdir()
    (folder / "weights" / "mean").write_text(str(sum(clip.row()["mass"] for clip in dropped) / len(dropped)))
    return {"first step": first}


def run(root: Path) -> None:
    keep_folder(
        "train",
        root / "model",
        train,
        parameters=Training(root / "stop"),
        inputs=[root / "drop" / "train"],
        store=Store(root / "store"),
    )


def test_a_result_is_computed_once_and_then_kept(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path)
    run(tmp_path)
    mean = (tmp_path / "model" / "weights" / "mean").read_text()
    (tmp_path / "model" / "stray").touch()
    run(tmp_path)
    _, first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("train: computed, ")
    assert second.startswith("train: from the store, ")
    assert second.endswith("; first step 0")
    assert {path.name for path in (tmp_path / "model").iterdir()} == {"contents.json", "weights"}
    assert (tmp_path / "model" / "weights" / "mean").read_text() == mean


def test_the_notes_that_are_printed_are_those_of_the_run_that_computed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path)
    capsys.readouterr()
    for _ in range(2):
        run(tmp_path)
    assert [line.rpartition("; ")[2] for line in capsys.readouterr().out.splitlines()] == ["first step 0"] * 2


def test_another_input_makes_another_result(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for clips in (20, 24):
        make(tmp_path, clips=clips)
        run(tmp_path)
    assert capsys.readouterr().out.count("train: computed") == 2


def test_a_run_that_is_stopped_goes_on_from_its_scratch_and_leaves_none_at_the_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path)
    (tmp_path / "stop").touch()
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path)
    assert not (tmp_path / "model").exists()
    assert len(list(Store(tmp_path / "store").scratches())) == 1
    run(tmp_path)
    assert capsys.readouterr().out.endswith("; first step 2\n")
    assert not list(Store(tmp_path / "store").scratches())


def test_old_scratch_is_pruned_where_no_process_uses_it(tmp_path: Path) -> None:
    store = Store(tmp_path)

    def stopped() -> None:
        with store.scratch("ab" * 32):
            prune(store, keep_days=0)
            assert len(list(store.scratches())) == 1
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    prune(store, keep_days=1)
    assert len(list(store.scratches())) == 1
    prune(store, keep_days=0)
    assert not list(store.scratches())


def test_a_flipped_file_of_the_folder_is_noticed_by_those_who_read_it(tmp_path: Path) -> None:
    make(tmp_path)
    run(tmp_path)
    file = next(path for path in (tmp_path / "model" / "weights").iterdir())
    check_contents(tmp_path / "model")
    check_contents(file)
    file.chmod(0o644)
    file.write_bytes(b"\0" + file.read_bytes()[1:])
    for place in (tmp_path / "model", file):
        with pytest.raises(ShardError, match=f"{file.name} is damaged .*dynamics store fsck"):
            check_contents(place)
    file.unlink()
    with pytest.raises(ShardError, match=f"{file.name} is missing"):
        check_contents(file)
    (tmp_path / "model" / "contents.json").write_text("{}")
    with pytest.raises(ShardError, match=r"contents.json is damaged"):
        check_contents(file)


def test_damaged_input_is_refused(tmp_path: Path) -> None:
    make(tmp_path)
    (tmp_path / "drop" / "train" / "shard-00002-of-00005.zarr" / "mask" / "zarr.json").unlink()
    with pytest.raises(ShardError, match=r"mask/zarr.json is missing"):
        run(tmp_path)
    assert not (tmp_path / "model").exists()
