"""Whether the launch that a report proposes settles what its recordings left open, beside a random one.

    python -m benchmarks.next_launch [--worlds 60] [--seed 71000] [--clips 2] [--more 2] [--workers 2] [--out FOLDER]

Worlds with one hidden effect, from few recordings, are explained. Where the verdict does not name the hidden effect
alone, and the report proposes a launch, that launch is simulated in the hidden world (`--more` recordings), and the old
and the new recordings are explained together. The same is done with as many recordings of a launch that is drawn from
those the report chose from. Where no launch tells the explanations apart, the report proposes none; those are counted.
OUT gets answers.jsonl, from which a stopped run goes on, and next_launch.md.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from benchmarks.kept_answers import answers_of, kept_answers
from benchmarks.result_files import write_results
from pipeline.discovery.discover import discover
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.next_launch import STATES, launches
from pipeline.discovery.report.report_dict import verdict_dict
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.errors import DynamicsError
from pipeline.hidden.judge import judge
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.world import World, make_world
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.scene import SceneObject

OUT = Path("benchmarks/results/next_launch")
EFFECTS = (
    *("air_drag", "linear_drag", "magnus_lift", "wind", "buoyancy", "gravity_error", "tilted_gravity"),
    *("rotating_frame", "hidden_attractor", "viscous_friction", "moving_ground", "anisotropic_friction", "clock_rate"),
)
TRIES = 20  # worlds looked at for each one that is left open


def explained(world: World) -> Discovery:
    """What our workflow says of a world."""
    names = sorted(effect_kinds())
    return discover(world.tracks, known_scene(world.known), 0.3, names, np.random.default_rng(0))


def settled(found: Discovery, truth: dict[str, Any]) -> dict[str, bool]:
    """Whether a verdict is right, and whether it names the hidden effect alone."""
    right = judge(verdict_dict(found.verdict), truth).right
    alone = list(found.verdict.effects) == [e["name"] for e in truth["effects"]] and not found.verdict.equivalent
    return {"right": right, "alone": alone}


def states_of(bodies: Sequence[SceneObject]) -> list[dict[str, Any]]:
    """The initial states of bodies, as `make_world` takes them."""
    return [{key: getattr(b, key) for key in STATES} for b in bodies]


def answer(job: tuple[int, int, int]) -> dict[str, Any]:
    """One world: what is right at first, with the proposed launch, and with a random one."""
    seed, clips, more = job
    rng = np.random.default_rng(seed)
    effect, strength = str(rng.choice(EFFECTS)), float(rng.choice([4.0, 10.0]))
    engine = str(rng.choice(["mujoco", "events"]))
    recipe = Recipe(seed, (effect,), strength, 0.002, clips, engine=engine)
    out: dict[str, Any] = {"seed": seed, "effect": effect, "strength": strength, "open": False, "unproposed": False}
    try:
        world = make_world(recipe, np.random.default_rng(seed))
        found = explained(world)
        launch, before = found.verdict.launch, settled(found, world.truth)
        if launch is None or before["alone"]:
            return out | {"unproposed": not before["alone"]}
        tried = launches(found.selection)
        drawn = tried[int(rng.integers(len(tried)))][1]
        out |= {"open": True, "launch": launch.as_dict(), "before": before}
        for name, bodies in (("proposed", launch.scene.objects), ("random", drawn)):
            again = make_world(recipe, np.random.default_rng(seed), [states_of(bodies)] * more)
            out[name] = settled(explained(again), again.truth)
    except DynamicsError as error:
        return out | {"open": False, "error": str(error)}
    return out


def table(answers: Sequence[dict[str, Any]], more: int) -> str:
    """Shares of right verdicts of the worlds that were left open."""
    left = [a for a in answers if a["open"]]
    lines = [
        f"Of {len(answers)} worlds, {len(left)} were left open and a launch was proposed; in "
        f"{sum(a['unproposed'] for a in answers)} others no launch tells. {more} recordings of each launch.",
        "",
        "| | right, in a set of at most three | the hidden effect alone |",
        "| --- | --- | --- |",
    ]
    names = {"before": "before", "proposed": "with the proposed launch", "random": "with a random launch"}
    for name, words in names.items():
        shares = [np.mean([a[name][key] for a in left]) if left else np.nan for key in ("right", "alone")]
        lines.append(f"| {words} | {shares[0]:.2f} | {shares[1]:.2f} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=60, help="that are left open")
    parser.add_argument("--seed", type=int, default=71000)
    parser.add_argument("--clips", type=int, default=2)
    parser.add_argument("--more", type=int, default=2, help="recordings of a launch")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, help="stop after so long; run again to go on")
    parser.add_argument("--out", type=Path, default=OUT)
    a = parser.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    kept = kept_answers(a.out / "answers.jsonl")
    done = {k["seed"] for k in kept}
    jobs = [(s, a.clips, a.more) for s in range(a.seed, a.seed + TRIES * a.worlds) if s not in done]
    missing = a.worlds - sum(k["open"] for k in kept)
    with tqdm(total=a.worlds, initial=a.worlds - missing, unit="world") as bar:
        new = answers_of(answer, jobs, a.out / "answers.jsonl", a.workers, a.minutes) if missing > 0 else iter(())
        for found in new:
            kept.append(found)
            bar.update(int(found["open"]))
            if sum(k["open"] for k in kept) >= a.worlds:
                break
    command = f"python -m benchmarks.next_launch --worlds {a.worlds} --seed {a.seed} --clips {a.clips} --more {a.more}"
    title = "What the proposed recording settles"
    write_results(a.out, "next_launch", title, command, table(kept, a.more))
    print((a.out / "next_launch.md").read_text())


if __name__ == "__main__":
    main()
