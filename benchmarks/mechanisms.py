"""The blind benchmark of mechanisms: is what a model lacks named from its log, and nothing where nothing is hidden?

    python -m benchmarks.mechanisms [--worlds 1] [--seed 700] [--models pendulum,arm] [--effects ...] [--out FOLDER]

Worlds: benchmarks/mechanism_worlds.py, of each effect and strength in a model that is drawn, and as many with nothing
hidden, with two effects, and with a law that is not listed. An answer is right where all that is hidden is named, and
nothing else; an effect may stand in a set of at most three that these data cannot tell apart. Of a law that is not
listed the right answer is "unknown". A stopped run goes on from its answers, and has about as many of each row.
"""

from __future__ import annotations

import argparse
import itertools
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from tqdm import tqdm

from benchmarks.kept_answers import Answer, answers_of, kept_answers, kept_folder
from benchmarks.mechanism_worlds import MODELS, NONE, STRENGTHS, TWO, UNLISTED, make_world
from benchmarks.result_files import write_results
from pipeline.discovery.mechanisms.discovery import discover_mechanism
from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.report.markdown import markdown

FIRST_SEED = 700
HELD_OUT = 0.3
MOST_ALIKE = 3  # effects in a set that counts as right
RESULTS = Path(__file__).parent / "results" / "mechanisms"


@dataclass(frozen=True)
class Job:
    """One world. model: tried first; others follow where the effect cannot act in it."""

    seed: int
    models: tuple[str, ...]
    hidden: str
    strength: str
    folder: str


def jobs_of(worlds: int, seed: int, models: Sequence[str], effects: Sequence[str], folder: Path) -> list[Job]:
    """The worlds of each effect and strength, each in a model that is drawn; neighbours differ in both."""
    out: list[Job] = []
    strengths = list(STRENGTHS)
    for turn in range(worlds * len(strengths)):
        for k, hidden in enumerate((NONE, TWO, UNLISTED, *effects)):
            number, strength = seed + len(out), strengths[(turn + k) % len(strengths)]
            order = np.random.default_rng(number).permutation(len(models))
            out.append(Job(number, tuple(models[i] for i in order), hidden, strength, str(folder)))
    return out


def answer(job: Job) -> Answer:
    """The verdict on a world; `right` is None where the effect can act in none of the models."""
    strength = "" if job.hidden == NONE else job.strength
    out: Answer = {"seed": job.seed, "hidden": job.hidden, "strength": strength, "right": None}
    for model in job.models:
        world = make_world(job.seed, model, job.hidden, job.strength, Path(job.folder))
        if world is None:
            continue
        begin = time.process_time()
        names = tuple(mechanism_effects())
        found = discover_mechanism(world.log, world.mechanism, HELD_OUT, names, (), np.random.default_rng(0))
        verdict, gap = found.verdict, found.gap
        return out | {
            "model": model,
            "laws": list(world.hidden),
            "places": list(world.places),
            "values": [{k: np.asarray(v).tolist() for k, v in values.items()} for values in world.values],
            "effects": list(verdict.effects),
            "equivalent": [list(s) for s in verdict.equivalent],
            "confidence": verdict.confidence,
            "right": is_right(
                ("unknown",) if job.hidden == UNLISTED else world.hidden, verdict.effects, verdict.equivalent
            ),
            "gap": [gap.before, gap.after, gap.noise_floor],
            "seconds": time.process_time() - begin,
        }
    return out


def is_right(truth: Sequence[str], named: Sequence[str], equivalent: Sequence[Sequence[str]]) -> bool:
    """Whether a verdict names what is hidden and nothing else, each effect itself or in a small set."""
    sets = [s for s in equivalent if len(s) <= MOST_ALIKE]

    def stands(name: str, true: str) -> bool:
        return name == true or any({name, true} <= set(s) for s in sets)

    pairings = (zip(order, truth, strict=False) for order in itertools.permutations(named))
    return len(named) == len(truth) and any(all(stands(n, t) for n, t in pairs) for pairs in pairings)


def summary(answers: Sequence[Answer]) -> str:
    """The tables: by effect and strength, and by model."""
    judged = [a for a in answers if a["right"] is not None]

    def row(name: str, some: Sequence[Answer]) -> list[str]:
        unknown = sum(a["effects"] == ["unknown"] and not a["right"] for a in some)
        right = sum(a["right"] for a in some)
        wrong = Counter("+".join(a["effects"]) or NONE for a in some if not a["right"] and a["effects"] != ["unknown"])
        said = ", ".join(f"{n} ({k})" if k > 1 else n for n, k in wrong.most_common())
        seconds = float(np.median([a["seconds"] for a in some]))
        return [name, *map(str, (len(some), right, unknown, len(some) - right - unknown)), f"{seconds:.0f}", said]

    head = ["hidden", "worlds", "right", "unknown", "wrong", "median s of processor", "said instead"]
    kinds = dict.fromkeys((a["hidden"], a["strength"]) for a in judged)
    rows = [
        row(f"{h} {s}".strip(), [a for a in judged if (a["hidden"], a["strength"]) == (h, s)]) for h, s in sorted(kinds)
    ]
    models = [row(m, [a for a in judged if a["model"] == m]) for m in sorted({a["model"] for a in judged})]
    left = sorted({f"{a['hidden']} {a['strength']}" for a in answers if a["right"] is None})
    note = f"\nNo world was found for: {', '.join(left)}.\n" if left else ""
    return "\n".join([markdown(head, [*rows, row("all", judged)]), "", markdown(["model", *head[1:]], models), note])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add = parser.add_argument
    add("--worlds", type=int, default=1, help="of each effect and strength (1)")
    add("--seed", type=int, default=FIRST_SEED, help=f"of the first world ({FIRST_SEED})")
    add("--models", default=",".join(MODELS), help="names with commas between (all)")
    add("--effects", default=",".join(mechanism_effects()), help="names with commas between (all)")
    add("--workers", type=int, default=1)
    add("--minutes", type=float, help="stop after so long")
    add("--out", type=Path, default=RESULTS)
    a = parser.parse_args()
    with kept_folder(a.out) as folder:
        path = folder / "answers.jsonl"
        done = {x["seed"] for x in kept_answers(path)}
        jobs = jobs_of(a.worlds, a.seed, a.models.split(","), a.effects.split(","), folder)
        left = [j for j in jobs if j.seed not in done]
        for _ in tqdm(answers_of(answer, left, path, a.workers, a.minutes), total=len(left), unit="world"):
            pass
        text = summary(kept_answers(path))
        write_results(folder, "summary", "What models of mechanisms lack", "python -m benchmarks.mechanisms", text)
        print(text)


if __name__ == "__main__":
    main()
