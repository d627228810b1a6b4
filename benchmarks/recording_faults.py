"""The benchmark of faults: is what is wrong with a recording named as a fault, and never as a law?

    python -m benchmarks.discovery --faults [--worlds 10] [--effect-worlds 2] [--seed 700] [--out FOLDER]

Worlds of `pipeline/hidden` in which nothing is hidden, and some with a strong effect; their measurements are damaged in
ten ways.
"""

from __future__ import annotations

import argparse
import itertools
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.result_files import write_results
from pipeline.discovery.discover import discover
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.track import Track
from pipeline.errors import DynamicsError
from pipeline.hidden.recipe import Recipe
from pipeline.hidden.world import make_world
from pipeline.report.markdown import markdown
from pipeline.scene.effects.registry import effect_kinds

FIRST_SEED = 700
STRONG = 30.0
EFFECTS = ("air_drag", "tilted_gravity", "hidden_attractor", "magnus_lift", "wind", "viscous_friction")
Damage = Callable[[Sequence[Track], np.random.Generator], list[Track]]


def _some_clips(tracks: Sequence[Track], count: int, rng: np.random.Generator) -> set[str]:
    clips = list(dict.fromkeys(t.clip for t in tracks))
    return set(rng.choice(clips, min(count, len(clips)), replace=False))


def _middle(track: Track, rng: np.random.Generator) -> float:
    return float(track.time[0] + rng.uniform(0.3, 0.7) * np.ptp(track.time))


def outliers(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Some 3 % of the samples are off by centimetres."""
    bad = [rng.random(len(t.time)) < 0.03 for t in tracks]
    return [
        replace(t, position=t.position + b[:, None] * rng.normal(0, 0.05, t.position.shape))
        for t, b in zip(tracks, bad, strict=True)
    ]


def heavy_tails(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """More noise, of Student's distribution with three degrees of freedom."""
    return [replace(t, position=t.position + 0.0015 * rng.standard_t(3, t.position.shape)) for t in tracks]


def jitter(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Each time is off by a tenth of an interval."""
    return [replace(t, time=t.time + 0.1 / 60 * rng.uniform(-1, 1, len(t.time))) for t in tracks]


def grid(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Positions are multiples of 5 mm."""
    return [replace(t, position=0.005 * np.round(t.position / 0.005)) for t in tracks]


def bumped_camera(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """In two recordings all positions are off by centimetres from some time on."""
    when = {clip: (_middle(next(t for t in tracks if t.clip == clip), rng), rng.normal(0, 0.025, 3))
            for clip in sorted(_some_clips(tracks, 2, rng))}  # fmt: skip
    return [
        replace(t, position=t.position + (t.time > when[t.clip][0])[:, None] * when[t.clip][1]) if t.clip in when else t
        for t in tracks
    ]


def recording_scale(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """One recording is 5 % too large."""
    (clip,) = _some_clips(tracks, 1, rng)
    return [replace(t, position=1.05 * t.position) if t.clip == clip else t for t in tracks]


def dropped_frames(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Each recording lacks three frames, and its times are counted in frames."""
    out = []
    for clip in dict.fromkeys(t.clip for t in tracks):
        mine = [t for t in tracks if t.clip == clip]
        times = np.unique(np.concatenate([t.time for t in mine]))
        gone = rng.choice(times[4:-4], 3, replace=False)
        for t in mine:
            kept = ~np.isin(t.time, gone)
            late = np.searchsorted(np.sort(gone), t.time[kept]) * float(np.median(np.diff(times)))
            out.append(replace(t.samples(kept), time=t.time[kept] - late))
    return out


def hidden_parts(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """A quarter of each track is missing, in one piece."""
    out = []
    for t in tracks:
        first = rng.uniform(0.2, 0.6) * np.ptp(t.time) + t.time[0]
        gone = (t.time > first) & (t.time < first + 0.25 * np.ptp(t.time))
        out.append(replace(t, position=np.where(gone[:, None], np.nan, t.position)))
    return out


def swapped_names(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """In two recordings two bodies have each other's names from some time on."""
    chosen, out = _some_clips(tracks, 2, rng), list(tracks)
    for clip in chosen:
        i, j = [k for k, t in enumerate(tracks) if t.clip == clip][:2]
        late = (tracks[i].time > _middle(tracks[i], rng))[:, None]
        a, b = tracks[i].position, tracks[j].position
        out[i] = replace(tracks[i], position=np.where(late, b, a))
        out[j] = replace(tracks[j], position=np.where(late, a, b))
    return out


def correlated_noise(tracks: Sequence[Track], rng: np.random.Generator) -> list[Track]:
    """Noise of 2 mm, of which four fifths last until the next sample."""
    out = []
    for t in tracks:
        noise = rng.normal(0, 0.002, t.position.shape)
        for k in range(1, len(noise)):
            noise[k] = 0.8 * noise[k - 1] + 0.6 * noise[k]
        out.append(replace(t, position=t.position + noise))
    return out


#: Damage -> the fault that it should be called; None: there is no name for it.
DAMAGES: dict[Damage, str | None] = {
    outliers: "outliers",
    heavy_tails: None,
    jitter: None,
    grid: None,
    bumped_camera: "bumped_camera",
    recording_scale: "recording_scale",
    dropped_frames: "dropped_frames",
    hidden_parts: None,
    swapped_names: "swapped_names",
    correlated_noise: "correlated_noise",
}


@dataclass(frozen=True)
class Score:
    """How a world was answered.

    Attributes:
        seed: Of the world.
        damage: How its measurements were damaged.
        hidden: The hidden effect; empty: none.
        answer: The effects that were named.
        right: Whether the answer, or one that it cannot be told from, is what is hidden.
        fault: Whether the fault was named; NaN where it has no name.
        faults: The faults that were named.
        seconds: The discovery took.
    """

    seed: int
    damage: str
    hidden: str
    answer: str
    right: bool
    fault: float
    faults: str
    seconds: float


def score(job: tuple[int, Damage, str | None]) -> Score | None:
    """Make a world, damage and answer it; None where it has too few bodies for the damage."""
    seed, damage, effect = job
    warnings.simplefilter("ignore")
    rng = np.random.default_rng([seed, 91])
    effects = () if effect is None else (effect,)
    world = make_world(Recipe(seed, effects, STRONG, bounces=seed % 2 == 0), rng)
    if damage is swapped_names and len({t.object for t in world.tracks}) < 2:
        return None
    tracks = damage(world.tracks, rng)
    began = time.perf_counter()
    try:
        found = discover(tracks, known_scene(world.known), 0.3, tuple(effect_kinds()), np.random.default_rng(seed))
    except (DynamicsError, ArithmeticError, ValueError) as error:
        print(f"seed {seed}, {damage.__name__}: {type(error).__name__}: {error}")
        return None
    verdict, faults = found.verdict, sorted({f.fault for f in found.faults})
    alike = {name for group in verdict.equivalent for name in group}
    right = verdict.effects == effects or (effect in alike and len(verdict.effects) <= 1)
    name = DAMAGES[damage]
    return Score(
        seed,
        damage.__name__,
        effect or "",
        "+".join(verdict.effects),
        right,
        np.nan if name is None else float(name in faults),
        "+".join(faults),
        time.perf_counter() - began,
    )


def jobs(damage: Damage, effect_names: Sequence[str | None], seed: int) -> Iterator[tuple[int, Damage, str | None]]:
    """Jobs of a damage without end, with the effects in turn."""
    place = list(DAMAGES).index(damage)
    for k in itertools.count():
        yield seed + 100 * k + place, damage, effect_names[k % len(effect_names)]


def table(scores: Sequence[Score]) -> str:
    """A line for each damage."""
    data = pd.DataFrame(scores)
    head = ("damage", "worlds", "a law is named", "unknown", "the fault is named", "with a strong effect", "right", "s")
    lines = []
    for name, rows in [*data.groupby("damage", sort=False), ("all", data)]:
        none, some = rows[rows.hidden == ""], rows[rows.hidden != ""]
        law = (none.answer != "") & (none.answer != "unknown")
        cells = [
            law.mean(),
            (none.answer == "unknown").mean(),
            rows.fault.mean(),
            some.right.mean(),
            rows.seconds.median(),
        ]
        a, b, c, d, e = ("–" if np.isnan(v) else f"{v:.2f}" for v in cells)
        lines.append([str(name).replace("_", " "), str(len(none)), a, b, c, str(len(some)), d, e])
    return markdown(head, lines)


def main(argv: Sequence[str]) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=10, help="of each damage, with nothing hidden")
    parser.add_argument("--effect-worlds", type=int, default=2, help="of each damage, with a strong effect")
    parser.add_argument("--seed", type=int, default=FIRST_SEED)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--only", help="one damage, as a function of this module is named")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/faults"))
    a = parser.parse_args(argv)
    damages = [d for d in DAMAGES if a.only in (None, d.__name__)]
    if not damages:
        parser.error(f"--only: {a.only} is no damage; valid: {', '.join(d.__name__ for d in DAMAGES)}")
    scores: list[Score] = []
    with get_context("spawn").Pool(a.workers) as pool, tqdm(total=len(damages) * (a.worlds + a.effect_worlds)) as bar:
        for damage, (wanted, names, seed) in itertools.product(
            damages, ((a.worlds, (None,), a.seed), (a.effect_worlds, EFFECTS, a.seed + 50))
        ):
            waiting, got = jobs(damage, names, seed), 0
            while got < wanted:
                new = [s for s in pool.imap(score, itertools.islice(waiting, wanted - got)) if s is not None]
                bar.update(len(new))
                got += len(new)
                scores += new
    command = (
        f"python -m benchmarks.discovery --faults --worlds {a.worlds} --effect-worlds {a.effect_worlds} --seed {a.seed}"
    )
    text = table(scores)
    write_results(a.out, "faults", "Faults of the measurement", command, text, scores)
    print(text)
