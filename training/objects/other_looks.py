"""Clips of another look with labels that the search gives: what self-training of the model of objects learns from.

    python -m training.objects.other_looks OUT [--clips 300] [--seed 1] [--simulations 600] [--model models/objects]

The scenes have smaller bodies, other cameras and other motions than those of params.yaml; the pictures have the looks,
grounds and shadows of the clips from which the network for masks learns. Bodies are found by models/masks, flow is
RAFT's. The label of a clip is the scene that a short search finds from the classical guess and the model's answers,
simplified. The true scene is kept beside it, for comparison only. A clip is a file; one that is there is not made
again. On a shared machine set NUMBA_NUM_THREADS=1: numba otherwise raises the number of torch's threads, too.
"""

from __future__ import annotations

import argparse
import json
import time
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import torch

from pipeline.clips.draw import Filters, draw_clips
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks
from pipeline.inference.scene_search import clip_evaluator, distinct_starts, search_clip
from pipeline.model.sampling import Sampling
from pipeline.objects.answering import load_objects, write_scenes
from pipeline.objects.instances import instances_of
from pipeline.objects.network import ObjectsNetwork
from pipeline.perception.found_bodies import moving_masks
from pipeline.physics.simulate import simulate
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene, write_scene
from pipeline.search.best_of_k import rank
from pipeline.segmentation import MaskNetworks, load_mask_networks
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT, load_raft
from pipeline.vision.flow.supported_flow import supported_flow
from pipeline.vision.rendering.appearance import apply_sensor, sample_sensor
from pipeline.vision.rendering.render import render_rgb
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.objects.simplest_scene import simplest_scene
from training.segmentation.backgrounds import sample_background
from training.segmentation.recording import compressed
from training.segmentation.solid_looks import sample_looks

SIZE = (360, 240)  # px, width and height of the frames
SUITE = "objects-other-looks"  # names the random streams
OBJECTS = {1: 0.3, 2: 0.3, 3: 0.25, 4: 0.15}
#: Where the scenes differ from sample.distribution of params.yaml.
RANGES = {
    "camera_height": (0.4, 1.5),
    "camera_target_height": (0.0, 0.35),
    "camera_fov": (25.0, 50.0),
    "gravity": (1.5, 12.0),
    "sphere_radius": (0.05, 0.18),
    "cylinder_radius": (0.05, 0.16),
    "cylinder_height": (0.08, 0.32),
    "box_side": (0.09, 0.32),
    "x": (-0.8, 0.8),
    "y": (-0.8, 1.0),
    "speed": (0.1, 2.2),
}
AREA_PX = 2500.0  # least area of all bodies in the first frame, px of 480x320
PICTURED, COMPRESSED = 0.4, 0.5  # shares of clips: on a pictured ground, with the errors of a video's compression
SAMPLES, STARTS = 8, 3  # of the model, and how many of its best answers the search starts from


@dataclass(frozen=True)
class LabelledClip:
    """A clip of another look.

    Attributes:
        found: (F, H, W) uint8, masks by the network, of every frame.
        true: (F, H, W) uint8, the true ones.
        flow: (P, h, w, 2) float16, RAFT's flow of the model's pairs, px per frame interval.
        label: The scene that the search found, simplified.
        pairs: (K, 2) Which object of the label is which instance of `found`.
        reward: Of the scene that the search found, on the found masks.
        greedy: The model's likeliest answer.
        greedy_reward: Of that.
        scene: The true one.
    """

    found: np.ndarray
    true: np.ndarray
    flow: np.ndarray
    label: Scene
    pairs: np.ndarray
    reward: float
    greedy: Scene
    greedy_reward: float
    scene: Scene


@lru_cache(maxsize=1)
def _networks(raft: str) -> tuple[MaskNetworks, RAFT]:
    return load_mask_networks(Path("models/masks")), load_raft(raft)


def drawn_scene(params: Params, seed: int, clip: int) -> Scene:
    """The true scene of a clip."""
    distribution = Distribution(**params.sample.distribution.model_dump() | RANGES)
    filters = replace(Filters(**params.sample.filters.model_dump()), area_px=AREA_PX)
    without = params.suites.train.without
    (scene,) = draw_clips(seed, SUITE, [clip], distribution, filters, params.clip.schedule, OBJECTS, (), without).scenes
    return scene


def frames_and_masks(
    scene: Scene, schedule: Schedule, backend: str, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Pictures (F, H, W, 3) uint8 of another look, and true masks (F, H, W)."""
    trace, steps = simulate(scene, schedule.seconds), schedule.frame_steps
    look, pictured = sample_looks(rng, len(scene.objects)), rng.random() < PICTURED
    if pictured:
        grey = (float(rng.uniform(0.6, 0.95)),) * 3
        look = replace(
            look,
            floor=replace(look.floor, texture="plain", colour=grey, second_colour=grey),
            backdrop=replace(look.backdrop, horizon=grey, zenith=grey, clouds=0.0),
        )
    frames = render_rgb(scene, trace.position[steps], trace.quaternion[steps], look, *SIZE, backend)
    masks = frame_masks(scene, trace, schedule, *SIZE)
    if pictured:
        picture = sample_background(rng, *SIZE) / np.percentile(frames, 90) * 255
        clear = np.stack([cv2.GaussianBlur((m == 0).astype(np.float32), (0, 0), 0.5) for m in masks])
        frames = np.clip(frames * (1 + clear[..., None] * (picture - 1)), 0, 255).astype(np.uint8)
    frames = apply_sensor(frames, sample_sensor(rng), rng)
    return compressed(frames, int(rng.integers(14, 30))) if rng.random() < COMPRESSED else frames, masks


def labelled_clip(
    params: Params, network: ObjectsNetwork, seed: int, clip: int, simulations: int
) -> LabelledClip | None:
    """A clip with the label of the search; None where no body is found."""
    schedule, f, interval = params.clip.schedule, params.flow, 1 / params.clip.fps
    scene, rng = drawn_scene(params, seed, clip), clip_rng(seed, SUITE, clip, "appearance")
    frames, true = frames_and_masks(scene, schedule, choose_backend(params.render.backend)[0], rng)
    networks, raft = _networks(f.raft)
    times, size = np.arange(len(frames)) / schedule.fps, (f.width, f.height)
    found = moving_masks(frames, times, networks)
    raw = measured_flow(raft, frames, times, schedule.pairs, interval, f.iterations, size)
    flow = supported_flow(raw, frames, found, times, schedule.pairs, interval=interval, size=size).flow
    shown = instances_of(found[schedule.pairs[:, 0]], flow)
    if not len(shown):
        return None
    greedy = Sampling(seconds=schedule.seconds)
    sampled = Sampling(SAMPLES, 1.0, params.infer.top_p, seconds=schedule.seconds, middle=params.infer.middle)
    answers = [s for how in (greedy, sampled) for s in write_scenes(network, shown, how, clip)[0]]
    evaluator = clip_evaluator(found, flow, schedule, (params.search.width, params.search.height), 1, frames)
    ranking = rank(evaluator, answers)
    starts = distinct_starts(
        [answers[i] for i in ranking.order], [bool(ranking.rewards.valid[i]) for i in ranking.order], STARTS
    )
    searched = search_clip(evaluator, starts, simulations, clip_rng(seed, SUITE, clip, "search"))
    label = simplest_scene(evaluator, searched.result.scene)
    return LabelledClip(
        found=found,
        true=true,
        flow=flow.astype(np.float16),
        label=label,
        pairs=evaluator.pairs(label),
        reward=searched.result.reward,
        greedy=answers[0],
        greedy_reward=float(ranking.rewards.reward[0]),
        scene=scene,
    )


SCENES, NUMBERS = ("label", "greedy", "scene"), ("reward", "greedy_reward")


def write_clip(clip: LabelledClip, path: Path) -> None:
    """Write a file, whole or not at all."""
    columns = vars(clip) | {name: write_scene(getattr(clip, name)) for name in SCENES}
    part = path.with_suffix(".part.npz")
    np.savez_compressed(part, **columns)
    part.rename(path)


def read_clip(path: Path) -> LabelledClip:
    """A file of `write_clip`."""
    with np.load(path, allow_pickle=False) as stored:
        columns = {name: stored[name] for name in stored.files}
    scenes = {name: read_scene(str(columns[name])) for name in SCENES}
    return LabelledClip(**columns | scenes | {name: float(columns[name]) for name in NUMBERS})


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--clips", type=int, default=300)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--simulations", type=int, default=600)
    parser.add_argument("--model", default="models/objects")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    params, network = read_params_file(PARAMS_FILE, Params), load_objects(asked.model).model
    asked.out.mkdir(parents=True, exist_ok=True)
    for clip in range(asked.first, asked.first + asked.clips):
        path = asked.out / f"{clip:05d}.npz"
        if path.exists():
            continue
        began = time.process_time()
        made = labelled_clip(params, network, asked.seed, clip, asked.simulations)
        row: dict[str, float | str] = {"clip": clip, "seconds": round(time.process_time() - began, 1)}
        if made is not None:
            write_clip(made, path)
            row |= {
                "true": made.scene.composition,
                "label": made.label.composition,
                "greedy": made.greedy.composition,
                "reward": round(made.reward, 3),
                "greedy_reward": round(made.greedy_reward, 3),
            }
        print(json.dumps(row), flush=True)


if __name__ == "__main__":
    main()
