"""The blind benchmark of local effects: is the disagreement found where it is, and named with its region?

    python -m benchmarks.discovery --local [--worlds 6] [--seed 500] [--out FOLDER]
    python -m benchmarks.discovery --local --picture docs/discovery_where.svg --seed 41 --only "rough patch"

Worlds: benchmarks/local_worlds.py, of each kind and strength. F1 is of the time that the report's `disagreement` marks
(z >= 4) against the time in which something hidden acts. Beside it, on the same worlds: stretches of 0.2 s of a fit to
everything, as this project located disagreement before.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.ndimage import binary_dilation
from tqdm import tqdm

from benchmarks.local_worlds import KINDS, STRENGTHS, LocalWorld, make_local_world
from benchmarks.result_files import write_results
from pipeline.discovery.discover import discover
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.report.figures import where_figure
from pipeline.discovery.report.html_page import sentence
from pipeline.discovery.report.localisation import stretches
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.report.residual_table import residual_table
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.errors import DynamicsError
from pipeline.scene.effects.region import Region
from pipeline.scene.effects.registry import effect_kinds
from pipeline.scene.text import effect_text

FIRST_SEED = 500
LEAST_Z = 4.0
RIGHT_REGION = 0.8  # F1 of a region's samples and those in which the hidden effect acts
MOST_ALIKE = 3  # effects in a set that counts as right
#: Effects that are one law in these worlds: on pucks, which never fly, drag of the contact and of the air.
SAME = {
    "viscous_friction": {"linear_drag"},
    "linear_drag": {"viscous_friction"},
    "wind": {"air_drag"},
    "air_drag": {"wind"},
}


@dataclass(frozen=True)
class Score:
    """How a world was answered. bias: of the fitted friction, relative; named: "right", "unknown", "nothing" or
    "wrong"; NaN or empty where there is none."""

    seed: int
    kind: str
    strength: str
    f1: float
    f1_everything: float
    bias: float
    region: float
    named: str
    verdict: str
    seconds: float


def f1(world: LocalWorld, rows: Sequence[tuple[str, str, float, float]]) -> float:
    """F1 of intervals (clip, object, start, end) against when something acts, both to a sample; 1 where neither is."""
    right = marked = true = 0
    for track in world.tracks:
        acts = world.acts[track.clip, track.object]
        says = np.zeros(len(acts), bool)
        for clip, name, start, end in rows:
            if (clip, name) == (track.clip, track.object):
                says |= (track.time >= start - 1e-9) & (track.time <= end + 1e-9)
        right += int((says & binary_dilation(acts)).sum() + (acts & binary_dilation(says)).sum())
        marked, true = marked + int(says.sum()), true + int(acts.sum())
    return right / (marked + true) if marked + true else 1.0


def region_f1(world: LocalWorld, report: dict[str, Any]) -> float:
    """F1 of the report's region against when something acts, over the samples of moving bodies, both to a sample; 0
    without a region."""
    if report["where"] is None:
        return 0.0
    region, objects = Region.of(report["where"]["only"]), report["where"]["objects"]
    right = marked = true = 0
    for track in world.tracks:
        velocity = np.gradient(track.position, track.time, axis=0)
        moves = np.linalg.norm(velocity, axis=1) > 0.15
        says = moves & region.holds(track.time, track.position, velocity)
        says &= (objects is None or track.object in objects) and (region.clips is None or track.clip in region.clips)
        acts = world.acts[track.clip, track.object] & moves
        right += int((says & binary_dilation(acts)).sum() + (acts & binary_dilation(says)).sum())
        marked, true = marked + int(says.sum()), true + int(acts.sum())
    return right / max(marked + true, 1)


def named(world: LocalWorld, found: Discovery) -> str:
    """Whether the verdict names what is hidden, with what it is not told from; laws that are one count once."""
    verdict, true = found.verdict, {e.name for e in world.effects}
    if not verdict.effects:
        return "nothing"
    if verdict.effects == ("unknown",):
        return "unknown"
    alike = set(verdict.effects)
    for name in (n for group in verdict.equivalent[:1] for n in group):
        if not any(name in SAME.get(other, ()) for other in alike) and len(alike) < MOST_ALIKE:
            alike.add(name)
    may_be = true | {s for n in true for s in SAME.get(n, set())}
    return "right" if alike & may_be and len(verdict.effects) <= len(true) else "wrong"


def score(seed: int, kind: str, strength: str) -> Score:
    """Of one world."""
    world, began = make_local_world(seed, kind, strength), time.perf_counter()
    names = tuple(effect_kinds())
    found = discover(world.tracks, known_scene(world.known), 0.3, names, np.random.default_rng(seed))
    seconds = time.perf_counter() - began
    report = report_dict(found)
    rows = [
        (d["clip"], d["object"], d["t_start"], d["t_end"]) for d in report["disagreement"] if d["z_score"] >= LEAST_Z
    ]
    objects = [o["name"] for o in world.known["objects"]]
    before = [
        (s.clip, objects[s.object], s.start, s.end) for s in stretches(found.selection.baseline) if s.z >= LEAST_Z
    ]
    frictions = [v["value"] for k, v in report["calibrated"].items() if k.endswith("sliding_friction")]
    bias = np.nan
    if world.friction is not None and frictions:
        bias = float(max(abs(f / world.friction - 1) for f in frictions))
    return Score(
        seed=seed,
        kind=kind,
        strength=strength,
        f1=round(f1(world, rows), 3),
        f1_everything=round(f1(world, before), 3),
        bias=round(bias, 4),
        region=round(region_f1(world, report), 3),
        named=named(world, found),
        verdict="+".join(found.verdict.effects) or "nothing",
        seconds=round(seconds, 1),
    )


def picture(path: Path, seed: int, kind: str) -> None:
    """Write the picture of where the scene fails in a world of medium strength, and print the verdict."""
    world = make_local_world(seed, kind, "medium")
    found = discover(world.tracks, known_scene(world.known), 0.3, tuple(effect_kinds()), np.random.default_rng(seed))
    path.write_text(where_figure(found, residual_table(found)), encoding="utf-8")
    print(sentence(report_dict(found)))
    print(f"hidden: {', '.join(effect_text(e) for e in world.effects)}; friction {world.friction}")
    print({k: e.as_dict() for k, e in found.calibrated.items()}, found.selection.none.fit.theta)


def table(scores: Sequence[Score]) -> str:
    """The scores by kind, of medium and strong effects, and by strength, as Markdown."""
    rows = pd.DataFrame([asdict(s) for s in scores])
    heading = (
        "| worlds | F1 | F1, stretches of a fit to everything | bias of friction, median | region right | named | "
        "unknown, region right | nothing | wrong | s, median |"
    )
    lines = ["| |" + heading[1:], "|" + " --- |" * 11]
    loud = rows[rows["strength"] != "weak"]
    groups = [
        *((f"{kind}, medium and strong", own) for kind, own in loud.groupby("kind", sort=False)),
        ("medium and strong", loud),
        *((strength, own) for strength, own in rows.groupby("strength", sort=False)),
    ]
    for name, own in groups:
        is_right = own["region"] >= RIGHT_REGION
        shares = [
            (own["named"] == "right").mean(),
            ((own["named"] == "unknown") & is_right).mean(),
            (own["named"] == "nothing").mean(),
            (own["named"] == "wrong").mean(),
        ]
        bias = own["bias"].median()
        cells = [f"{len(own)}", f"{own['f1'].mean():.2f}", f"{own['f1_everything'].mean():.2f}"]
        cells += ["–" if np.isnan(bias) else f"{bias:.1%}", f"{is_right.mean():.2f}"]
        cells += [f"{s:.2f}" for s in shares] + [f"{own['seconds'].median():.0f}"]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=6, help="of each kind and strength")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--only", nargs="*", default=[], choices=list(KINDS), metavar="KIND")
    parser.add_argument("--strengths", nargs="*", default=list(STRENGTHS), choices=list(STRENGTHS))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--picture", type=Path, help="write where the scene of one world fails, and do nothing else")
    arguments = parser.parse_args(argv)
    warnings.simplefilter("ignore")
    if arguments.picture is not None:
        picture(arguments.picture, arguments.seed, (arguments.only or list(KINDS))[0])
        return
    scores = []
    jobs = [
        (arguments.seed + k, kind, strength)
        for k in range(arguments.worlds)
        for kind in arguments.only or KINDS
        for strength in arguments.strengths
    ]
    for seed, kind, strength in tqdm(jobs, unit="world"):
        try:
            scores.append(score(seed, kind, strength))
        except DynamicsError as error:
            tqdm.write(f"{seed} {kind} {strength}: {error}")
            continue
        tqdm.write(" | ".join(map(str, asdict(scores[-1]).values())))
    print("\n" + table(scores))
    if arguments.out is not None:
        command = f"python -m benchmarks.discovery --local --worlds {arguments.worlds} --seed {arguments.seed}"
        write_results(arguments.out, "local", "Effects that act in a part", command, table(scores), scores)
