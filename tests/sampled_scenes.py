"""Scenes as the suites draw them, with their traces and masks, for laws that hold for every sampled scene."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from pipeline.clips.draw import Drawn, Filters, draw_clips
from pipeline.clips.events import Thresholds
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks
from pipeline.physics.simulate import simulate
from pipeline.physics.trace import Trace
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from stages.graph.params import Params
from stages.graph.params_file import read_params_file

COUNTS = {1: 1.0, 2: 1.0, 3: 1.0, 4: 1.0}
SCHEDULE = Schedule()


@cache
def params() -> Params:
    return read_params_file(Path(__file__).parents[1] / "params.yaml", Params)


def distribution() -> Distribution:
    return Distribution(**params().sample.distribution.model_dump())


def filters() -> Filters:
    return Filters(**params().sample.filters.model_dump())


def thresholds() -> Thresholds:
    return Thresholds(**params().events.model_dump(), visible_px=params().sample.filters.visible_px)


def draw(seed: int, indices: Sequence[int], counts: dict[int, float] | None = None) -> Drawn:
    return draw_clips(seed, "test", indices, distribution(), filters(), SCHEDULE, counts or COUNTS)


@dataclass(frozen=True)
class Clip:
    """masks: (F, H, W) of every frame."""

    scene: Scene
    trace: Trace
    masks: np.ndarray


def clips(seed: int, count: int, counts: dict[int, float] | None = None) -> list[Clip]:
    """Accepted scenes with their traces and masks of 240x160."""
    scenes = draw(seed, range(count), counts).scenes
    traces = [simulate(scene, SCHEDULE.seconds) for scene in scenes]
    return [Clip(s, t, frame_masks(s, t, SCHEDULE, 240, 160)) for s, t in zip(scenes, traces, strict=True)]
