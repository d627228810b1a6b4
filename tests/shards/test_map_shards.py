"""Laws of computing shards."""

import json
from pathlib import Path

import numpy as np
import pytest
from toy_stage import drop_until_shard_2, make, make_weights

from pipeline.errors import OutputError, ShardError, SimulationError
from pipeline.shards.content_hash import hash_files
from pipeline.shards.dataset import open_shards
from pipeline.shards.map_shards import map_shards
from pipeline.shards.shard import ShardResult
from pipeline.shards.store import Store


def computed(capsys: pytest.CaptureFixture[str]) -> list[int]:
    """How many shards each run since the last call has computed, from the lines of outcome."""
    lines = capsys.readouterr().out.splitlines()
    return [int(line.split(" computed")[0].rsplit(" ", 1)[1]) for line in lines if " computed" in line]


def test_the_bytes_are_the_same_with_one_and_two_workers(tmp_path: Path) -> None:
    for workers in (1, 2):
        make(tmp_path / str(workers), workers=workers)
        make_weights(tmp_path / str(workers), workers=workers)
    for stage in ("drop", "weigh"):
        assert hash_files(tmp_path / "1" / stage) == hash_files(tmp_path / "2" / stage)


def test_the_outcome_is_one_line_with_the_notes_summed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path, clips=18)
    line = capsys.readouterr().out
    assert line.startswith("drop train: 5 shards, 5 computed, 0 from the store, 18 clips, ")
    assert line.endswith("; rejected 36\n")
    make(tmp_path, clips=18)
    assert capsys.readouterr().out.endswith("; rejected 36\n")  # known without computing


def test_a_second_run_computes_nothing_though_its_output_is_gone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make(tmp_path)
    before = hash_files(tmp_path / "drop")
    for path in sorted((tmp_path / "drop").rglob("*"), reverse=True):
        path.unlink() if path.is_file() else path.rmdir()
    make(tmp_path)
    assert computed(capsys) == [5, 0]
    assert hash_files(tmp_path / "drop") == before


def test_one_more_shard_of_clips_computes_one_shard_a_stage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for clips in (20, 24):
        make(tmp_path, clips=clips)
        make_weights(tmp_path)
    assert computed(capsys) == [5, 5, 1, 1]
    assert len(open_shards(tmp_path / "weigh" / "train")) == 24


def test_a_partial_last_shard_is_computed_again_when_it_grows(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for clips in (18, 19):
        make(tmp_path, clips=clips)
    assert computed(capsys) == [5, 1]


def test_a_clip_is_the_same_whatever_the_shard_size(tmp_path: Path) -> None:
    datasets = []
    for size in (3, 7, 20):
        make(tmp_path / str(size), shard_size=size)
        datasets.append(open_shards(tmp_path / str(size) / "drop" / "train"))
    for first, *others in zip(*datasets, strict=True):
        for other in others:
            assert first.row() == other.row()
            assert first.rows("events") == other.rows("events")
            for name in ("mask", "depth"):
                np.testing.assert_array_equal(first.array(name), other.array(name))


@pytest.mark.parametrize(
    "change", [{"seed": 2}, {"versions": ["tqdm"]}, {"compute": drop_until_shard_2, "extra": {"then": ""}}]
)
def test_what_is_in_the_key_computes_all_again_and_going_back_computes_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict
) -> None:
    make(tmp_path)
    make(tmp_path, **change)
    make(tmp_path)
    assert computed(capsys) == [5, 5, 0]


def test_the_content_of_a_checkpoint_counts_and_its_place_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for folder, weights in (("a", "1"), ("b", "1"), ("b", "2")):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "weights").write_text(weights)
        make(tmp_path, files={"checkpoint": tmp_path / folder})
    assert computed(capsys) == [5, 0, 5]
    with pytest.raises(ShardError, match="nowhere is missing"):
        make(tmp_path, files={"checkpoint": tmp_path / "nowhere"})


def test_another_input_computes_the_shards_that_it_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make(tmp_path)
    make_weights(tmp_path)
    make(tmp_path, seed=2)
    make_weights(tmp_path)
    assert computed(capsys) == [5, 5, 5, 5]


def test_the_manifest_has_the_parts_of_the_key_and_nothing_of_the_machine(tmp_path: Path) -> None:
    make(tmp_path)
    make_weights(tmp_path)
    text = (tmp_path / "weigh" / "train" / "manifest.json").read_text()
    manifest, upstream = json.loads(text), open_shards(tmp_path / "drop" / "train").manifest
    assert str(tmp_path) not in text
    assert manifest["parts"].keys() == {"code", "compute", "files", "format", "parameters", "versions"}
    assert [shard["inputs"] for shard in manifest["shards"]] == [
        {"drop/train": shard.content} for shard in upstream.shards
    ]
    assert upstream.parts["parameters"] == {"seed": 1, "then": "", "flag": ""}


def test_a_smaller_shard_size_than_the_input_s_is_fine_where_it_divides_it(tmp_path: Path) -> None:
    make(tmp_path)
    make_weights(tmp_path)
    whole = open_shards(tmp_path / "weigh" / "train").table()
    make_weights(tmp_path, shard_size=2)
    assert len(open_shards(tmp_path / "weigh" / "train").shards) == 10
    assert open_shards(tmp_path / "weigh" / "train").table() == whole
    with pytest.raises(ShardError, match=r"clips 3 to 5: these clips are in more than one shard of .*drop"):
        make_weights(tmp_path, shard_size=3)


def test_a_stage_may_take_the_first_clips_only(tmp_path: Path) -> None:
    make(tmp_path)
    make_weights(tmp_path, clips=6)
    assert [len(shard) for shard in open_shards(tmp_path / "weigh" / "train").shards] == [4, 2]
    with pytest.raises(ShardError, match="21 clips are wanted"):
        make_weights(tmp_path, clips=21)


def test_inputs_that_are_cut_differently_are_refused(tmp_path: Path) -> None:
    for size in (4, 6):
        make(tmp_path / str(size), clips=24, shard_size=size)
    inputs = [tmp_path / "4" / "drop" / "train", tmp_path / "6" / "drop" / "train"]
    with pytest.raises(ShardError, match=r"these clips are in more than one shard .*\(4 a shard\).*\(6 a shard\)"):
        map_shards("join", "train", tmp_path / "join", no_shard, parameters=None, inputs=inputs)
    make(tmp_path / "6", clips=12, shard_size=6)
    with pytest.raises(ShardError, match=r"different numbers of clips: .* has 24, .* has 12"):
        map_shards("join", "train", tmp_path / "join", no_shard, parameters=None, inputs=inputs)
    assert not (tmp_path / "join").exists()


def no_shard(*_: object) -> ShardResult:
    raise AssertionError("nothing should be computed")


def test_a_suite_of_no_clips_is_an_empty_folder_of_shards(tmp_path: Path) -> None:
    make(tmp_path, clips=0)
    make_weights(tmp_path)
    assert len(open_shards(tmp_path / "weigh" / "train")) == 0


@pytest.mark.parametrize("workers", [1, 2])
def test_an_error_names_the_shard_and_leaves_what_was_done_in_the_store(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], workers: int
) -> None:
    make(tmp_path, clips=4)
    before = hash_files(tmp_path / "drop")
    with pytest.raises(SimulationError) as caught:
        make(tmp_path, workers=workers, compute=drop_until_shard_2, extra={"then": "raise"})
    (note,) = caught.value.__notes__
    assert note in ("in drop train, clips 8 to 11", "in drop train, clips 12 to 15")
    assert hash_files(tmp_path / "drop") == before
    assert not list((tmp_path / "drop").glob(".*"))
    computed(capsys)
    make(tmp_path, clips=8, compute=drop_until_shard_2, extra={"then": "raise"})
    assert computed(capsys)[0] < workers  # another worker is stopped in the middle


def test_damage_in_the_store_is_noticed_named_and_repaired(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    manifest = make(tmp_path)
    before = hash_files(tmp_path / "drop")
    stored = tmp_path / "store" / manifest.shards[2].key[:2] / manifest.shards[2].key
    file = stored / "arrays.zarr" / "mask" / "c.0.0.0.0"
    file.chmod(0o644)
    file.write_bytes(b"\0" + file.read_bytes()[1:])  # in place: with hard links the output has it too
    capsys.readouterr()
    make(tmp_path)
    out, err = capsys.readouterr()
    assert "5 shards, 1 computed, 4 from the store" in out
    assert f"{stored} is damaged (the bytes of arrays.zarr/mask/c.0.0.0.0 are not those that were written)" in err
    assert hash_files(tmp_path / "drop") == before


def test_damaged_input_is_refused_and_nothing_is_kept_of_it(tmp_path: Path) -> None:
    make(tmp_path)
    file = tmp_path / "drop" / "train" / "shard-00001-of-00005.parquet"
    data = file.read_bytes()
    file.unlink()
    file.write_bytes(data[:-1] + b"?")
    with pytest.raises(
        ShardError, match=r"shard-00001-of-00005.parquet is damaged .* run `dynamics store fsck"
    ) as caught:
        make_weights(tmp_path)
    assert "in weigh train, clips 4 to 7" in caught.value.__notes__
    assert not (tmp_path / "weigh" / "train").exists()
    assert len(list(Store(tmp_path / "store").shards())) == 5 + 1  # the shard before it


def test_an_output_folder_with_other_files_is_left_alone(tmp_path: Path) -> None:
    folder = tmp_path / "drop" / "train"
    folder.mkdir(parents=True)
    (folder / "thesis.tex").write_text("\\documentclass{book}")
    with pytest.raises(OutputError, match=r"holds thesis.tex, which is not a shard"):
        make(tmp_path)
    assert (folder / "thesis.tex").exists()


def test_files_of_an_earlier_run_with_more_shards_do_not_stay(tmp_path: Path) -> None:
    make(tmp_path, clips=24)
    make(tmp_path, clips=8)
    names = {path.name for path in (tmp_path / "drop" / "train").iterdir()}
    shards = {f"shard-0000{k}-of-00002.{kind}" for k in range(2) for kind in ("parquet", "zarr")}
    assert names == {"manifest.json", "events"} | shards
