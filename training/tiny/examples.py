"""Training examples of the tiny model: a sampled, simulated clip with its pictures, tokens and patch labels."""

from __future__ import annotations

import queue
from dataclasses import dataclass
from functools import lru_cache
from multiprocessing.sharedctypes import Synchronized

import numpy as np
import torch
from torch import multiprocessing

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import View, event_areas, pair_view, trace_pairs
from pipeline.language.codec import Codec, Tokens
from pipeline.language.completion import MAX_OBJECTS, completion_grammar, write_completion
from pipeline.language.events import Thresholds, find_events
from pipeline.language.grammar import split
from pipeline.language.tokenizer import build_tokenizer
from pipeline.model.model_input import ModelInput
from pipeline.model.patches import PatchLayout, resize_frames
from pipeline.physics.batch import scene_model
from pipeline.physics.simulate import simulate_model
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.flow_noise import add_raft_noise
from pipeline.vision.flow.flow_picture import flow_picture, scaled_max_px
from pipeline.vision.flow.raft import RAFT, load_raft
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import Params
from training.drawn_scenes import drawn_scenes
from training.tiny.patch_labels import PatchLabels, patch_labels
from training.tiny.soft_numbers import SoftTargets, soft_targets

LAYOUT = PatchLayout(192, 128, 10, patch=16, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5), places=0.25)
SUITE = "tiny-training"
CHUNK = 16  # clips drawn together


@dataclass(frozen=True)
class Example:
    """A clip.

    Attributes:
        tokens: Prompt and completion.
        soft: Soft targets of the completion's numbers.
        picture: (T, H, W, 3) uint8, what the model sees.
        patches: Labels of the patches.
    """

    tokens: Tokens
    soft: SoftTargets
    picture: np.ndarray
    patches: PatchLabels

    @property
    def objects(self) -> int:
        """Number of objects that show in a patch."""
        return int(self.patches.place.max(initial=-1, where=self.patches.shape > 0)) + 1


@dataclass(frozen=True)
class ExampleKind:
    """What examples are like.

    Attributes:
        input: What the pictures show: flow (exact, with noise like RAFT's), raft (RAFT's flow, 50 times slower) or rgb.
        without_reasoning: Share of the clips whose completion is without reasoning.
    """

    input: str = "flow"
    without_reasoning: float = 0.25

    def model_input(self, params: Params) -> ModelInput:
        """How the input of a model of such examples is made."""
        source, f = "raft" if self.input == "raft" else "exact", params.flow
        return ModelInput.of(
            "rgb" if self.input == "rgb" else "flow",
            f.picture,
            source,
            (f.width, f.height),
            f.iterations,
            self.without_reasoning < 1,
        )

    def reasons(self, chunk: int) -> bool:
        """Whether the completions of a chunk are with reasoning."""
        return int((chunk + 1) * self.without_reasoning) == int(chunk * self.without_reasoning)


def frames_of(
    params: Params, suite: str, index: int, scene: Scene, trace: Trace, steps: np.ndarray, width: int, height: int
) -> np.ndarray:
    """RGB (F, height, width, 3) uint8 at steps (F,) of the trace, with the clip's own random appearance and sensor."""
    rng = clip_rng(params.seed, suite, index, "appearance")
    appearance = sample_appearance(rng, len(scene.objects))
    frames = render_rgb(
        scene,
        trace.position[steps],
        trace.quaternion[steps],
        appearance,
        width,
        height,
        "raycast",
        params.render.shadows,
    )
    return apply_sensor(frames, sample_sensor(rng), rng)


@lru_cache(maxsize=1)
def raft(folder: str) -> RAFT:
    """The network, loaded once."""
    return load_raft(folder)


def picture(
    params: Params,
    kind: ExampleKind,
    suite: str,
    index: int,
    scene: Scene,
    trace: Trace,
    view: View,
    noise: float = 1.0,
) -> np.ndarray:
    """What the model sees of a clip, (T, H, W, 3) uint8. noise: strength of the flow's noise, 1 for RAFT's."""
    schedule, f = Schedule(**params.clip.model_dump()), params.flow
    steps = schedule.frame_steps[schedule.pairs]  # (P, 2)
    if kind.input == "rgb":
        return frames_of(params, suite, index, scene, trace, steps[:, 0], LAYOUT.width, LAYOUT.height)
    if kind.input == "raft":
        frames = frames_of(params, suite, index, scene, trace, steps.T.ravel(), f.width, f.height)
        first, second = np.split(frames, 2)
        flow = raft(f.raft).flow(first, second, f.iterations)
    else:
        rng = clip_rng(params.seed, suite, index, "flow noise")
        flow = add_raft_noise(rng, view.flow, view.mask, noise)
    shown = flow_picture(flow, f.picture, scaled_max_px(flow.shape[2], 1 / params.clip.fps))
    return resize_frames(shown, LAYOUT.width, LAYOUT.height)


def make_examples(
    params: Params,
    codec: Codec,
    kind: ExampleKind,
    suite: str,
    indices: range,
    reasoning: bool,
    noise: float = 1.0,
    most: int = MAX_OBJECTS,
) -> list[Example]:
    """Training examples.

    Args:
        params: All parameters of the experiment.
        codec: Of the tokens.
        kind: What the examples are like.
        suite: Names the random streams of the clips.
        indices: Of the clips.
        reasoning: Whether the completions have reasoning.
        noise: Strength of the flow's noise.
        most: Largest number of objects of a clip.
    """
    schedule = Schedule(**params.clip.model_dump())
    thresholds = Thresholds(**params.events.model_dump(), visible_px=params.sample.filters.visible_px)
    train = params.suites.train
    objects = {n: weight for n, weight in train.objects.items() if n <= most}
    scenes = drawn_scenes(params, params.seed, suite, indices, objects, train.without)
    examples = []
    for index, scene in zip(indices, scenes, strict=True):
        trace = simulate_model(scene_model(scene), schedule.seconds)
        events = None
        if reasoning:
            areas = event_areas(scene, trace, schedule)
            events = find_events(trace, scene.shapes, areas, schedule.frame_steps, thresholds)
        view = pair_view(scene, *trace_pairs(trace, schedule), LAYOUT.width, LAYOUT.height)
        completion = write_completion(scene, events, schedule.seconds)
        segments = split(completion_grammar(reasoning, schedule.seconds), completion)
        tokens, soft = codec.encode_segments(segments), soft_targets(codec, segments)
        labels = patch_labels(view, scene, trace, schedule, LAYOUT)
        examples.append(Example(tokens, soft, picture(params, kind, suite, index, scene, trace, view, noise), labels))
    return examples


def generate(
    params: Params,
    kind: ExampleKind,
    first: int,
    stride: int,
    out: multiprocessing.Queue,
    noise: Synchronized,
    most: Synchronized,
) -> None:
    """A worker process: make chunks while the trainer lives.

    Args:
        params: All parameters of the experiment.
        kind: What the examples are like.
        first: Number of the first chunk.
        stride: Between numbers of chunks.
        out: Queue of (chunk, examples).
        noise: Shared value, strength of the flow's noise; the trainer changes it.
        most: Shared value, largest number of objects of a clip; the trainer changes it.
    """
    torch.set_num_threads(1)
    out.cancel_join_thread()  # a trainer that was killed does not read it
    codec = Codec(build_tokenizer(), LAYOUT.tokens)
    chunk = first
    while True:
        indices = range(chunk * CHUNK, (chunk + 1) * CHUNK)
        examples = make_examples(params, codec, kind, SUITE, indices, kind.reasons(chunk), noise.value, most.value)
        while True:
            try:
                out.put((chunk, examples), timeout=30)
                break
            except queue.Full:
                parent = multiprocessing.parent_process()
                if parent is None or not parent.is_alive():
                    return
        chunk += stride
