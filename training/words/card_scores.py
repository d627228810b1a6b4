"""Scores of the words model on drawn clips with errors of masks and flow, for development: no network is run.

python -m training.words.card_scores MODEL [--weights FILE] [--clips 96] [--suite id|held_out|more] [--samples 32]
    [--direct] [--input flow|rgb] [--sees bodies|frame]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch

from pipeline.clips.events import ANSWERED_KINDS, DEFAULT_THRESHOLDS
from pipeline.clips.matched_events import EventCounts, count_by_kind, with_objects
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.model.deciding import decide
from pipeline.model.instances import HEIGHT, WIDTH
from pipeline.model.language.completion import MAX_OBJECTS
from pipeline.model.mask_errors import with_errors
from pipeline.model.sampling import Sampling
from pipeline.model.shown import SeenBodies, SeenFrames, seen_clip
from pipeline.model.words_model import bodies_said, events_said, load_words, prompt_of, scene_said
from pipeline.physics.batch import scene_model
from pipeline.physics.simulate import simulate_model
from pipeline.physics.trace import Trace
from pipeline.report.event_scores import simulated_events
from pipeline.report.scene_scores import score, true_reference
from pipeline.scene.scene import Scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.flow_noise import add_raft_noise
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.shade import shade
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

NOTHING_FOUND = {"composition": 0.0, "iou_initial": 0.0, "iou": 0.0}


def shown(scene: Scene, trace: Trace, schedule: Schedule, rng: np.random.Generator, a: argparse.Namespace):
    """What the model sees of a clip, with errors, and the index of the body that each instance is."""
    poses = trace_pairs(trace, schedule)
    view = pair_view(scene, *poses, WIDTH, HEIGHT)
    flow = add_raft_noise(rng, view.flow, view.mask, 1.0)
    masks = with_errors(view.mask, len(scene.objects), rng)
    frames = None
    if a.input == "rgb":
        assert scene.camera is not None
        looks = sample_appearance(rng, len(scene.objects))
        first = poses[0][:, 0], poses[1][:, 0]
        frames = shade(scene.objects, *first, pinhole(scene.camera), looks, WIDTH, HEIGHT)
        frames = apply_sensor(frames, sample_sensor(rng), rng)
    seen = seen_clip(a.input, a.sees, masks, flow, frames)
    return seen, np.arange(MAX_OBJECTS) if isinstance(seen, SeenFrames) else seen.instances.ids - 1


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("model", help="a folder, as models/words")
    parser.add_argument("--weights", type=Path, help="of the trainer, in place of the folder's")
    parser.add_argument("--clips", type=int, default=96)
    parser.add_argument("--suite", default="id", choices=("id", "held_out", "more"))
    parser.add_argument("--samples", type=int, default=1)
    parser.add_argument("--direct", action="store_true", help="without <think>")
    parser.add_argument("--input", default="flow", choices=("flow", "rgb"))
    parser.add_argument("--sees", default="bodies", choices=("bodies", "frame"))
    a = parser.parse_args()
    params = read_params_file(PARAMS_FILE, Params)
    schedule, own = params.clip.schedule, getattr(params.suites, a.suite)
    network = load_words(a.model).model
    if a.weights:
        network.load_state_dict({k: v.float() for k, v in torch.load(a.weights, map_location="cpu").items()})
    suite = {"id": "objects-card", "held_out": "words-four", "more": "words-five"}[a.suite]
    scenes = drawn_scenes(params, params.seed, suite, range(a.clips), own.objects, (), own.only)
    temperature = 0.8 if a.samples > 1 else 0.0
    sampling = Sampling(samples=a.samples, temperature=temperature, reasoning=not a.direct, middle=0.6)
    rows, took = [], []
    counts = {name: dict.fromkeys(ANSWERED_KINDS, EventCounts()) for name in ("said", "own")}
    for k, scene in enumerate(scenes):
        trace = simulate_model(scene_model(scene), schedule.seconds)
        true = simulated_events(scene, schedule, DEFAULT_THRESHOLDS)
        seen, ids = shown(scene, trace, schedule, clip_rng(params.seed, suite, k, "errors"), a)
        if isinstance(seen, SeenBodies) and not len(seen.instances):
            rows.append(NOTHING_FOUND)
            continue
        started = time.perf_counter()
        prompt, places = prompt_of(network, seen)
        answers, _ = decide(network, prompt, places, isinstance(seen, SeenFrames), sampling, k)
        took.append(time.perf_counter() - started)
        reference = true_reference(scene, schedule)
        found = [scene_said(said) for said in answers]
        rows.append(max((score(s, reference, schedule) for s in found), key=lambda r: r.get("iou", 0.0)))
        body = [int(ids[i]) for i in bodies_said(answers[0])]
        said = events_said(answers[0], schedule.seconds)
        own = simulated_events(found[0], schedule, DEFAULT_THRESHOLDS)
        for name, events in (("said", said), ("own", own)):
            for kind, count in count_by_kind(with_objects(events, body), true).items():
                counts[name][kind] += count
    print(json.dumps(summary(a, rows, counts, took)))


def summary(a: argparse.Namespace, rows: list, counts: dict, took: list[float]) -> dict:
    """Means of the scores, F1 of events, and seconds a clip."""

    def f1(count: EventCounts) -> float | None:
        return round(count.f1, 3) if count.found or count.true else None

    return {
        **{k: v for k, v in vars(a).items() if k != "weights"},
        **{k: round(float(np.mean([r.get(k, 0.0) for r in rows])), 3) for k in NOTHING_FOUND},
        **{name: f1(sum(by_kind.values(), EventCounts())) for name, by_kind in counts.items()},
        "by_kind": {kind: f1(count) for kind, count in counts["said"].items()},
        "seconds": round(float(np.median(took)), 2),
    }


if __name__ == "__main__":
    main()
