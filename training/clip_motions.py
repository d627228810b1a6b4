"""Motions of bodies between neighbouring frames of simulated clips, whose scenes are drawn as the suites' are."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pipeline.errors import SimulationError
from pipeline.physics.simulate import simulate
from pipeline.vision.rendering.camera import pinhole
from stages.graph.params import Params
from stages.graph.params_file import read_params_file
from training.body_motion import BodyMotion
from training.drawn_scenes import drawn_scenes

COUNTS = {1: 1.0, 2: 1.0, 3: 1.0, 4: 1.0}
SUITE = "flow pairs"
PARAMS_FILE = Path(__file__).resolve().parents[1] / "params.yaml"


class ClipMotions:
    """An endless supply of motions, `pairs` from each clip at random frames. A seed always gives the same clips."""

    def __init__(self, seed: int, pairs: int = 6) -> None:
        self.params = read_params_file(PARAMS_FILE, Params)
        self.seed = seed
        self.pairs = pairs
        self.schedule = self.params.clip.schedule
        self.next_clip = 0
        self.ready: list[BodyMotion] = []

    def draw(self, rng: np.random.Generator) -> BodyMotion:
        while not self.ready:
            self.ready = self.of_clip(rng, self.next_clip)
            rng.shuffle(self.ready)  # type: ignore[arg-type]
            self.next_clip += 1
        return self.ready.pop()

    def of_clip(self, rng: np.random.Generator, clip: int) -> list[BodyMotion]:
        (scene,) = drawn_scenes(self.params, self.seed, SUITE, range(clip, clip + 1), COUNTS)
        try:
            trace = simulate(scene, self.schedule.seconds)
        except SimulationError:
            return []
        steps = self.schedule.frame_steps
        frames = rng.choice(len(steps) - 1, self.pairs, replace=False)
        assert scene.camera is not None
        camera = pinhole(scene.camera)
        at = [[steps[k], steps[k + 1]] for k in frames]
        return [BodyMotion(scene.objects, trace.position[s], trace.quaternion[s], camera) for s in at]
