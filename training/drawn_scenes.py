"""Scenes drawn as those of the suites."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from pipeline.clips.draw import Filters, draw_clips
from pipeline.scene.sample import Distribution
from pipeline.scene.scene import Scene
from stages.graph.params import Params


def drawn_scenes(
    params: Params,
    seed: int,
    suite: str,
    indices: Sequence[int],
    objects: Mapping[int, float],
    without: Sequence[str] = (),
    only: Sequence[str] = (),
) -> list[Scene]:
    """The scenes of some clips, with the distribution and the filters of the parameters.

    Args:
        params: All parameters of the experiment.
        seed: Instead of the parameters' own.
        suite: Names the random stream.
        indices: Of the clips.
        objects: Number of objects -> weight.
        without: Compositions that are never drawn, as box+box+sphere.
        only: Compositions to draw from instead; empty: any.

    Raises:
        DynamicsError: A clip used up its tries.
    """
    distribution = Distribution(**params.sample.distribution.model_dump())
    filters = Filters(**params.sample.filters.model_dump())
    schedule = params.clip.schedule
    return draw_clips(seed, suite, indices, distribution, filters, schedule, objects, only, without).scenes
