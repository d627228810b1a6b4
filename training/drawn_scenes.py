"""Scenes drawn as the suites' are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.clips.draw import Filters, draw_clips
from pipeline.clips.schedule import Schedule
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from stages.graph.params import Params


def drawn_scenes(
    params: Params, seed: int, suite: str, indices: range, objects: Mapping[int, float], without: Sequence[str] = ()
) -> list[Scene]:
    """The scenes of these clips of a suite of that name, with the distribution and the filters of the parameters.

    objects, without: as `draw_composition` takes them. Raises `DynamicsError` where a clip uses up its tries.
    """
    distribution = Distribution(**params.sample.distribution.model_dump())
    filters = Filters(**params.sample.filters.model_dump())
    schedule = Schedule(**params.clip.model_dump())
    return draw_clips(seed, suite, indices, distribution, filters, schedule, objects, (), without).scenes
