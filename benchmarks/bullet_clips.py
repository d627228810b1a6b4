"""Discovery of the damping of Bullet's bodies, from the true motion of another engine's clips.

Bullet damps bodies by linear_damping and angular_damping, which MuJoCo's bodies do not have. Of each clip every body
that moves from the start is a recording of its own, until it first meets another one. True positions and orientations
get noise; shapes, sizes and masses are known, and what Bullet's friction and restitution are is fitted. A clip counts
where the gap of the calibrated model exceeds three noise floors. Its verdict is right where every effect that it names
is wanted, or stands in a set of at most three that holds a wanted one. Two lists are wanted: `linear_drag` and
`rolling_resistance`; and, beside them, `air_drag`, since Bullet's damping forces and torques are m d (1 + |v|) v and
I d (1 + |w|) w (btMultiBody.cpp), so that a ball that rolls fast is slowed by the square of its speed.
Clips: `cross_engine` in DYNAMICS_DATA or ../shared/data. Writes benchmarks/results/bullet_clips/clips.md.
Run: python -m benchmarks.bullet_clips [--noise 0.0001] [--clips NAME ...]
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.intervals import wilson
from pipeline.discovery.discover import discover
from pipeline.discovery.report.discovery import Discovery
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.track import Track
from pipeline.errors import MeasurementError
from pipeline.hidden.judge import LARGEST_SET
from pipeline.report.markdown import markdown
from pipeline.scene.effects.registry import effect_kinds
from training.data_folder import needed

LEAST_FLOORS = 3.0
LEAST_SAMPLES = 8
LINEAR = frozenset({"linear_drag", "rolling_resistance"})
WANTED = {"linear": LINEAR, "linear or quadratic": LINEAR | {"air_drag"}}
HEAD = ("clip", "bodies", "verdict", "equivalent", "confidence", "gap before, mm", "after", "floor", *WANTED)


@dataclass(frozen=True)
class Outcome:
    """found: the discovery in one clip. bodies: Its shapes, in words."""

    clip: str
    bodies: str
    found: Discovery

    @property
    def counts(self) -> bool:
        """Whether the gap is large enough to ask what makes it."""
        gap = self.found.gap
        return gap.before > LEAST_FLOORS * gap.noise_floor

    def names(self, wanted: frozenset[str]) -> bool:
        """Whether each name of the verdict, or one that these data cannot tell from it, is wanted."""
        verdict = self.found.verdict
        sets = [set(s) for s in verdict.equivalent if len(s) <= LARGEST_SET]
        meant = [{name}.union(*(s for s in sets if name in s)) for name in verdict.effects]
        return bool(meant) and all(names & wanted for names in meant)

    def row(self) -> list[str]:
        """The cells of a table."""
        verdict, gap = self.found.verdict, self.found.gap
        judged = [("right" if self.names(wanted) else "wrong") if self.counts else "" for wanted in WANTED.values()]
        return [
            self.clip,
            self.bodies,
            " + ".join(verdict.effects) or "none",
            "; ".join(", ".join(s) for s in verdict.equivalent),
            f"{verdict.confidence:.2f}",
            *(f"{1e3 * size:.3g}" for size in (gap.before, gap.after, gap.noise_floor)),
            *judged,
        ]


def measured_clip(name: str, truth: Mapping[str, Any], noise: float) -> tuple[list[Track], dict[str, Any]]:
    """The tracks of a clip and the content of its scene file.

    Args:
        name: Of the clip.
        truth: The content of its truth.json.
        noise: Standard deviation of each coordinate, m; orientations get that of a point at the body's surface.
    """
    rng = np.random.default_rng(truth["seed"])
    tracks, objects = [], []
    for body in truth["objects"]:
        meets = [hit["t"] for hit in truth["collisions"] if body["id"] in hit["pair"]]
        time = np.arange(len(body["position"])) / truth["fps"]
        count = int(np.searchsorted(time, min(meets, default=np.inf)))
        if not body["moving_at_start"] or count < LEAST_SAMPLES:
            continue
        sizes, own = _sizes(body["size"]), f"{body['type']}_{body['id']}"
        position, turn = (np.array(body[key])[:count] for key in ("position", "quat_wxyz"))
        position = position + rng.normal(0, noise, position.shape)
        turn = turn + rng.normal(0, noise / min(sizes.values()), turn.shape)
        turn /= np.linalg.norm(turn, axis=1, keepdims=True)
        tracks.append(Track(f"{name}_{own}", own, time[:count], position, quaternion=turn))
        objects.append({"name": own, "shape": body["type"], "mass": body["mass"], **sizes})
    return tracks, {"objects": objects, "fit": ["sliding_friction", "damping"]}


def _sizes(size: Mapping[str, Any]) -> dict[str, float]:
    if "half_extents" in size:
        return dict(zip(("width", "depth", "height"), (2 * h for h in size["half_extents"]), strict=True))
    return {"radius": size["radius"]} | ({"height": 2 * size["half_height"]} if "half_height" in size else {})


def summary(outcomes: Sequence[Outcome]) -> str:
    """The table of all clips, and the shares of those that count."""
    counted = [o for o in outcomes if o.counts]
    lines = [markdown(list(HEAD), [o.row() for o in outcomes]), ""]
    for words, wanted in WANTED.items():
        right = sum(o.names(wanted) for o in counted)
        low, high = wilson(right, len(counted)) if counted else (0.0, 1.0)
        lines.append(
            f"{words}: {right} of {len(counted)} clips whose gap exceeds three floors ({low:.2f} to {high:.2f})"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", type=float, default=1e-4, help="m, of each coordinate")
    parser.add_argument("--clips", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("benchmarks/results/bullet_clips/clips.md"))
    asked = parser.parse_args()
    folder = needed("cross_engine")
    outcomes = []
    for place in sorted(folder.glob("clip_*")):
        if asked.clips and place.name not in asked.clips:
            continue
        truth = json.loads((place / "truth.json").read_text(encoding="utf-8"))
        tracks, known = measured_clip(place.name, truth, asked.noise)
        if not tracks:
            print(f"{place.name}: left out: no body moves alone for {LEAST_SAMPLES} frames", flush=True)
            continue
        rng = np.random.default_rng(truth["seed"])
        try:
            found = discover(tracks, known_scene(known), 0.3, tuple(effect_kinds()), rng)
        except MeasurementError as error:
            print(f"{place.name}: left out: {error}", flush=True)
            continue
        outcomes.append(Outcome(place.name, ", ".join(o["shape"] for o in known["objects"]), found))
        print(" | ".join(outcomes[-1].row()), flush=True)
    text = summary(outcomes)
    print(text)
    if not asked.clips:
        asked.out.write_text(text + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
