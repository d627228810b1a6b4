"""Discovery from rendered video: worlds in which an effect is hidden that a camera can see, four clips each.

The network for masks finds the bodies; tracks, camera and verdict come from these masks and from the scene file that a
user would write (shape, size and mass; no camera). Writes answers.jsonl one answer at a time (a stopped run continues),
then summary.md beside it. Videos and masks are kept in a folder of their own, since they cost most of the time and do
not depend on the discovery: with --film nothing else is made, and a later run judges what is there.
Run: python -m benchmarks.video_discovery [--worlds 60] [--seed 0] [--out FOLDER] [--films FOLDER] [--film]
    [--workers 1] [--minutes M]
Or write the videos and the scene file of one world, to try the command on:
python -m benchmarks.video_discovery --write clips --hidden restitution --seed 1
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML
from tqdm import tqdm

from benchmarks.kept_answers import answers_of, kept_answers, kept_folder
from benchmarks.seen_worlds import VISIBLE_EFFECTS, SeenWorld, drawn_world, kept_world
from pipeline.clips.intervals import wilson
from pipeline.discovery.discover import discover
from pipeline.discovery.filmed.measured_motion import measure_motion
from pipeline.discovery.filmed.shown_effects import discover_shown
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.errors import DynamicsError, VideoError
from pipeline.hidden.filmed_world import FPS
from pipeline.hidden.judge import judge
from pipeline.report.markdown import markdown
from pipeline.scene.effects.registry import effect_kinds
from pipeline.vision.recordings.video import write_video

FOLDER = Path("benchmarks/results/video_discovery")
STRENGTHS = {"medium": 10.0, "strong": 30.0}
CLIPS = 4


@dataclass(frozen=True)
class Job:
    """A world. key: `seed-number`. hidden: name of the effect. film: the file of its videos and masks."""

    key: str
    group: str
    hidden: str
    strength: float
    film: Path

    @property
    def seed(self) -> list[int]:
        """Of the run, and the world's number."""
        return [int(part) for part in self.key.split("-")]

    def world(self) -> SeenWorld:
        """Filmed, if it was not before."""
        return kept_world(self.film, self.hidden, self.strength, CLIPS, [*self.seed, 91])


def plan(worlds: int, seed: int, films: Path) -> Iterator[Job]:
    """Rounds of every effect at every strength and of two worlds in which nothing is hidden."""
    groups = [(name, word) for word in STRENGTHS for name in VISIBLE_EFFECTS] + [("none", "medium")] * 2
    for number in range(worlds):
        name, word = groups[number % len(groups)]
        group, key = "none" if name == "none" else f"{word}, {name}", f"{seed}-{number}"
        yield Job(key, group, name, STRENGTHS[word], films / f"{key}.npz")


def film(job: Job) -> dict[str, Any]:
    """Film one world and find its bodies; for how long, s of processor time, and the error if there was one."""
    spent = time.process_time()
    out: dict[str, Any] = {"key": job.key, "group": job.group}
    try:
        job.world()
    except VideoError as error:
        out["error"] = str(error)
    return out | {"processor_seconds": time.process_time() - spent}


def answer(job: Job) -> dict[str, Any]:
    """Discover what the scene of one world lacks; the answer with the truth."""
    warnings.simplefilter("ignore")
    out: dict[str, Any] = {"key": job.key, "group": job.group}
    try:
        world = job.world()
        out["truth"] = world.truth
        spent = time.process_time()
        motion = measure_motion(world.clips, known_scene(world.known))

        def find(names: Sequence[str]) -> Discovery:
            return discover(motion.tracks, motion.known, 0.3, names, np.random.default_rng(job.seed[1]))

        shown = discover_shown(motion, tuple(effect_kinds()), find)
        out["notes"] = [*motion.notes, *shown.notes]
        out["report"] = {k: v for k, v in shown.report.items() if k not in ("disagreement", "candidates")}
        out["processor_seconds"] = time.process_time() - spent
    except (DynamicsError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        out["error"] = f"{type(error).__name__}: {error}"
    return out


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
    world = drawn_world(name, STRENGTHS["strong"], CLIPS, rng)
    folder.mkdir(parents=True, exist_ok=True)
    for clip in world.clips(rng, "raycast"):
        write_video(folder / f"{clip.name}.mp4", clip.frames, FPS)
    with (folder / "scene.yaml").open("w", encoding="utf-8") as file:
        YAML(typ="safe").dump(world.known, file)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, default=FOLDER)
    parser.add_argument("--films", type=Path, help="keep videos and masks there, 60 MB a world")
    parser.add_argument("--film", action="store_true", help="film only")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to go on")
    parser.add_argument("--write", type=Path, metavar="FOLDER", help="write the videos of one world instead")
    parser.add_argument("--hidden", default="restitution", choices=(*VISIBLE_EFFECTS, "none"), help="in that world")
    arguments = parser.parse_args()
    if arguments.write is not None:
        write_world(arguments.write, arguments.hidden, arguments.seed)
        return
    if arguments.film and arguments.films is None:
        parser.error("--film: where to? Valid: --film --films FOLDER")
    with kept_folder(arguments.films) as films:
        jobs = list(plan(arguments.worlds, arguments.seed, films))
        if arguments.film:
            work, path = film, films / "films.jsonl"
        else:
            work, path = answer, arguments.out / "answers.jsonl"
        path.parent.mkdir(parents=True, exist_ok=True)
        done = {a["key"] for a in kept_answers(path)}
        waiting = [job for job in jobs if job.key not in done]
        found = answers_of(work, waiting, path, arguments.workers, arguments.minutes)
        for _ in tqdm(found, total=len(waiting), unit="world"):
            pass
    if not arguments.film:
        text = summary(list(kept_answers(path)))
        (arguments.out / "summary.md").write_text(text + "\n", encoding="utf-8")
        print(text)


if __name__ == "__main__":
    main()
