"""Rendered films with what phones and people do to them, one plain command each: bodies, view, overlap, grade.

    python -m benchmarks.films [--suite joints] [--films 100] [--first 0] [--seed 5] [--way NAME ...] [--search 2000]
        [--out FOLDER]

Films: benchmarks/rendered_films.py; those of the suite `joints` show pendulums. Each is written as a video file and
asked for as `dynamics infer` would be, without any option. A film's overlap is that of the answer's replay with the
true masks in the stretch that the answer is of; a body that moves and has no counterpart counts as 0. --out: the table,
and a row for each film.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
from tqdm import tqdm

from benchmarks.rendered_films import SUITES, WAYS, Film, draw_film, film_way
from benchmarks.result_files import write_results
from pipeline.api.infer import Inference, infer
from pipeline.clips.overlap import overlap
from pipeline.clips.replay import masks_at
from pipeline.errors import DynamicsError
from pipeline.report.markdown import markdown
from pipeline.vision.recordings.letterbox import of_area
from pipeline.vision.recordings.video import AREA, write_video

DESERVED = 0.7  # IoU of an answer that deserves to be graded good


@dataclass(frozen=True)
class Outcome:
    """How a film was answered. refused: the error, where there is no answer; by: the method; seconds: it took."""

    film: int
    way: str
    kind: str
    bodies: int
    found_bodies: int = 0
    view: str = ""
    iou: float = 0.0
    grade: str = ""
    by: str = ""
    begin: float = 0.0
    end: float = 0.0
    seconds: float = 0.0
    refused: str = ""

    @property
    def bodies_right(self) -> bool:
        return self.bodies == self.found_bodies

    @property
    def view_right(self) -> bool:
        """A flight may be answered as a side view, where nothing tells that there is no support."""
        return self.view == self.kind or {self.view, self.kind} == {"side", "flight"}


def film_iou(film: Film, found: Inference) -> tuple[float, float, float]:
    """Sequence IoU of the answer's replay in the stretch that it is of, and that stretch, s."""
    stamps = found.clip.taken.clip.source_times
    begin, end = float(stamps[0]), float(stamps[-1])
    within = (film.times >= begin - 1e-3) & (film.times <= end + 1e-3)
    size = of_area(film.way.size, AREA)
    true = np.stack([cv2.resize(m, size, interpolation=cv2.INTER_NEAREST) for m in film.masks[within]])
    seen = masks_at(found.scene, np.maximum(film.times[within] - begin, 0), *size)
    return overlap(seen, true, len(found.scene.objects), len(film.scene.objects)).sequence, begin, end


def outcome(suite: str, seed: int, index: int, search: int) -> Outcome:
    """Of the film of a suite with this index. search: simulations."""
    film = draw_film(seed, index, suite)
    of = {"film": index, "way": film.way.name, "kind": film.kind, "bodies": len(film.scene.objects)}
    start = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        write_video(path, film.frames, film.times)
        try:
            found = infer(path, search=search)
        except DynamicsError as error:
            return Outcome(**of, refused=str(error), seconds=time.monotonic() - start)
    iou, begin, end = film_iou(film, found)
    return Outcome(
        **of,
        found_bodies=len(found.scene.objects),
        view=found.scenes.view.kind,
        iou=round(iou, 3),
        grade=found.grade.name,
        by=found.best.name,
        begin=round(begin, 2),
        end=round(end, 2),
        seconds=round(time.monotonic() - start, 1),
    )


def table(outcomes: Sequence[Outcome]) -> str:
    """The outcomes by the way of filming, and all together, as Markdown."""
    rows = pd.DataFrame([asdict(o) | {"right": o.bodies_right, "seen": o.view_right} for o in outcomes])
    head = ("filmed", "films", "bodies right", "view right", "IoU", "graded good")
    lines = []
    for name, own in [*rows.groupby("way", sort=False), ("all", rows)]:
        good = own[own["grade"] == "good"]
        deserved = f"{(good['right'] & (good['iou'] >= DESERVED)).mean():.2f}" if len(good) else "–"
        means = [own["right"].mean(), own["seen"].mean(), own["iou"].mean(), len(good) / len(own)]
        last = [deserved, f"{(own['refused'] != '').sum()}", f"{own['seconds'].median():.0f}"]
        lines.append([str(name), f"{len(own)}", *(f"{mean:.2f}" for mean in means), *last])
    return markdown((*head, "of these deserved", "refused", "s, median"), lines)


def main(argv: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--suite", choices=SUITES, default=SUITES[0])
    parser.add_argument("--films", type=int, default=5 * len(WAYS))
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--way", nargs="*", default=[], choices=[w.name for w in WAYS], metavar="NAME")
    parser.add_argument("--search", type=int, default=2000)
    parser.add_argument("--out", type=Path)
    arguments = parser.parse_args(argv)
    indices = range(arguments.first, arguments.first + arguments.films)
    asked = [i for i in indices if not arguments.way or film_way(i, arguments.suite).name in arguments.way]
    outcomes = []
    for index in tqdm(asked, unit="film"):
        outcomes.append(outcome(arguments.suite, arguments.seed, index, arguments.search))
        tqdm.write(" | ".join(str(v) for v in asdict(outcomes[-1]).values()))
    print("\n" + table(outcomes))
    if arguments.out is not None:
        suite = arguments.suite
        command = f"python -m benchmarks.films --suite {suite} --films {arguments.films} --seed {arguments.seed}"
        title = {"films": "Rendered films", "joints": "Rendered films of pendulums"}[suite]
        write_results(arguments.out, suite, title, command, table(outcomes), outcomes)


if __name__ == "__main__":
    main()
