"""Scores of the words model on drawn clips with the errors of masks and flow, for development and the model card.

    python -m training.words.card_scores WEIGHTS [--clips 96] [--suite id|held_out|more] [--samples 32] [--direct]
        [--input flow|rgb] [--sees bodies|frame]
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path

import numpy as np
import torch

from pipeline.clips.view import event_areas, pair_view, trace_pairs
from pipeline.errors import SimulationError
from pipeline.evaluation.scene_scores import score, true_reference
from pipeline.language.events import DEFAULT_THRESHOLDS, find_events
from pipeline.model import decisions as d
from pipeline.model.deciding import decide
from pipeline.model.sampling import Sampling
from pipeline.model.words_network import WordsNetwork, WordsSize
from pipeline.objects.example import example_of
from pipeline.objects.fields import NOTHING, OBJECT_FIELDS, SCENE_FIELDS, off_scale, scene_of
from pipeline.objects.instances import HEIGHT, WIDTH
from pipeline.physics.batch import scene_model
from pipeline.physics.simulate import simulate, simulate_model
from pipeline.scene.scene import BASIC_SHAPES
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.flow_noise import add_raft_noise
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.camera import pinhole
from pipeline.vision.rendering.shade import shade
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes
from training.words.examples import flow_crops, own_less_others
from training.words.views import frame_flow, frame_rgb, rgb_crops


def matched(told, true, within: float = 0.1) -> int:
    """Number of told events (time, kind, first, second) that are true, each true one once."""
    left, hits = list(true), 0
    for t, kind, who, whom in told:
        best = [e for e in left if e[1] == kind and {e[2], e[3]} == {who, whom} and abs(e[0] - t) <= within]
        if best:
            left.remove(min(best, key=lambda e: abs(e[0] - t)))
            hits += 1
    return hits


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("weights", type=Path)
    parser.add_argument("--clips", type=int, default=96)
    parser.add_argument("--suite", default="id")
    parser.add_argument("--samples", type=int, default=1)
    parser.add_argument("--direct", action="store_true")
    parser.add_argument("--input", default="flow")
    parser.add_argument("--sees", default="bodies")
    parser.add_argument("--size", type=json.loads, default={})
    a = parser.parse_args()
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    network = WordsNetwork(WordsSize(**a.size)).eval()
    network.load_state_dict({k: v.float() for k, v in torch.load(a.weights, map_location="cpu").items()})
    objects = {"id": params.suites.id.objects, "held_out": {4: 1.0}, "more": {5: 0.5, 6: 0.5}}[a.suite]
    only = params.suites.train.without if a.suite == "held_out" else ()
    suite = {"id": "objects-card", "held_out": "words-four", "more": "words-five"}[a.suite]
    scenes = drawn_scenes(params, params.seed, suite, range(a.clips), objects, (), only)
    sampling = Sampling(
        samples=a.samples, temperature=0.8 if a.samples > 1 else 0.0, reasoning=not a.direct, middle=0.6
    )
    rows, took = [], []
    told_counts = {k: np.zeros(3) for k in d.KINDS}
    own_counts = {k: np.zeros(3) for k in d.KINDS}
    for k, scene in enumerate(scenes):
        trace = simulate_model(scene_model(scene), schedule.seconds)
        true = find_events(trace, scene.shapes, event_areas(scene, trace, schedule), schedule.frame_steps, DEFAULT_THRESHOLDS)
        truth = [(e.time, e.kind, e.first, e.second) for e in true if e.kind in d.KINDS]
        rng = clip_rng(params.seed, suite, k, "errors")
        poses = trace_pairs(trace, schedule)
        view = pair_view(scene, *poses, WIDTH, HEIGHT)
        flow = add_raft_noise(rng, view.flow, view.mask, 1.0)
        shown = example_of(scene, view.mask, flow, poses, schedule, rng).instances
        colours = a.input == "rgb"
        if colours:
            pictures = shade(scene.objects, poses[0][:, 0], poses[1][:, 0], pinhole(scene.camera), sample_appearance(rng, len(scene.objects)), WIDTH, HEIGHT)
            pictures = apply_sensor(pictures, sample_sensor(rng), rng)
        started = time.perf_counter()
        if a.sees == "frame":
            ids, places = np.arange(d.MOST_IN_FRAME), list(range(d.MOST_IN_FRAME))
            seen = frame_rgb(pictures) if colours else frame_flow(flow)
            prompt = network.frame_prompt(torch.from_numpy(seen)[None], colours)
        else:
            if not len(shown):
                rows.append({"composition": 0.0, "iou_initial": 0.0, "iou": 0.0})
                continue
            ids, places = shown.ids - 1, list(range(len(shown)))
            crops = np.concatenate([rgb_crops(pictures, shown.places), own_less_others(shown)[:, :, None]], 2) if colours else flow_crops(shown)
            prompt = network.bodies_prompt(torch.from_numpy(crops)[None], colours, torch.from_numpy(shown.places)[None], torch.tensor([places]))
        answers, _ = decide(network, prompt, places, a.sees == "frame", sampling, k)
        took.append(time.perf_counter() - started)
        reference = true_reference(scene, schedule)
        scored = []
        for n, said in enumerate(answers):
            real = [i for i, s in enumerate(said.shapes) if s != NOTHING]
            numbers = off_scale(torch.tensor(said.scene), SCENE_FIELDS).numpy()
            values = off_scale(torch.tensor(said.values), OBJECT_FIELDS).numpy()
            got = scene_of(numbers, [BASIC_SHAPES[said.shapes[i]] for i in real], values[real])
            scored.append(score(got, reference, schedule))
            if n:
                continue
            told = [(t, d.KINDS[kind], int(ids[who]), None if whom is None else int(ids[whom])) for t, kind, who, whom in said.events]
            own = []
            try:
                tr = simulate(got, schedule.seconds)
                found = find_events(tr, got.shapes, event_areas(got, tr, schedule), schedule.frame_steps, DEFAULT_THRESHOLDS)
                own = [(e.time, e.kind, int(ids[real[e.first]]), None if e.second is None else int(ids[real[e.second]])) for e in found if e.kind in d.KINDS]
            except SimulationError:
                pass
            for counts, events in ((told_counts, told), (own_counts, own)):
                for kind in d.KINDS:
                    mine, theirs = [e for e in events if e[1] == kind], [e for e in truth if e[1] == kind]
                    counts[kind] += matched(mine, theirs), len(mine), len(theirs)
        rows.append(max(scored, key=lambda r: r.get("iou", 0.0)))

    def f1(v):
        return None if not v[1] + v[2] else round(2 * v[0] / (v[1] + v[2]), 3)

    def mean(key):
        return round(float(np.mean([r.get(key, 0.0) for r in rows])), 3)

    out = {
        **{k: v for k, v in vars(a).items() if k not in ("weights", "size")},
        **{k: mean(k) for k in ("composition", "iou_initial", "iou")},
        "said": f1(sum(told_counts.values())),
        "own": f1(sum(own_counts.values())),
        "said_by_kind": {k: f1(v) for k, v in told_counts.items()},
        "seconds": round(float(np.median(took)), 2),
    }
    print(json.dumps(out))


if __name__ == "__main__":
    main()
