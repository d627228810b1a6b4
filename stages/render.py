"""Render clips: RGB, instance masks, depth, exact flow.

Reads data/sample/<suite> and data/simulate/<suite>. Writes data/render/<suite>: arrays mask (F, H, W), depth
(P, H, W) and exact flow (P, H, W, 2) of the model's frames, rgb (F, H, W, 3). RGB of the training clips is made only
where something reads it: model.input=rgb, or a flow.train_source that looks at pictures.
Parameters: seed, clip, render, model.input, flow.train_source. Run: python -m stages.render SUITE
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks, pair_view, trace_pairs
from pipeline.physics.trace import Trace
from pipeline.physics.trace_shards import read_trace
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.shards.clip_rng import clip_rng
from pipeline.shards.opened_shard import OpenShard
from pipeline.shards.shard import Shard, ShardResult
from pipeline.vision.rendering.appearance import apply_sensor, sample_appearance, sample_sensor
from pipeline.vision.rendering.render import render_rgb
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.run import run, run_shards
from stages.graph.stage_params import load


@dataclass(frozen=True)
class Pictures:
    """How RGB is made.

    Attributes:
        seed: Of the appearance and the sensor.
        backend: mujoco or raycast.
        shadows: Whether bodies throw shadows.
        textures: Of objects, by weight; so `floors` and `backdrops`.
        lights: How many at most.
        metal: Share of shiny objects.
        sensor_noise: Largest standard deviation, share of full scale.
        blur: Largest sigma, px.
    """

    seed: int
    backend: str
    shadows: bool
    textures: Mapping[str, float]
    floors: Mapping[str, float]
    backdrops: Mapping[str, float]
    lights: int
    metal: float
    sensor_noise: float
    blur: float

    def render(
        self, scene: Scene, trace: Trace, schedule: Schedule, size: tuple[int, int], rng: np.random.Generator
    ) -> np.ndarray:
        """RGB (F, H, W, 3) uint8 of a clip's frames; size: width and height, px."""
        appearance = sample_appearance(
            rng,
            len(scene.objects),
            textures=dict(self.textures),
            floor_textures=dict(self.floors),
            backdrops=dict(self.backdrops),
            max_lights=self.lights,
            metal_probability=self.metal,
            n_fixed=len(scene.fixed),
        )
        steps = schedule.frame_steps
        frames = render_rgb(
            scene, trace.position[steps], trace.quaternion[steps], appearance, *size, self.backend, self.shadows
        )
        sensor = sample_sensor(rng, noise=(0.0, self.sensor_noise), blur=(0.0, self.blur))
        return apply_sensor(frames, sensor, rng)


@dataclass(frozen=True)
class Parameters:
    """size: width and height, px; pictures: None where no RGB is needed."""

    schedule: Schedule
    size: tuple[int, int]
    pictures: Pictures | None


def compute(shard: Shard, inputs: Sequence[OpenShard], parameters: Parameters) -> ShardResult:
    sample, simulated = inputs
    schedule, size, pictures = parameters.schedule, parameters.size, parameters.pictures
    names = ("mask", "depth", "flow", "rgb") if pictures else ("mask", "depth", "flow")
    arrays: dict[str, list[np.ndarray]] = {name: [] for name in names}
    for row in sample.table().to_pylist():
        scene, trace = read_scene(row["scene"]), read_trace(simulated, row["clip"])
        view = pair_view(scene, *trace_pairs(trace, schedule), *size)
        arrays["mask"].append(frame_masks(scene, trace, schedule, *size))
        arrays["depth"].append(view.depth)
        arrays["flow"].append(view.flow)
        if pictures:
            rng = clip_rng(pictures.seed, shard.suite, row["clip"], "appearance")
            arrays["rgb"].append(pictures.render(scene, trace, schedule, size, rng))
    return ShardResult(arrays={name: np.stack(a) for name, a in arrays.items()})


def main(suite: str) -> None:
    params = load("render", suite)
    r = params.render
    pictures = None
    if suite != "train" or params.model.input == "rgb" or params.flow.train_source != "exact":
        backend, reason = choose_backend(r.backend)
        print(f"render {suite}: pictures by {backend} ({reason})", flush=True)
        pictures = Pictures(seed=params.seed, **r.model_dump(exclude={"width", "height"}) | {"backend": backend})
    parameters = Parameters(params.clip.schedule, (r.width, r.height), pictures)
    run_shards("render", suite, compute, parameters, ["sample", "simulate"], versions=["mujoco", "numba"])


if __name__ == "__main__":
    run(main)
