"""Sampled scenes as people film them, from true masks: is the view right, and does the scene follow the clip?

    python -m benchmarks.views [--clips 40] [--seed 11] [--only KIND ...] [--search 1000]

Scenes: pipeline/scene/sample_views.py; pictures: the ray caster's with a random appearance; exact flow. No model is
asked: tracks answer, and the search where they do not explain a clip. The graph scores the suite `views` in the same
way (stages/tracks.py), on fewer clips.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np

from pipeline.clips.draw_views import draw_view_clips, view_kind
from pipeline.clips.replay import replay
from pipeline.clips.schedule import Schedule
from pipeline.evaluation.view_scores import SeenClip, view_score
from pipeline.evaluation.view_tables import CLIP_HEADING, ViewScore, clip_line, kinds_table
from pipeline.inference.find_scenes import SEARCH_SIZE
from pipeline.vision.rendering.appearance import sample_appearance
from pipeline.vision.rendering.render import render_rgb

SUITE = "views benchmark"
SCHEDULE = Schedule()


def outcome(seed: int, index: int, simulations: int) -> ViewScore:
    """Of the clip with this index. simulations: of the search."""
    (scene,) = draw_view_clips(seed, SUITE, [index], SCHEDULE).scenes
    shown = replay(scene, SCHEDULE)
    appearance = sample_appearance(np.random.default_rng([seed, index]), len(scene.objects), n_fixed=len(scene.fixed))
    frames = render_rgb(scene, shown.position, shown.quaternion, appearance, shown.width, shown.height, "raycast")
    seen = SeenClip(shown.masks, frames, shown.flow, SCHEDULE)
    return view_score(index, view_kind(index), scene, seen, size=SEARCH_SIZE, simulations=simulations)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=40)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--search", type=int, default=1000)
    arguments = parser.parse_args(argv)
    print(CLIP_HEADING)
    scores = []
    for index in range(arguments.clips):
        if arguments.only and view_kind(index) not in arguments.only:
            continue
        scores.append(outcome(arguments.seed, index, arguments.search))
        print(clip_line(scores[-1]), flush=True)
    print("\n" + kinds_table(scores))


if __name__ == "__main__":
    main()
