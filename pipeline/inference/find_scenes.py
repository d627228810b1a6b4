"""From a measured clip to scenes: the model answers, tracks are fitted, the search refines.

The answers of the model are replayed and ranked. Then a planar scene is fitted to the tracks, or the search goes on
from the best answers and a classical guess: both, where the first of them does not explain the clip.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from pipeline.errors import SimulationError
from pipeline.inference.asking import LoadingModel, Question, ask_model
from pipeline.inference.filmed_world import FilmedWorld, World, filmed_world, seen_as, with_forecast, with_scene
from pipeline.inference.measured_clip import MeasuredClip
from pipeline.inference.method import (
    AMBIGUITY_MARGIN,
    SEARCH,
    TRACKS,
    Method,
    answer_method,
    best_of,
    is_ambiguous,
    level_view,
    search_method,
    settled,
    tracks_method,
    ways,
)
from pipeline.inference.progress import Progress
from pipeline.inference.scene_search import (
    ClipSearch,
    clip_evaluator,
    distinct_starts,
    scene_certainties,
    search_clip,
    search_forecast,
)
from pipeline.inference.trust import Forecast
from pipeline.search.best_of_k import rank
from pipeline.search.certainty import Certainty
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.worlds.view import CLOSE, LEVEL, PLAUSIBLE, VIEWS, View

if TYPE_CHECKING:
    from pipeline.inference.answers import Answer
    from pipeline.model.sampling import Sampling

#: As params.yaml has them for the graph (`search`; a test compares them).
SEARCH_SIZE = (120, 80)  # px of masks and flow in the search's reward; of another shape, as large an area
STARTS = 3  # answers that a search starts from
VIEW_PRICE = AMBIGUITY_MARGIN / np.log(CLOSE)  # of merit, for each nat by which another view is likelier
MOST_FRAMES = 120  # of a clip that is fitted in more than one view: of a longer one that takes minutes


@dataclass(frozen=True)
class SearchBudget:
    """What a search may do.

    Attributes:
        simulations: So many; 0: there is no search.
        incline: The ground may slope in the picture: the search may roll the camera.
        seed: Of the search.
    """

    simulations: int
    incline: bool
    seed: int


@dataclass(frozen=True)
class FoundScenes:
    """What was found in a clip.

    Attributes:
        answers: The model's: greedy first, then the samples.
        sampling: How the samples were drawn.
        rewards: Of the answers, in their order.
        methods: Each way to a scene, in the order in which they were tried.
        filmed: The world that the tracks tell of.
        searched: The search; None where there was none.
        search_rest: Searches the first part of the clip and forecasts the rest.
        certainties: How far the clip determines each number of the best scene; empty without a search.
    """

    answers: tuple[Answer, ...]
    sampling: Sampling
    rewards: Rewards
    methods: tuple[Method, ...]
    filmed: FilmedWorld
    searched: ClipSearch | None
    search_rest: Callable[[], Forecast | None]
    certainties: tuple[Certainty, ...]

    @property
    def best(self) -> Method:
        """The method of the most merit."""
        return best_of(self.methods)

    @property
    def view(self) -> View:
        """The view of the best scene: that of the tracks, or of its camera where the scene is not from them."""
        told = self.filmed.motion.view
        if self.best.name == TRACKS or told.kind not in LEVEL or self.filmed.followed.world.view is not None:
            return told
        kind = level_view(self.best.scene)
        reason = f"so the best scene is seen; the tracks alone tell of {told.kind}"
        return told if kind == told.kind else replace(told, kind=kind, reason=reason)

    @cached_property
    def forecast(self) -> Forecast | None:
        """Of frames that were not fitted, by the best method; None for an answer of the model. It is made when it is
        first asked for: after a search it takes a third of the search's time."""
        if self.best.name == SEARCH:
            return self.search_rest()
        return self.filmed.forecast if self.best.name == TRACKS else None


def find_scenes(
    clip: MeasuredClip,
    loading: LoadingModel,
    *,
    question: Question,
    world: World,
    budget: SearchBudget,
    progress: Progress,
) -> FoundScenes:
    """Find scenes that show what a clip shows.

    Args:
        clip: Frames, masks and flow.
        loading: The model.
        question: How it is asked.
        world: What is known of the world.
        budget: Of the search.
        progress: Told of each step.

    Raises:
        ModelError: For a model that cannot be loaded.
        SimulationError: Where no answer can be simulated.
    """
    taken = clip.taken
    size = clip.shaped(SEARCH_SIZE)
    with ThreadPoolExecutor(2, "tracks") as beside:
        viewing = beside.submit(filmed_world, taken, world)
        evaluating = beside.submit(
            clip_evaluator,
            taken.masks,
            clip.flow,
            clip.schedule,
            size,
            cores(),
            taken.clip.frames,
            clip.shape_prior,
        )
        with progress.step("answers"):
            answers, sampling = ask_model(loading, clip, question)
        progress.say(
            "answers", f"{_tally([a.scene.composition for a in answers])}; greedy first: {answers[0].scene.composition}"
        )
        with progress.step("best of K"):
            evaluator = evaluating.result()
            ranking = rank(evaluator, [a.scene for a in answers])
            if not ranking.rewards.valid.any():
                raise SimulationError(
                    f"the simulation is unstable in each of the {len(answers)} answers; try more samples"
                )
            methods = [answer_method("greedy", answers, ranking.rewards, 0, clip, 1)]
            if len(answers) > 1:
                top = int(ranking.order[0])
                methods.append(answer_method("best of K", answers, ranking.rewards, top, clip, len(answers)))
        with progress.step("view"):  # what is left of it
            filmed = viewing.result()
    told = filmed.motion.view
    progress.say("view", f"{told.kind}: {told.reason}")
    ranked = [answers[int(i)].scene for i in ranking.order]
    starts = distinct_starts(ranked, ranking.rewards.valid[ranking.order].tolist(), STARTS)
    searched = None
    for way in ways(told.kind, budget.simulations, world.measured):
        with progress.step(way):
            if way == TRACKS:
                filmed, fitted = from_tracks(filmed, evaluator, clip, world, budget.simulations > 0)
                if fitted is None:
                    continue
                methods.append(fitted)
            else:
                searched = search_clip(
                    evaluator,
                    starts,
                    budget.simulations,
                    np.random.default_rng(budget.seed),
                    lambda spent, reward: progress.detail(
                        f" {spent}/{budget.simulations} simulations, reward {reward:.3f}"
                    ),
                    budget.incline,
                )
                methods.append(search_method(searched, answers, ranking, clip))
        if settled(methods) and not told.rivals(CLOSE):
            break
    with progress.step("forecast"):
        if best_of(methods).name == TRACKS:
            before, filmed = filmed.answer, with_forecast(filmed, cores())
            if filmed.answer is not before:  # fitted again from the scene of the first part
                again = _tracks_method(filmed, evaluator, clip, world, budget.simulations > 0)
                methods = [again if m.name == TRACKS and again is not None else m for m in methods]
    best = best_of(methods)
    certain: tuple[Certainty, ...] = ()
    if searched is not None:
        own = best.scene is searched.result.scene
        certain = searched.certainties if own else scene_certainties(evaluator, best.scene)[1]
    found = FoundScenes(
        answers=tuple(answers),
        sampling=sampling,
        rewards=ranking.rewards,
        methods=tuple(methods),
        filmed=filmed,
        searched=searched,
        search_rest=partial(
            search_forecast,
            taken.masks,
            clip.flow,
            clip.schedule,
            starts,
            size=size,
            simulations=budget.simulations,
            seed=budget.seed,
            incline=budget.incline,
            threads=cores(),
            shape_prior=clip.shape_prior,
        ),
        certainties=certain,
    )
    if found.view.kind != told.kind:
        progress.say("view", f"{found.view.kind}: {found.view.reason}")
    return found


def from_tracks(
    filmed: FilmedWorld, evaluator: Evaluator, clip: MeasuredClip, world: World, searched: bool
) -> tuple[FilmedWorld, Method | None]:
    """The scene that fits the tracks in the likeliest view or, where that does not explain the clip, in the best one.

    Where another view is nearly as likely, or the likeliest does not explain the clip, those that the tracks do not
    exclude are fitted quickly. Merits are compared less the price of a less likely view. Views that then beat the
    likeliest one are fitted well.

    Args:
        filmed: The world that the tracks tell of.
        evaluator: Of the clip.
        clip: The clip.
        world: What the user knows; a view that is given is the only one.
        searched: There is a search as well, which knows tables.
    """

    method_of = partial(_tracks_method, evaluator=evaluator, clip=clip, world=world, searched=searched)

    told = filmed.motion.view

    def merit(candidate: FilmedWorld, method: Method | None) -> float:
        price = VIEW_PRICE * told.log_odds(candidate.motion.view.kind)
        return (-1.0 if method is None else method.merit) - price

    best = with_scene(filmed, cores())
    method = method_of(best)
    alone = world.view is not None or len(clip.taken.masks) > MOST_FRAMES
    if alone or (method is not None and settled([method]) and not told.rivals(CLOSE)):
        return best, method
    plausible = told.rivals(PLAUSIBLE) if told.costs else [k for k in VIEWS if k != told.kind]
    others = [seen_as(filmed, kind) for kind in plausible]
    seen = [filmed, *(other for other in others if other is not None)]
    least, *merits = [merit(each, method_of(with_scene(each, cores(), quick=True))) for each in seen]
    for k in sorted(np.flatnonzero(np.array(merits) > least), key=lambda k: -merits[k]):
        other = with_scene(seen[k + 1], cores())
        rival = method_of(other)
        if merit(other, rival) > merit(best, method):
            best, method = other, rival
    return best, method


def _tracks_method(
    seen: FilmedWorld, evaluator: Evaluator, clip: MeasuredClip, world: World, searched: bool
) -> Method | None:
    """The scene of a world as a method; None where tracks give none. Arguments as those of `from_tracks`."""
    ambiguous = searched and is_ambiguous(seen.motion.view, world)
    return None if seen.answer is None else tracks_method(seen.answer, evaluator, clip, ambiguous)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _tally(compositions: list[str]) -> str:
    """`box+sphere (6), sphere (3)`: compositions and how often each was answered, the most frequent first."""
    return ", ".join(f"{name} ({count})" for name, count in Counter(compositions).most_common(4))
