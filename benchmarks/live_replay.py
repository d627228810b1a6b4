"""How long a replay under a slider takes: 1 s of 30 frames, 240x160, as `dynamics app` draws it.

    python -m benchmarks.live_replay

Sampled scenes of 1 to 4 objects; a change of gravity, then the simulation, the pictures and the JSON of the answer.
"""

from __future__ import annotations

import json
import time
from pathlib import Path

import numpy as np

from pipeline.app.live_replay import LiveScene
from pipeline.app.sliders import read_changes
from pipeline.clips.schedule import Schedule
from pipeline.scene.sample import Distribution, compositions, draw_scene
from stages.graph.params import Params
from stages.graph.params_file import read_params_file

REPEATS = 20


def main() -> None:
    rng = np.random.default_rng(0)
    params = read_params_file(Path(__file__).parents[1] / "params.yaml", Params)
    ranges = Distribution(**params.sample.distribution.model_dump())
    print("objects  median s  worst s  processor s  kB")
    for count in (1, 2, 3, 4):
        shapes = compositions(count)[-2]  # one cylinder, else spheres
        live = LiveScene.of(draw_scene(rng, shapes, ranges), Schedule(), (480, 320))
        live.replay(read_changes({"gravity": 5.0}))  # kernels are compiled
        wall, processor, size = [], [], 0
        for gravity in np.linspace(1, 20, REPEATS):
            began, spent = time.perf_counter(), time.process_time()
            answer = json.dumps(live.replay(read_changes({"gravity": float(gravity)})))
            wall.append(time.perf_counter() - began)
            processor.append(time.process_time() - spent)
            size = len(answer)
        print(f"{count:7d}  {np.median(wall):8.3f}  {max(wall):7.3f}  {np.median(processor):11.3f}  {size / 1e3:.0f}")


if __name__ == "__main__":
    main()
