"""The ways to a scene: the model's greedy answer, its best sample, tracks, and the search."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from pipeline.clips.overlap import Overlap, overlap
from pipeline.clips.replay import masks_at
from pipeline.errors import SimulationError
from pipeline.inference.filmed_world import World
from pipeline.inference.measured_clip import MeasuredClip
from pipeline.inference.scene_search import ClipSearch
from pipeline.scene.scene import Scene
from pipeline.search.best_of_k import Ranking, rank
from pipeline.search.evaluator import Evaluator, Rewards
from pipeline.vision.rendering.camera import pinhole
from pipeline.worlds.find_planar_scene import PlanarAnswer
from pipeline.worlds.view import CLOSE, View
from pipeline.worlds.view_evidence import STEEP_DEG

if TYPE_CHECKING:
    from pipeline.inference.answers import Answer

TRACKS, SEARCH = "tracks", "search"  # ways to a scene: a planar scene that is fitted to tracks, and the search
EXPLAINS_IOU = 0.6  # sequence IoU from which a scene explains a clip
ONE_DIRECTION_DEG = 10.0  # most spread of the slopes of motion along one direction
AMBIGUITY_MARGIN = 0.05  # of merit, by which a scene in an ambiguous view must be better than one on a table


@dataclass(frozen=True)
class Method:
    """A way to a scene, and what it reached.

    Attributes:
        name: "greedy", "best of K", "search" or "tracks".
        scene: What it found.
        answer: The model's, whose words belong to the scene: of a search, the best one with the same shapes; None for
            tracks.
        reward: As the search measures: iou - epe_frame.
        iou: As the search measures.
        epe_frame: px of 480x320 per frame interval, over the whole frame.
        overlap: At the clip's own size.
        simulations: That it took, those of the methods before it included.
        ambiguous: Whether it relies on a view that the tracks alone do not settle.
    """

    name: str
    scene: Scene
    answer: Answer | None
    reward: float
    iou: float
    epe_frame: float
    overlap: Overlap
    simulations: int
    ambiguous: bool = False

    @property
    def merit(self) -> float:
        """By which methods are compared: as the reward, but with the overlap at the clip's own size.

        A body of a few pixels hardly shows at the size of the search's reward. A scene in an ambiguous view
        has to be better by AMBIGUITY_MARGIN than one on a table, the commonest view.
        """
        return self.overlap.sequence - self.epe_frame - (AMBIGUITY_MARGIN if self.ambiguous else 0.0)


def best_of(methods: Sequence[Method]) -> Method:
    """The method of the most merit."""
    return max(methods, key=lambda m: m.merit)


def ways(view: str, simulations: int, measured: bool) -> tuple[str, ...]:
    """The ways to a scene without the model, in the order in which they are tried until one explains the clip.

    Args:
        view: Of the bodies' tracks. The search knows tables alone, but is better and faster on them.
        simulations: Of the search; 0: there is none.
        measured: Lengths or fixed bodies are known, which the search does not use.
    """
    if not simulations:
        return (TRACKS,)
    return (SEARCH, TRACKS) if view == "table" and not measured else (TRACKS, SEARCH)


def settled(methods: Sequence[Method]) -> bool:
    """Whether no other way need be tried: the last method explains the clip, and none before it is better."""
    last = methods[-1]
    return best_of(methods) is last and last.overlap.sequence >= EXPLAINS_IOU and not last.ambiguous


def steady_line_doubt(view: View, world: World) -> str | None:
    """A sentence where bodies move along one line without speeding up, which is seen from above as from the side."""
    slopes = np.array([m.slope_deg for m in view.arcs if m.kind != "rest"])
    along_one = len(slopes) > 0 and float(np.ptp(slopes)) < ONE_DIRECTION_DEG
    if view.kind != "top" or world.view is not None or world.measured or not along_one:
        return None
    return (
        "bodies move along one line at a steady speed: they may be seen from above, or sink steadily and be seen from "
        "aside; the clip does not tell, --view top or --view side does"
    )


def level_view(scene: Scene) -> str:
    """From where the camera of a scene on a level ground looks: "top", "side", or "table" from above and aside."""
    assert scene.camera is not None
    down = float(np.degrees(np.arcsin(pinhole(scene.camera).rotation_world[2, 2])))
    off_vertical = 90 - down
    return "top" if down > STEEP_DEG else "side" if off_vertical > STEEP_DEG else "table"


def is_ambiguous(view: View, world: World) -> bool:
    """Whether the tracks show a table, the commonest view, nearly as well; the search knows tables best."""
    return world.view is None and not world.measured and "table" in view.rivals(CLOSE)


def answer_method(
    name: str, answers: list[Answer], rewards: Rewards, index: int, clip: MeasuredClip, simulations: int
) -> Method:
    """An answer of the model as a method of that name; rewards: of all answers."""
    answer = answers[index]
    return _rewarded(name, answer.scene, answer, rewards, index, clip, simulations)


def search_method(searched: ClipSearch, answers: list[Answer], ranking: Ranking, clip: MeasuredClip) -> Method:
    """What the search found, with the words of the best answer that has the same shapes."""
    found, order = searched.result, [answers[int(i)] for i in ranking.order]
    nearest = next((a for a in order if a.scene.composition == found.scene.composition), order[0])
    return Method(
        name=SEARCH,
        scene=found.scene,
        answer=nearest,
        reward=found.reward,
        iou=found.iou,
        epe_frame=found.iou - found.reward,
        overlap=_overlap(found.scene, clip),
        simulations=len(answers) + found.simulations,
    )


def tracks_method(answer: PlanarAnswer, evaluator: Evaluator, clip: MeasuredClip, ambiguous: bool) -> Method:
    """The scene that was fitted to tracks. ambiguous: whether its view is."""
    rewards = rank(evaluator, [answer.scene]).rewards
    return replace(_rewarded(TRACKS, answer.scene, None, rewards, 0, clip, answer.fit.simulations), ambiguous=ambiguous)


def _rewarded(
    name: str, scene: Scene, answer: Answer | None, rewards: Rewards, index: int, clip: MeasuredClip, simulations: int
) -> Method:
    return Method(
        name=name,
        scene=scene,
        answer=answer,
        reward=float(rewards.reward[index]),
        iou=float(rewards.iou[index]),
        epe_frame=float(rewards.epe_frame[index]),
        overlap=_overlap(scene, clip),
        simulations=simulations,
    )


def _overlap(scene: Scene, clip: MeasuredClip) -> Overlap:
    return replay_overlap(scene, clip.taken.masks, clip.schedule.times)


def replay_overlap(scene: Scene, masks: np.ndarray, times: np.ndarray) -> Overlap:
    """Of a scene's replay with masks (T, H, W), filmed at times (T,), s; none where the simulation becomes unstable."""
    height, width = masks.shape[1:]
    try:
        own = masks_at(scene, times, width, height)
    except SimulationError:
        return Overlap(0.0, 0.0, 0.0, np.zeros((0, 2), int))
    return overlap(own, masks, len(scene.objects), int(masks.max(initial=0)))
