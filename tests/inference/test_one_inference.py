"""The graph and the command show a model the same, and find the same scene for the same clip."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import small_clip
import torch
from ruamel.yaml import YAML
from small_tokenizer import build_tokenizer
from tiny_qwen import TinySize, build_tiny
from tiny_words import tiny_words

import stages.compile
import stages.fit
import stages.infer
from pipeline.api.infer import infer
from pipeline.errors import ModelError
from pipeline.inference.answers import answer_seed
from pipeline.model.answering import load_answering
from pipeline.model.generate import generate
from pipeline.model.language.completion import write_completion
from pipeline.model.model_input import ModelInput, read_input
from pipeline.model.words_model import WordsModel
from pipeline.scene.canonical import rounded_scene
from pipeline.scene.text import load_scene, write_scene
from pipeline.shards.code_hash import ROOT
from pipeline.shards.dataset import open_shards
from pipeline.shards.map_shards import map_shards
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.shards.tables import table_from_rows
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px
from stages import best_of_k, events, finetune, fit, flow, import_clips, prefer, render, sample, simulate, tokenize
from stages.graph.answering_model import FINETUNED

SEED, SIMULATIONS = 5, 1800  # enough for a classical guess, too


def write_params(**changes: Any) -> None:
    """params.yaml with changes, as flow__picture="wheel"."""
    yaml = YAML()
    params = yaml.load(ROOT / "params.yaml")
    usual = {
        "executor__workers": 1,
        "suites__real__path": "clips",
        "flow__source": "dis",
        "flow__iterations": 1,
        "model__base": "base",
        "model__input": "flow",
        "model__sees": "frame",
        "finetune__steps": 1,
        "finetune__batch_size": 1,
        "finetune__checkpoint_steps": 1,
        "infer__samples": 2,
        "fit__simulations": SIMULATIONS,
    }
    for name, value in (usual | changes).items():
        *path, last = name.split("__")
        section = params
        for key in path:
            section = section[key]
        section[last] = value
    yaml.dump(params, Path("params.yaml"))


def tokens(shard: Shard, inputs: Sequence[OpenShard], parameters: Any) -> ShardResult:
    """In the place of `tokenize`."""
    base = load_answering("base")
    text = write_completion(rounded_scene(small_clip.scene()), [], 1.0)
    made = base.codec.encode(text, True, 1.0)
    row = {
        "completion": text,
        "ids": made.ids.tolist(),
        "prompt_length": made.prompt_length,
        "free": made.free.tolist(),
        "numeric": made.numeric.tolist(),
    }
    return ShardResult({"clips": table_from_rows([{"clip": c, **row} for c in shard.clips], tokenize.SCHEMA)})


def gray(shard: Shard, inputs: Sequence[OpenShard], parameters: Any) -> ShardResult:
    """In the place of `flow` and `render` for training: pictures and frames without content."""
    shape = (len(shard), 10, 64, 96, 3), (len(shard), 30, 64, 96, 3)
    return ShardResult(arrays={"picture": np.full(shape[0], 128, np.uint8), "rgb": np.full(shape[1], 128, np.uint8)})


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in which the graph can run from a clip on: clips/, base/, data/ of training."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("DYNAMICS_STORE", str(tmp_path / "store"))
    stages.infer.model.cache_clear()  # kept by a name that each test gives to another model; so the next
    tokenize.codec.cache_clear()
    (tmp_path / "clips" / "one").mkdir(parents=True)
    small_clip.write(tmp_path / "clips" / "one" / "clip.mp4")
    np.savez(tmp_path / "clips" / "one" / "masks.npz", masks=small_clip.masks())
    monkeypatch.setattr("pipeline.api.infer_files.choose_backend", lambda choice: ("raycast", "our own ray caster"))
    # no scene from tracks
    monkeypatch.setattr("pipeline.inference.find_scenes.with_scene", lambda filmed, *_, **__: filmed)
    small_clip.write_model(tmp_path / "base")
    for name, compute in (("tokenize", tokens), ("flow", gray), ("render", gray)):
        for suite in ("train", "val"):
            map_shards(
                name,
                suite,
                tmp_path / "data" / name / suite,
                compute,
                parameters=None,
                clips=1,
                shard_size=1,
                workers=1,
            )
    return tmp_path


def write_small_words(folder: Path) -> None:
    """A words model with random weights."""
    WordsModel(tiny_words(), ModelInput("any", None, "exact", (240, 160), 1, "any", "any")).save(folder)


@pytest.fixture
def shown(monkeypatch: pytest.MonkeyPatch) -> list[np.ndarray]:
    """What models are shown, each time that one is asked."""
    seen: list[np.ndarray] = []

    def record(base: Any, clips: np.ndarray, *rest: Any) -> Any:
        seen.append(clips)
        return generate(base, clips, *rest)

    monkeypatch.setattr("pipeline.model.generate.generate", record)
    return seen


@pytest.mark.parametrize(("kind", "picture"), [("flow", "channels"), ("flow", "wheel"), ("rgb", "channels")])
def test_a_tuned_checkpoint_is_shown_what_it_was_tuned_on(
    project: Path, shown: list[np.ndarray], kind: str, picture: str
) -> None:
    write_params(flow__picture=picture, model__input=kind)
    finetune.main()
    expected = ModelInput.of(kind, picture, "exact", (240, 160), 1, True)
    assert read_input(str(FINETUNED)) == expected
    prefer.main()
    import_clips.main()
    flow.main("real")
    stages.infer.main("real")
    found = infer(project / "clips" / "one", model=str(FINETUNED), samples=2, flow="dis")
    assert len(shown) == 4, "greedy and samples, by the stage and by the command"
    graph, command = shown[:2], shown[2:]
    for pictures in (*graph, *command):
        np.testing.assert_array_equal(pictures, graph[0])
    frames = found.clip.taken.clip.frames[found.clip.schedule.pairs[:, 0]]
    flow_shown = flow_picture(found.clip.flow, picture, scaled_max_px(found.clip.flow.shape[2]))
    whole = flow_shown if kind == "flow" else frames
    mean = [part.mean() for part in (whole, graph[0])]
    assert mean[0] == pytest.approx(mean[1], abs=1.0), "the same pictures, but for their size"


@pytest.fixture
def one_thread() -> Iterator[None]:
    """The stage computes on one thread. On two, sums round otherwise, and a number may be written one digit off."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def write_large_model(folder: Path) -> None:
    """Patches, merging and video tokens of the published Qwen2.5-VL at two layers, with random weights."""
    tokenizer = build_tokenizer()
    size = TinySize(hidden=48, layers=2, heads=2, vision_hidden=32, vision_depth=2, vision_heads=2, patch=14)
    build_tiny(tokenizer, size, 0).save_pretrained(folder)
    tokenizer.save_pretrained(folder)
    (folder / "clip_layout.json").unlink()


@pytest.mark.usefixtures("one_thread")
@pytest.mark.parametrize(
    ("kind", "sees", "reasoning", "large"),
    [
        ("flow", "bodies", True, False),
        ("rgb", "bodies", False, False),
        ("flow", "frame", True, False),
        ("rgb", "frame", True, False),
        ("flow", "bodies", True, True),
        ("rgb", "bodies", False, True),
    ],
)
def test_a_tuned_model_answers_alike(
    project: Path, monkeypatch: pytest.MonkeyPatch, kind: str, sees: str, reasoning: bool, large: bool
) -> None:
    monkeypatch.setattr("pipeline.inference.answers.answer_seed", lambda *_: answer_seed(SEED, 0))
    changes = {f"suites__{suite}__clips": 1 for suite in ("train", "val")}
    changes |= {"model__input": kind, "model__sees": sees, "model__reasoning": reasoning, "render__backend": "raycast"}
    write_params(flow__source="dis", sample__shard_size=1, **changes)
    (write_large_model if large else write_small_words)(project / "base")
    for suite in ("train", "val"):
        for stage in (sample, stages.compile, simulate, events, render, flow, tokenize):
            stage.main(suite)
    finetune.main()
    assert read_input(str(FINETUNED)) == ModelInput.of(
        kind, "channels" if large else None, "exact", (240, 160), 1, reasoning, sees
    )
    prefer.main()
    import_clips.main()
    flow.main("real")
    stages.infer.main("real")
    found = infer(project / "clips" / "one", model=str(FINETUNED), samples=2, flow="dis", seed=SEED)
    answers = open_shards(project / "data/infer/real")[0].rows()
    assert [row["text"] for row in answers] == [a.text for a in found.scenes.answers]
    write_params(**changes | {"model__reasoning": not reasoning})
    with pytest.raises(ModelError, match=r"model\.reasoning is .*, but .* was trained with reasoning"):
        stages.infer.main("real")


def test_a_checkpoint_that_contradicts_the_parameters_is_refused(project: Path) -> None:
    write_params()
    small_clip.write_model(
        FINETUNED,
        ModelInput(
            input="flow", picture="wheel", flow_source="exact", flow_size=(240, 160), flow_iterations=1, reasoning=True
        ),
    )
    prefer.main()
    import_clips.main()
    flow.main("real")
    said = r'flow\.picture is "channels", but data/finetune/model was trained with picture "wheel" .*; valid: "wheel"'
    with pytest.raises(ModelError, match=said):
        stages.infer.main("real")
    (FINETUNED / "model_input.json").unlink()
    with pytest.raises(ModelError, match=r"has no model_input\.json"):
        stages.infer.main("real")


def test_the_same_clip_becomes_the_same_scene(project: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Both take their random numbers from a clip's name, of which the command has none. Samples are the greedy answer
    # (its numbers and words, as good as certainly): the graph starts from samples alone, the command from all answers.
    monkeypatch.setattr("pipeline.inference.answers.answer_seed", lambda *_: answer_seed(SEED, 0))
    monkeypatch.setattr(stages.fit, "clip_rng", lambda *_: np.random.default_rng(SEED))
    write_params(infer__temperature=1e-3, infer__middle=1e-12)
    small_clip.write_model(
        FINETUNED,
        ModelInput(
            input="flow",
            picture="channels",
            flow_source="exact",
            flow_size=(240, 160),
            flow_iterations=1,
            reasoning=True,
        ),
    )
    prefer.main()
    import_clips.main()
    for run in (flow.main, stages.infer.main, best_of_k.main, fit.main):
        run("real")
    found = infer(
        project / "clips" / "one",
        model=str(FINETUNED),
        samples=2,
        temperature=1e-3,
        middle=1e-12,
        search=SIMULATIONS,
        flow="dis",
        seed=SEED,
    )
    answers = open_shards(project / "data/infer/real")[0].rows()
    assert [row["text"] for row in answers] == [a.text for a in found.scenes.answers]
    assert [row["sample"] for row in answers] == [a.sample for a in found.scenes.answers]
    assert len({row["text"] for row in answers}) == 1
    ranked = open_shards(project / "data/best_of_k/real")[0].rows()
    assert ranked[0]["reward"] == pytest.approx(max(found.scenes.rewards.reward[1:]), abs=1e-9)
    searched = open_shards(project / "data/fit/real")[0].row()
    assert found.scenes.searched is not None
    assert searched["scene"] == write_scene(found.scenes.searched.result.scene)
    assert searched["reward"] == pytest.approx(found.scenes.searched.result.reward, abs=1e-9)

    found.save(project / "out")
    assert write_scene(load_scene(project / "out" / "scene.yaml")) == write_scene(found.scene)
    result = json.loads((project / "out" / "result.json").read_text())
    assert result["answer"]["composition"] == found.scene.composition
