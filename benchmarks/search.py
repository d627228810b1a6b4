"""Simulations a second of the search, of a straightforward program, and of bare stepping, in one run.

    python -m benchmarks.search [--population 128] [--iterations 100] [--threads 2] [--seed N]

One clip of four objects, exact masks and flow, the same resolution for all.

- Ours: pycma's ask and tell, decoding, simulation, masks, flow and reward of a whole CMA-ES run.
- The straightforward program: pycma, an MjModel compiled for each candidate, `mj_step`, MuJoCo's renderer for the masks
  (no flow), IoU; on the candidates of our first generation.
- Bare stepping: only `mujoco.batch`, over the same steps of the same candidates, in generations from the whole run.
"""

from __future__ import annotations

import argparse
import secrets
import time

import mujoco
import numpy as np
from tqdm import tqdm

from pipeline.clips.overlap import assign, count, pair_iou, sequence_iou
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import pair_view, trace_pairs
from pipeline.physics.batch import BatchSimulator, SceneBatch, unstack
from pipeline.physics.simulate import simulate
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.scene import Scene
from pipeline.search.cmaes import Budget, cmaes_search
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.search.parameters import search_space
from pipeline.search.target import Target, make_target
from pipeline.vision.rendering.mujoco_render import Canvas
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

OBJECTS = 4
PLAIN_CANDIDATES = 48


class RecordingEvaluator(Evaluator):
    """Records the batches of candidates that it evaluates."""

    def __init__(self, target: Target, schedule: Schedule, threads: int) -> None:
        super().__init__(target, schedule, threads)
        self.batches: list[SceneBatch] = []

    def rewards(self, scenes: SceneBatch, pairs: np.ndarray | None = None) -> Rewards:
        if len(scenes) > 1:
            self.batches.append(scenes)
        return super().rewards(scenes, pairs)


def plain_reward(scene: Scene, target_masks: np.ndarray, schedule: Schedule) -> float:
    """Sequence IoU of one candidate, by a straightforward program."""
    model = mujoco.MjModel.from_xml_string(scene_xml(scene))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    height, width = target_masks.shape[1:]
    wanted = schedule.frame_steps[schedule.pairs[:, 0]]
    masks = []
    with Canvas(model, width, height) as canvas:
        for step in range(int(wanted[-1]) + 1):
            if step in wanted:
                qpos = data.qpos.reshape(-1, 7)
                masks.append(canvas.segmentation(qpos[:, :3].copy(), qpos[:, 3:].copy()))
            mujoco.mj_step(model, data)
    counts = count(np.stack(masks), target_masks, len(scene.objects), int(target_masks.max()))
    return float(sequence_iou(counts, assign(pair_iou(counts))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--population", type=int, default=128)
    parser.add_argument("--iterations", type=int, default=100)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--width", type=int, default=120)
    parser.add_argument("--height", type=int, default=80)
    parser.add_argument("--seed", type=int, default=None, help="of the clip; default: a fresh one")
    arguments = parser.parse_args()
    seed = secrets.randbits(32) if arguments.seed is None else arguments.seed
    params = read_params_file(PARAMS_FILE, Params)
    schedule = params.clip.schedule
    scene = drawn_scenes(params, seed, "benchmark", range(1), {OBJECTS: 1.0})[0]
    view = pair_view(
        scene, *trace_pairs(simulate(scene, schedule.seconds), schedule), arguments.width, arguments.height
    )
    target = make_target(view.mask, view.flow, arguments.width, arguments.height)
    print(f"seed {seed}: {scene.composition}, {arguments.width}x{arguments.height}, {arguments.threads} threads")
    rng = np.random.default_rng(0)
    space = search_space(scene)
    start = space.scene(np.clip(space.encode() + 0.05 * rng.choice([-1, 1], len(space.keys)), 0, 1))

    evaluator = RecordingEvaluator(target, schedule, arguments.threads)
    cmaes_search(evaluator, [start], Budget(arguments.population, 1, 0.1), rng)  # compiles
    evaluator.batches.clear()
    bar = tqdm(total=arguments.iterations, desc="ours", unit="generation", disable=None, leave=False)
    found = cmaes_search(
        evaluator, [start], Budget(arguments.population, arguments.iterations, 0.1), rng, lambda *_: bar.update()
    )
    bar.close()
    ours = found.simulations / found.seconds

    batches = evaluator.batches[:: max(1, arguments.iterations // 20)]
    steps = evaluator.schedule.frame_steps[evaluator.schedule.pairs].max(keepdims=True).ravel()
    simulator = BatchSimulator(scene.shapes, True, arguments.population, arguments.threads)
    simulator.run(batches[0], steps)
    began = time.perf_counter()
    for batch in batches:
        simulator.run(batch, steps)
    bare = len(batches) * arguments.population / (time.perf_counter() - began)

    backend, why = choose_backend("auto")
    if backend == "mujoco":
        candidates = [unstack(batches[0], b, start) for b in range(min(PLAIN_CANDIDATES, arguments.population))]
        plain_reward(start, target.masks, schedule)
        began = time.perf_counter()
        for candidate in candidates:
            plain_reward(candidate, target.masks, schedule)
        plain = len(candidates) / (time.perf_counter() - began)
    print(f"ours, a whole CMA-ES run   {ours:8.0f} simulations/s   {found.simulations} in {found.seconds:.1f} s")
    print(f"mujoco.batch, stepping     {bare:8.0f} simulations/s   ours is {ours / bare:.2f} of it")
    if backend == "mujoco":
        print(f"straightforward program    {plain:8.1f} simulations/s   ours is {ours / plain:.0f} times it ({why})")
    else:
        print(f"straightforward program    skipped: {why}")


if __name__ == "__main__":
    main()
