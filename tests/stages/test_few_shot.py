"""The stage `infer` with worked examples, on a tiny random base and clips of noise."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from random_walk import random_walk
from ruamel.yaml import YAML
from small_base import LAYOUT, random_clips, small_base

from pipeline.errors import ParamsError, ShardError
from pipeline.model.language.completion import completion_grammar, read_completion
from pipeline.scene.text import write_scene
from pipeline.shards.code_hash import ROOT
from pipeline.shards.dataset import open_shards
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from stages import finetune, infer, prefer
from stages.graph.examples import choose_examples
from stages.graph.run import run
from stages.tokenize import SCHEMA

TRAIN = 4


def noise(shard: Shard, inputs: Sequence[OpenShard], parameters: int) -> ShardResult:
    """In the place of `flow`."""
    rng = np.random.default_rng((parameters, shard.start))
    return ShardResult(arrays={"picture": random_clips(rng, len(shard))})


def texts(shard: Shard, inputs: Sequence[OpenShard], parameters: int) -> ShardResult:
    """In the place of `tokenize`: random completions."""
    rng = np.random.default_rng((parameters, shard.start))
    rows = [
        {
            "clip": c,
            "completion": random_walk(rng, completion_grammar(True, 1.0))[0],
            "ids": [],
            "prompt_length": 0,
            "free": [],
            "numeric": [],
        }
        for c in shard.clips
    ]
    return ShardResult({"clips": table_from_rows(rows, SCHEMA)})


def write_params(**infer_values: Any) -> None:
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    params["clip"]["model_frames"] = LAYOUT.frames
    params["model"] |= {"base": "base", "input": "flow", "sees": "frame"}
    params["infer"] |= {"samples": 2, "decode_batch_size": 2, **infer_values}
    params["executor"]["workers"] = 1
    yaml.dump(params, Path("params.yaml"))


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rng: np.random.Generator) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))
    small_base(int(rng.integers(1000))).save(Path("base"))
    seed = int(rng.integers(2**31))
    for name, suite, compute, clips in (
        ("flow", "train", noise, TRAIN),
        ("tokenize", "train", texts, TRAIN),
        ("flow", "id", noise, 3),
    ):
        map_shards(
            name,
            suite,
            tmp_path / "data" / name / suite,
            compute,
            parameters=seed,
            clips=clips,
            shard_size=2,
            workers=1,
        )
    return tmp_path


def test_the_base_answers_from_examples_of_train_and_nothing_is_fine_tuned(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_params(shots=3)
    finetune.main()
    assert sorted(path.name for path in (folder / "data/finetune").iterdir()) == [
        "contents.json",
        "eval_loss.csv",
        "loss.csv",
    ]
    prefer.main()
    infer.main("id")
    answers = open_shards(folder / "data/infer/id")
    assert len(answers) == 3
    for clip in answers:
        rows = clip.rows()
        assert [row["sample"] for row in rows] == [-1, 0, 1]
        for row in rows:
            assert row["scene"] == write_scene(read_completion(row["text"]).scene)
    assert answers.manifest.notes == {"answers": 9, "parsed": 9}
    before = [row["log_probability"] for row in answers.table().to_pylist()]
    capsys.readouterr()
    infer.main("id")
    assert "0 computed" in capsys.readouterr().out
    map_shards("flow", "train", folder / "data/flow/train", noise, parameters=0, clips=TRAIN, shard_size=2, workers=1)
    infer.main("id")
    after = [row["log_probability"] for row in open_shards(folder / "data/infer/id").table().to_pylist()]
    assert not np.allclose(before, after, atol=1e-3), "the examples' pictures matter, and are in the key"


def test_the_examples_are_the_first_clips_of_train_with_their_completions(folder: Path) -> None:
    told = open_shards(folder / "data/tokenize/train").table().to_pylist()
    chosen = choose_examples(3, "id", "flow")
    assert [e.clip for e in chosen] == [0, 1, 2]
    assert [e.completion for e in chosen] == [row["completion"] for row in told[:3]]
    assert choose_examples(2, "real", "flow") == chosen[:2]
    assert choose_examples(0, "train", "flow") == []


def test_a_clip_of_train_is_not_asked_with_examples_of_train(folder: Path) -> None:
    write_params(shots=1)
    with pytest.raises(ParamsError, match=r"`infer\.shots` is 1: the examples are clips of train"):
        infer.main("train")


@pytest.mark.parametrize(
    ("shots", "lost", "said"),
    [
        (TRAIN + 1, None, "`infer.shots` is 5, but data/tokenize/train has 4 clips and data/flow/train 4; valid"),
        (3, "flow", "data/flow/train"),
        (3, "tokenize", "data/tokenize/train"),
    ],
)
def test_without_enough_examples_it_ends_with_code_2_and_names_the_place(
    folder: Path, capsys: pytest.CaptureFixture[str], shots: int, lost: str | None, said: str
) -> None:
    write_params(shots=shots)
    if lost:
        (folder / "data" / lost / "train").rename(folder / "lost")
    with pytest.raises(SystemExit) as done:
        run(infer.main, ["id"])
    assert done.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert said in error
    assert not (folder / "data/infer").exists()


def test_training_pictures_without_rgb_are_named(folder: Path) -> None:
    (folder / "data/flow").rename(folder / "data/render")
    Path("base/model_input.json").unlink()  # as in a model that this project has not trained
    write_params(shots=1)
    params = Path("params.yaml").read_text()
    Path("params.yaml").write_text(params.replace("input: flow ", "input: rgb "))
    with pytest.raises(ShardError, match="no array `rgb`"):
        infer.main("id")
    assert not (folder / "data/infer").exists()


def test_preference_optimisation_of_a_prompted_model_is_refused(folder: Path) -> None:
    write_params(shots=3)
    params = Path("params.yaml").read_text()
    Path("params.yaml").write_text(params.replace("enabled: false", "enabled: true", 1))
    with pytest.raises(ParamsError, match=r"`prefer\.enabled` is true and `infer\.shots` is 3; valid: one of the two"):
        prefer.main()
