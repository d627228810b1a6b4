"""A scene drawn as the suites' are."""

from __future__ import annotations

from pipeline.clips.draw import Filters, draw_clips
from pipeline.clips.schedule import Schedule
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from stages.params import Params


def drawn_scene(seed: int, suite: str, clip: int, objects: int, params: Params, schedule: Schedule) -> Scene:
    """The scene of one clip of the suite of that name, of so many objects, drawn with the parameters given."""
    distribution = Distribution(**params.sample.distribution.model_dump())
    filters = Filters(**params.sample.filters.model_dump())
    return draw_clips(seed, suite, range(clip, clip + 1), distribution, filters, schedule, {objects: 1.0}).scenes[0]
