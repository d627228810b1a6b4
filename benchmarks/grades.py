"""Are grades right? Clips with truth, the share of them that is graded good, and how many of these deserve it.

    python -m benchmarks.grades [--clips 12] [--seed 11] [--search 2000] [--only id views cross_engine] [--found]

An answer deserves `good` if its replay has a sequence IoU of at least 0.7 with the true masks and its forecast beats
constant velocity. `id` and `views`: sampled scenes, true masks and exact flow. `cross_engine`: another engine's clips
in DYNAMICS_DATA or ../shared/data, with the masks beside them, or with --found with masks that the network finds.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks import views
from benchmarks.end_to_end import overlap_with
from benchmarks.mask_clips import data_folder
from pipeline.api.infer import infer
from pipeline.clips.replay import replay, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import DynamicsError
from pipeline.evaluation.view_scores import SeenClip, view_score
from pipeline.inference.find_scenes import SEARCH_SIZE
from pipeline.inference.trust import GOOD_IOU
from pipeline.perception.mask_source import MaskSource
from pipeline.perception.prompts import Prompts
from pipeline.perception.user_clip import read_frames, with_masks
from pipeline.scene.scene import Scene
from pipeline.vision.recordings.clip_folder import find_clips, masks_beside, video_of
from pipeline.vision.rendering.appearance import sample_appearance
from pipeline.vision.rendering.render import render_rgb
from stages.graph.params import PARAMS_FILE, Params
from stages.graph.params_file import read_params_file
from training.drawn_scenes import drawn_scenes

SUITES = ("id", "views", "cross_engine")
SCHEDULE = Schedule()


@dataclass(frozen=True)
class Graded:
    """A clip's name, its answer's grade, true IoU, and whether its forecast beats constant velocity."""

    clip: str
    grade: str
    iou: float
    ahead: bool

    @property
    def deserved(self) -> bool:
        """Whether it deserves to be graded good."""
        return self.iou >= GOOD_IOU and self.ahead


def sampled(suite: str, seed: int, clips: int, simulations: int) -> Iterator[Graded]:
    """Answers to clips of `id` or `views`."""
    scenes: list[Scene] = []
    if suite == "id":
        params = read_params_file(PARAMS_FILE, Params)
        scenes = drawn_scenes(params, seed, "grades", range(clips), params.suites.id.objects)
    for index in range(clips):
        if suite == "views":
            score = views.outcome(seed, index, simulations)
        else:
            shown = replay(scenes[index], SCHEDULE)
            appearance = sample_appearance(np.random.default_rng([seed, index]), len(scenes[index].objects))
            frames = render_rgb(
                scenes[index], shown.position, shown.quaternion, appearance, shown.width, shown.height, "raycast"
            )
            seen = SeenClip(shown.masks, frames, shown.flow, SCHEDULE)
            score = view_score(index, "table", scenes[index], seen, size=SEARCH_SIZE, simulations=simulations)
        yield Graded(f"{suite} {index}", score.grade, score.iou, score.beats_constant_velocity)


def other_engine(clips: int, simulations: int, found: bool) -> Iterator[Graded]:
    """Answers to clips of another engine; found: with masks that the network finds."""
    folder = data_folder() / "cross_engine"
    if not folder.is_dir():
        raise SystemExit(f"there is no {folder}: set DYNAMICS_DATA to the folder that has cross_engine")
    for place in [p for p in find_clips(folder) if p.is_dir()][:clips]:
        yield _of_file(place, simulations, found)


def _of_file(place: Path, simulations: int, found: bool) -> Graded:
    try:
        answer = infer(video_of(place) if found else place, start=0.0, search=simulations)
    except DynamicsError:
        return Graded(place.name, "poor", 0.0, False)
    schedule, told = answer.clip.schedule, answer.scenes.forecast
    read = read_frames(place, seconds=schedule.seconds, source=MaskSource(masks_beside(place)))
    size = answer.clip.taken.clip.letterbox.size
    iou = overlap_with(replay_poses(answer.scene, schedule, *size).masks, with_masks(read, Prompts()).masks)
    return Graded(place.name, answer.grade.name, iou, told is not None and told.better)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=12)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--search", type=int, default=2000)
    parser.add_argument("--only", nargs="*", choices=SUITES, default=SUITES)
    parser.add_argument("--found", action="store_true")
    asked = parser.parse_args(argv)
    print("| suite | clips | IoU | graded good | of these deserved | deserving clips not graded good |")
    print("| --- " * 6 + "|")
    for suite in asked.only:
        some = (
            other_engine(asked.clips, asked.search, asked.found)
            if suite == "cross_engine"
            else sampled(suite, asked.seed, asked.clips, asked.search)
        )
        every = list(some)
        good = [g for g in every if g.grade == "good"]
        missed = [g.clip for g in every if g.grade != "good" and g.deserved]
        iou = float(np.mean([g.iou for g in every]))
        print(
            f"| {suite} | {len(every)} | {iou:.2f} | {len(good)} | {sum(g.deserved for g in good)} | {len(missed)} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
