"""The blind benchmark of discovery: hidden worlds by effect, strength, noise and number of clips.

Writes benchmarks/results/discovery[-smoke]/answers.jsonl one answer at a time (a stopped run continues), then
summary.md, confusion.svg and summary.json beside it. The thresholds (in pipeline/discovery/fitting and
selection) were frozen on other seeds; reported figures come from seeds from 66000 on, first used in that run.
Run: python -m benchmarks.discovery [--smoke] [--share 1.0] [--workers 2] [--minutes M]
Or some groups on other seeds, whose answers go to a folder of their own:
python -m benchmarks.discovery --groups "unlisted beside" "two effects" --seed 90000 --worlds 10 --out FOLDER
Or effects that act in a part of the world: python -m benchmarks.discovery --local --help
Or faults of the measurement: python -m benchmarks.discovery --faults --help
"""

from __future__ import annotations

import argparse
import hashlib
import itertools
import json
import sys
import time
import warnings
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks import local_discovery, recording_faults
from benchmarks.discovery_rivals import rivals
from benchmarks.discovery_summary import write_summary
from benchmarks.kept_answers import answers_of, kept_answers
from pipeline.discovery.discover import discover
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.errors import DynamicsError
from pipeline.hidden.engine import can_simulate
from pipeline.hidden.law_perturbation import UNLISTED
from pipeline.hidden.recipe import Recipe, perturbed_kinds
from pipeline.hidden.world import make_world
from pipeline.scene.effects.registry import effect_kinds

FIRST_SEED = 66000  # first used in the run whose answers are kept; lower seeds were used in development
FIRST_SMOKE_SEED = 0  # of development: a quick check must not use fresh seeds
PAIRS = (
    ("air_drag", "magnus_lift"),
    ("air_drag", "tilted_gravity"),
    ("wind", "buoyancy"),
    ("linear_drag", "rotating_frame"),
    ("magnus_lift", "gravity_error"),
    ("hidden_attractor", "air_drag"),
    ("impulse", "tilted_gravity"),
    ("viscous_friction", "moving_ground"),
    ("rotating_frame", "impulse"),
    ("pair_attraction", "air_drag"),
)
BESIDE = ("air_drag", "linear_drag", "tilted_gravity", "buoyancy", "rotating_frame")
"""Effects beside which an unlisted law is hidden."""
BESIDE_STRENGTH = 100.0  # of these, so that a tenth of it can still be detected
SMOOTHING = 2.0  # samples
WEIGHTS = {"none": 4, "law slightly wrong": 0.25}  # of groups in an early stop, the others' being 1
Job = tuple[str, str, Recipe, str | None]
"""Key, group, recipe, effect struck off the list."""
STRENGTHS = {"weak": 3.0, "medium": 10.0, "strong": 30.0}


def plan(share: float, first_seed: int) -> Iterator[tuple[str, Recipe, str | None]]:
    """(group, recipe, effect struck off the list), in rounds, so that a stopped run has some of everything.

    share: of the whole plan, in which every accepted figure rests on 50 worlds or more.
    """
    names = tuple(name for name, kind in effect_kinds().items() if not kind.discovery.local)
    seeds = itertools.count(first_seed + 1)
    rounds = max(1, round(4 * share))
    strong = STRENGTHS["strong"]
    for turn in range(rounds):
        for word, strength in STRENGTHS.items():
            for k, name in enumerate(names):
                yield f"12 clips, 2 mm, {word}", _recipe(next(seeds), (name,), turn + k, strength=strength), None
        for clips, noise in ((4, 0.001), (4, 0.002), (4, 0.005), (1, 0.002), (12, 0.0005), (12, 0.005)):
            for k, name in enumerate(names):
                recipe = _recipe(next(seeds), (name,), turn + k, strength=strong, noise=noise, clips=clips)
                yield f"{clips} clips, {1e3 * noise:g} mm, strong", recipe, None
        for k in range(75):
            yield "none", _recipe(next(seeds), (), turn + k), None
        for k in range(15):
            pair = PAIRS[(turn * 15 + k) % len(PAIRS)]
            yield "two effects", _recipe(next(seeds), pair, turn + k, strength=strong), None
        for k in range(15):
            seed, unlisted = next(seeds), UNLISTED[(turn * 15 + k) % len(UNLISTED)]
            damaged = seed % 3 == 0
            recipe = Recipe(seed, (), strength=strong, damaged=damaged, engine="events", unlisted=unlisted)
            yield "in no list", recipe, None
        for k in range(15):
            seed, name = next(seeds), BESIDE[(turn * 15 + k) % len(BESIDE)]
            unlisted, share = UNLISTED[(turn + k) % len(UNLISTED)], 0.1 + 0.4 * (k % 5) / 4
            recipe = _recipe(seed, (name,), 2 * turn, strength=BESIDE_STRENGTH)
            yield "unlisted beside", replace(recipe, bounces=False, unlisted=unlisted, unlisted_share=share), None
        for k in range(15):
            effects = ("magnus_lift",) if k % 2 else ("air_drag", "magnus_lift")
            recipe = _recipe(next(seeds), effects, turn + k, strength=strong)
            yield "unknown spin", replace(recipe, spin_measured=False), None
            yield "clock and drag", _recipe(next(seeds), ("clock_rate", "air_drag"), turn + k, strength=strong), None
            recipe = _recipe(next(seeds), (names[(turn * 15 + k) % len(names)],), turn + k, strength=strong)
            yield "smoothed", replace(recipe, smoothing=SMOOTHING), None
        for k, name in enumerate(names if turn == 0 else ()):
            yield "struck off", _recipe(next(seeds), (name,), turn + k, strength=strong), name
        for k, (name, wrong) in enumerate(perturbed_kinds().items()):
            damaged = k % 2 == 0
            recipe = Recipe(next(seeds), (name,), strength=strong, damaged=damaged, engine="events", wrong=wrong)
            yield "law slightly wrong", recipe, None


def _recipe(
    seed: int,
    effects: tuple[str, ...],
    turn: int,
    *,
    strength: float = STRENGTHS["medium"],
    noise: float = 0.002,
    clips: int = 12,
) -> Recipe:
    """A recipe whose engine and bounces depend on `turn`, and its damage on the seed."""
    engine = "events" if turn % 2 == 0 and can_simulate("events", effects) else "mujoco"
    if turn % 5 == 4 and effects and can_simulate("bullet", effects):
        engine = "bullet"
    bounces, damaged = (turn // 2) % 2 == 1, seed % 3 == 0
    return Recipe(seed, effects, strength, noise, clips, bounces=bounces, damaged=damaged, engine=engine)


def answer(job: Job) -> dict[str, Any]:
    """Make one world, discover its effects without the truth, and keep the answer with the truth."""
    key, group, recipe, struck = job
    warnings.simplefilter("ignore")
    out: dict[str, Any] = {"key": key, "group": group, "recipe": asdict(recipe)}
    try:
        world = make_world(recipe, np.random.default_rng([recipe.seed, 77]))
        out["truth"] = {**world.truth, "struck": struck}
        names = tuple(n for n in effect_kinds() if n != struck)
        known = known_scene(world.known)
        began, spent = time.perf_counter(), time.process_time()
        found = discover(world.tracks, known, 0.3, names, np.random.default_rng(recipe.seed))
        out["seconds"], out["processor_seconds"] = time.perf_counter() - began, time.process_time() - spent
        out["report"] = {k: v for k, v in report_dict(found).items() if k not in ("disagreement", "candidates")}
        asked = recipe.clips == 4 and recipe.noise == 0.002
        out["rivals"] = rivals(world.tracks, known, recipe.effects, asked)
    except (DynamicsError, ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        out["error"] = f"{type(error).__name__}: {error}"
    return out


def main() -> None:
    if "--local" in sys.argv:
        local_discovery.main([a for a in sys.argv[1:] if a != "--local"])
        return
    if "--faults" in sys.argv:
        recording_faults.main([a for a in sys.argv[1:] if a != "--faults"])
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--smoke", action="store_true", help="a few worlds, for CI")
    parser.add_argument("--share", type=float, default=1.0, help="of the whole plan")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to go on")
    parser.add_argument("--groups", nargs="+", metavar="GROUP", help="of the plan; needs --out")
    parser.add_argument("--seed", type=int, help="the first one; needs --out")
    parser.add_argument("--worlds", type=int, help="of each group; needs --out; 0: only the summary of what is there")
    parser.add_argument("--out", type=Path, help="folder of the answers")
    arguments = parser.parse_args()
    if arguments.out is None and (arguments.groups or arguments.seed is not None or arguments.worlds is not None):
        parser.error("a part of the plan, or other seeds, need a folder of their own: --out")
    folder = arguments.out or Path("benchmarks/results") / ("discovery-smoke" if arguments.smoke else "discovery")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "answers.jsonl"
    done = {a["key"] for a in kept_answers(path)}
    jobs = []
    first = FIRST_SMOKE_SEED if arguments.smoke else FIRST_SEED
    planned = list(plan(arguments.share, first if arguments.seed is None else arguments.seed))
    unknown = set(arguments.groups or ()) - {group for group, _, _ in planned}
    if unknown:
        valid = ", ".join(dict.fromkeys(group for group, _, _ in planned))
        parser.error(f"--groups: {', '.join(sorted(unknown))} is no group; valid: {valid}")
    for group, recipe, struck in planned:
        if arguments.groups and group not in arguments.groups:
            continue
        key = hashlib.sha256(json.dumps([group, asdict(recipe), struck], sort_keys=True).encode()).hexdigest()[:16]
        jobs.append((key, group, recipe, struck))
    jobs = _sampled(jobs) if arguments.smoke else jobs
    chosen = first_of_each(balanced(jobs), arguments.worlds)
    waiting = [j for j in chosen if j[0] not in done]
    found = answers_of(answer, waiting, path, arguments.workers, arguments.minutes)
    for _ in tqdm(found, total=len(waiting), unit="world"):
        pass
    print(write_summary(kept_answers(path), folder))


def balanced(jobs: Sequence[Job]) -> list[Job]:
    """The jobs in an order in which a stopped run has as many of each group (weighted by `WEIGHTS`), and of each group
    every effect once before any comes twice."""
    rng = np.random.default_rng(0)
    order = rng.permutation(len(jobs))
    rounds: dict[tuple[str, tuple[str, ...]], int] = defaultdict(int)
    within = []
    for i in order:
        _, group, recipe, _ = jobs[i]
        within.append((rounds[group, recipe.effects], group, i))
        rounds[group, recipe.effects] += 1
    place: dict[str, int] = defaultdict(int)
    ranked = []
    for _, group, i in sorted(within, key=lambda row: row[0]):  # stable: the order within a round stays random
        ranked.append((place[group] / WEIGHTS.get(group, 1), i))
        place[group] += 1
    return [jobs[i] for _, i in sorted(ranked, key=lambda row: row[0])]


def first_of_each(jobs: Sequence[Job], worlds: int | None) -> list[Job]:
    """The first jobs of each group, at most `worlds`; None: all."""
    seen: dict[str, int] = defaultdict(int)
    out = []
    for job in jobs:
        seen[job[1]] += 1
        if worlds is None or seen[job[1]] <= worlds:
            out.append(job)
    return out


def _sampled(jobs: list[Any]) -> list[Any]:
    """Twelve jobs, evenly spaced: a quick check of all groups."""
    return jobs[:: max(1, len(jobs) // 12)][:12]


if __name__ == "__main__":
    main()
