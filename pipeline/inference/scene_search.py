"""From answers to a scene: what the search has to match, where it starts, and what it finds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from pipeline.clips.schedule import Schedule
from pipeline.inference.trust import Forecast, fitted_frames, forecast
from pipeline.scene.scene import Scene
from pipeline.search.certainty import Certainty, certainties
from pipeline.search.evaluator import Evaluator
from pipeline.search.outlines.clip_outlines import ClipOutlines
from pipeline.search.search_result import SearchResult
from pipeline.search.search_scene import search_scene
from pipeline.search.target import make_target

LEAST_SEARCH = 200  # simulations
FORECAST_SHARE = 0.35  # of the simulations of a search, that are spent again on the first part of the clip


def clip_evaluator(
    masks: np.ndarray,
    flow: np.ndarray,
    schedule: Schedule,
    size: tuple[int, int],
    threads: int,
    pictures: np.ndarray | None = None,
    shape_prior: np.ndarray | None = None,
) -> Evaluator:
    """The rewards of scenes for a clip.

    Args:
        masks: (F, H, W) uint8 of every frame, 0 background, j + 1 instance j.
        flow: (P, h, w, 2), px of its own size per frame interval, of the model's pairs of frames; more of them than
            the schedule has are left out. Inside a body whose rigid motion is known, that replaces it.
        schedule: Of the clip, or of its first part.
        size: px, width and height, of masks and flow in the reward.
        threads: For simulation and rasterising.
        pictures: (F, h, w, 3) uint8 of every frame, of any size; None where they are not known.
        shape_prior: (M, 3) probability of each of `BASIC_SHAPES` by the network for shapes; None: not known.
    """
    seen, compared = schedule.frames, masks[schedule.pairs[:, 0]]
    count = int(compared.max(initial=0))  # bodies with higher ids are in none of these frames
    outlines = ClipOutlines(
        masks[:seen],
        schedule.times,
        count,
        None if pictures is None else pictures[:seen],
        None if shape_prior is None else shape_prior[:count],
    )
    between = flow[: schedule.model_frames] / schedule.pair_scale.astype(np.float32)[:, None, None, None]
    rigid = outlines.rigid_flow(between, schedule.pairs)
    target = make_target(compared, rigid, *size, outlines.flow_errors)
    return Evaluator(target, schedule, threads, outlines)


def distinct_starts(ranked: Sequence[Scene], valid: Sequence[bool], count: int) -> list[Scene]:
    """The best scenes that differ, at most `count`.

    Args:
        ranked: Best first.
        valid: Whether each can be simulated; where none can, all count.
        count: How many.
    """
    sound = [scene for scene, ok in zip(ranked, valid, strict=True) if ok] or ranked
    return list(dict.fromkeys(sound))[:count]


@dataclass(frozen=True)
class ClipSearch:
    """What a search found for a clip.

    Attributes:
        result: The best scene, its reward, and the cost.
        guess: The scene registered to the outlines; None where the clip has no instances.
        guess_simulations: That the guess took.
        pairs: (P, 2) Which object of the scene found is which instance of the clip.
        certainties: How far the clip determines each number of that scene.
        shapes: For each object of that scene the probability of each basic shape, from the outlines; empty for an
            object without an instance.
    """

    result: SearchResult
    guess: Scene | None
    guess_simulations: int
    pairs: np.ndarray
    certainties: tuple[Certainty, ...]
    shapes: tuple[dict[str, float], ...]


def search_clip(
    evaluator: Evaluator,
    starts: Sequence[Scene],
    simulations: int,
    rng: np.random.Generator,
    progress: Callable[[int, float], None] = lambda spent, reward: None,
    incline: bool = False,
) -> ClipSearch:
    """The search of choice (`pipeline.search.search_scene`), and how sure its result is.

    Args:
        evaluator: Of the clip.
        starts: Scenes to start from, beside the classical guess.
        simulations: At most so many.
        rng: Of the search.
        progress: Called with the simulations spent and the best reward so far.
        incline: Whether the ground may slope in the picture.
    """
    with threadpool_limits(1, "blas"):  # with two threads, sums of small matrices have other last digits
        found = search_scene(evaluator, starts, simulations, rng, progress, incline)
        pairs, known = scene_certainties(evaluator, found.result.scene)
    instance = dict(pairs.tolist())
    shapes = tuple(found.shapes[instance[i]] if i in instance else {} for i in range(len(found.result.scene.objects)))
    return ClipSearch(
        result=found.result,
        guess=found.guess,
        guess_simulations=found.guess_simulations,
        pairs=pairs,
        certainties=known,
        shapes=shapes,
    )


def search_forecast(
    masks: np.ndarray,
    flow: np.ndarray,
    schedule: Schedule,
    starts: Sequence[Scene],
    *,
    size: tuple[int, int],
    simulations: int,
    seed: int,
    incline: bool,
    threads: int,
    shape_prior: np.ndarray | None = None,
) -> Forecast | None:
    """How well a search on the first part of a clip forecasts the rest; None where the clip cannot be parted.

    Args:
        masks: (F, H, W) uint8 of every frame.
        flow: (P, h, w, 2), as for `clip_evaluator`.
        schedule: Of the clip.
        starts: Scenes to start from, beside the classical guess.
        size: px, width and height, of masks and flow in the reward.
        simulations: Of the search on the whole clip, of which this one gets FORECAST_SHARE.
        seed: Of the search.
        incline: Whether the ground may slope in the picture.
        threads: For simulation and rasterising.
        shape_prior: (M, 3) probability of each of `BASIC_SHAPES` by the network for shapes; None: not known.
    """
    times = schedule.times
    every = schedule.seconds / schedule.model_frames  # the model's frames are parted there
    try:
        part = schedule.first(every * np.floor(times[fitted_frames(times, masks)] / every + 1e-6))
    except ValueError:
        return None
    seen = part.frames
    evaluator = clip_evaluator(masks, flow, part, size, threads, shape_prior=shape_prior)
    budget = max(LEAST_SEARCH, round(FORECAST_SHARE * simulations))
    found = search_clip(evaluator, starts, budget, np.random.default_rng(seed), incline=incline).result.scene
    return forecast(found, masks, times, seen)


def scene_certainties(evaluator: Evaluator, scene: Scene) -> tuple[np.ndarray, tuple[Certainty, ...]]:
    """Pairs (P, 2) of object and instance for a scene, and how far the clip determines each of its numbers."""
    pairs = evaluator.pairs(scene)
    return pairs, tuple(certainties(evaluator.without_outlines(), scene, pairs))
