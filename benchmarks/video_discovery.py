"""Discovery from rendered video: worlds in which an effect is hidden that a camera can see, four clips each.

The network for masks finds the bodies; tracks, camera and verdict come from these masks and from the scene file that a
user would write (shape, size and mass; no camera). Writes benchmarks/results/video_discovery/answers.jsonl one answer
at a time (a stopped run continues), then summary.md beside it.
Run: python -m benchmarks.video_discovery [--worlds 60] [--seed 0] [--workers 1] [--minutes M]
Or write the videos and the scene file of one world, to try the command on:
python -m benchmarks.video_discovery --write clips --hidden restitution --seed 1
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from tqdm import tqdm

from benchmarks.filmed_worlds import FPS, SIZE, VISIBLE_EFFECTS, FilmedClip, make_filmed_world
from benchmarks.kept_answers import answers_of, kept_answers
from pipeline.discrepancy.discover import discover
from pipeline.discrepancy.report.report_dict import report_dict
from pipeline.discrepancy.tracks.known_scene import known_scene
from pipeline.errors import DynamicsError
from pipeline.evaluation.tables import markdown
from pipeline.filmed.measured_motion import measure_motion
from pipeline.filmed.recorded_clip import RecordedClip
from pipeline.filmed.unfitted import forecast_unfitted
from pipeline.hidden.judge import judge
from pipeline.metrics.intervals import wilson
from pipeline.perception.found_bodies import find_in_clip
from pipeline.perception.prompts import Prompts
from pipeline.perception.user_clip import mask_networks
from pipeline.scene.effects.registry import effect_kinds
from pipeline.vision.recordings.letterbox import letterbox_for
from pipeline.vision.recordings.video import Clip, write_video

FOLDER = Path("benchmarks/results/video_discovery")
STRENGTHS = {"medium": 10.0, "strong": 30.0}
CLIPS = 4
Job = tuple[str, str, str, float, int]
"""Key, group, hidden effect, strength, seed."""


def plan(worlds: int, seed: int) -> Iterator[Job]:
    """Rounds of every effect at every strength and of two worlds in which nothing is hidden."""
    groups = [(name, word) for word in STRENGTHS for name in VISIBLE_EFFECTS] + [("none", "medium")] * 2
    for number in range(worlds):
        name, word = groups[number % len(groups)]
        group = "none" if name == "none" else f"{word}, {name}"
        yield f"{seed}-{number}", group, name, STRENGTHS[word], number


def answer(job: Job) -> dict[str, Any]:
    """Film one world, discover what its scene lacks, and keep the answer with the truth."""
    key, group, name, strength, number = job
    warnings.simplefilter("ignore")
    out: dict[str, Any] = {"key": key, "group": group}
    spent = time.process_time()
    try:
        rng = np.random.default_rng([int(key.partition("-")[0]), number, 91])
        world = make_filmed_world(name, strength, CLIPS, rng, backend="raycast")
        out["truth"] = world.truth
        motion = measure_motion([_recorded(clip) for clip in world.clips], known_scene(world.known))
        out["notes"] = motion.notes
        found = discover(motion.tracks, motion.known, 0.3, tuple(effect_kinds()), np.random.default_rng(number))
        report = report_dict(found)
        report["gap"] |= forecast_unfitted(found, motion).as_dict()
        out["report"] = {k: v for k, v in report.items() if k not in ("disagreement", "candidates")}
    except (DynamicsError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        out["error"] = f"{type(error).__name__}: {error}"
    out["processor_seconds"] = time.process_time() - spent
    return out


def _recorded(clip: FilmedClip) -> RecordedClip:
    """The clip with the masks of the pipeline."""
    whole = letterbox_for(SIZE, SIZE)[0]
    read = Clip(clip.frames, clip.times, clip.times, float(FPS), SIZE, whole)
    found = find_in_clip(read, mask_networks(), Prompts())
    return RecordedClip(clip.name, clip.frames, found.masks, clip.times)


def summary(answers: Sequence[dict[str, Any]]) -> str:
    """The tables of summary.md."""
    groups: dict[str, list[dict[str, Any]]] = defaultdict(list)
    for a in answers:
        groups[a["group"]].append(a)
        if a["group"] != "none":
            groups[a["group"].partition(",")[0] + ", all"].append(a)
    rows = []
    for group, own in sorted(groups.items()):
        judged = [judge(a["report"]["verdict"], a["truth"]) if "report" in a else None for a in own]
        right, wrong = sum(j is not None and j.right for j in judged), sum(j is not None and j.false for j in judged)
        named = [a["report"] for a, j in zip(own, judged, strict=True) if j is not None and j.right]
        low, high = wilson(right, len(own))
        rows.append(
            [
                group,
                str(len(own)),
                f"{right / len(own):.2f} ({low:.2f} to {high:.2f})",
                f"{wrong / len(own):.2f}",
                str(sum("error" in a for a in own)),
                _pair(named, "sequence_iou"),
                _pair(named, "epe_px"),
            ]
        )
    head = ["worlds with", "number", "right", "wrong claims", "not measured", "IoU without → with", "EPE, px"]
    return markdown(head, rows)


def _pair(reports: Sequence[dict[str, Any]], name: str) -> str:
    """Means without and with what was named, of right verdicts."""
    pairs = [(r["gap"][f"{name}_before"], r["gap"][f"{name}_after"]) for r in reports if r["verdict"]["effects"]]
    pairs = [p for p in pairs if p[0] is not None]
    if not pairs:
        return ""
    before, after = np.mean(pairs, axis=0)
    rises = sum(b < a for b, a in pairs) if name == "sequence_iou" else sum(b > a for b, a in pairs)
    return f"{before:.2f} → {after:.2f} (better in {rises} of {len(pairs)})"


def write_world(folder: Path, name: str, seed: int) -> None:
    """Write the videos and the scene file of a world in which an effect is strong."""
    rng = np.random.default_rng(seed)
    world = make_filmed_world(name, STRENGTHS["strong"], CLIPS, rng, backend="raycast")
    folder.mkdir(parents=True, exist_ok=True)
    for clip in world.clips:
        write_video(folder / f"{clip.name}.mp4", clip.frames, FPS)
    with (folder / "scene.yaml").open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(world.known, file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to go on")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the videos of one world instead")
    parser.add_argument("--hidden", default="restitution", choices=(*VISIBLE_EFFECTS, "none"), help="in that world")
    arguments = parser.parse_args()
    if arguments.write is not None:
        write_world(arguments.write, arguments.hidden, arguments.seed)
        return
    FOLDER.mkdir(parents=True, exist_ok=True)
    path = FOLDER / "answers.jsonl"
    done = {a["key"] for a in kept_answers(path)}
    waiting = [job for job in plan(arguments.worlds, arguments.seed) if job[0] not in done]
    found = answers_of(answer, waiting, path, arguments.workers, arguments.minutes)
    for _ in tqdm(found, total=len(waiting), unit="world"):
        pass
    text = summary(list(kept_answers(path)))
    (FOLDER / "summary.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
