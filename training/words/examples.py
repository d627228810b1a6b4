"""Workers that make training examples: views of motions with their answers, in files for the trainer beside them.

    python -m training.words.examples MOTIONS OUT --worker 0 --workers 14 --seconds 700

A file holds CHUNK views as arrays KIND.N.NAME: KIND is what is shown, N the number of bodies in the prompt (0 for whole
frames). Each view has ANSWERS answers: other orders and places of the bodies, with or without `<think>`.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import torch

from pipeline.language.events import Event
from pipeline.model import decisions as d
from pipeline.objects.fields import NOTHING, OBJECT_FIELDS, SCENE_FIELDS, on_scale
from pipeline.objects.instances import Instances
from training.words.motions import Motion, read_motions
from training.words.views import (
    FIRST,
    FRAME,
    Fields,
    Turned,
    boxes_wanted,
    frame_flow,
    frame_rgb,
    instances_with_errors,
    motion_labels,
    noisy,
    numbers_of,
    pictures,
    rgb_crops,
    shown_rgb,
    turned,
)

CHUNK = 96
ANSWERS = 3
#: Kinds of example and their shares of what is made; colours take longest and are shown more often each.
SHARES = {"flow": 0.82, "rgb": 0.06, "frame_flow": 0.1, "frame_rgb": 0.02}
WITHOUT_THINK = 0.25
Arrays = dict[str, np.ndarray]


def flow_crops(instances: Instances) -> np.ndarray:
    """(N, T, 3, S, S) int8: flow right and down, own less others."""
    c = instances.crops
    return np.stack([c[:, :, 2], c[:, :, 3], own_less_others(instances)], 2)


def own_less_others(instances: Instances) -> np.ndarray:
    """(N, T, S, S) int8: share of the body less half that of others; negative outside of the picture."""
    c = instances.crops.astype(np.int16)
    return np.where(c[:, :, 1] < 0, c[:, :, 1], c[:, :, 0] - c[:, :, 1] // 2).clip(-127, 127).astype(np.int8)


def example(view: Turned, kind: str, fields: Fields, rng: np.random.Generator) -> tuple[int, Arrays] | None:
    """Number of bodies in the prompt (0: whole frames) and the arrays of an example; None where no body is seen."""
    scene, shapes, values = numbers_of(view)
    scene = on_scale(torch.from_numpy(scene), SCENE_FIELDS).tolist()
    values = on_scale(torch.from_numpy(values), OBJECT_FIELDS).numpy()
    if kind == "frame_rgb":
        shown = frame_rgb(shown_rgb(view, rng, None, *FRAME))
        return 0, {"frames": shown} | _frame_answers(view, scene, shapes, values, rng)
    seen = pictures(view)
    if kind == "frame_flow":
        shown = frame_flow(noisy(seen.flow, seen.masks, seen.within, fields, rng))
        return 0, {"frames": shown} | _frame_answers(view, scene, shapes, values, rng)
    instances = instances_with_errors(seen, len(shapes), fields, rng)
    n = len(instances)
    if not 0 < n <= d.PLACES:
        return None
    at = instances.ids - 1
    real = at < len(shapes)
    crops = flow_crops(instances)
    if kind == "rgb":
        colours = rgb_crops(shown_rgb(view, rng, boxes_wanted(instances.places), 240, 160), instances.places)
        crops = np.concatenate([colours, own_less_others(instances)[:, :, None]], 2)
    theirs = np.full(n, NOTHING, np.int8)
    theirs[real] = shapes[at[real]]
    numbers = np.zeros((n, len(OBJECT_FIELDS)), np.float32)
    numbers[real] = values[at[real]]
    motion = np.zeros((n, len(FIRST), 9), np.float32)
    motion[real] = motion_labels(view)[at[real]]
    rows = []
    for k in range(ANSWERS):
        order = rng.permutation(n)
        places = np.sort(rng.permutation(d.PLACES)[:n])
        index = {int(at[j]): i for i, j in enumerate(order) if real[j]}
        said = d.Said([int(s) for s in theirs[order]], _events(view.events, index), scene, numbers[order].tolist())
        answer = d.answer_of(places.tolist(), rng.random() >= WITHOUT_THINK, False, said)
        rows.append({"order": order.astype(np.int8), "numbers": places.astype(np.int16), **vars(answer)})
    soon = _soon(view.events, {int(a): i for i, a in enumerate(at)}, n)
    body = {"crops": crops, "places": instances.places, "shapes": theirs, "motion": motion, "soon": soon}
    return n, body | _joined(rows)


def _events(events: list[Event], index: dict[int, int]) -> list[tuple[float, int, int, int | None]]:
    """Events of bodies that the prompt has, by their index there."""
    return [
        (e.time, d.KINDS.index(e.kind), index[e.first], None if e.second is None else index[e.second])
        for e in events
        if e.first in index and (e.second is None or e.second in index)
    ]


def _soon(events: list[Event], index: dict[int, int], n: int) -> np.ndarray:
    """(N, T, 8) int8: whether an event of each kind comes before the next of the model's frames."""
    out = np.zeros((n, len(FIRST), len(d.KINDS)), np.int8)
    for e in events:
        for body in e.objects:
            if body in index:
                out[index[body], min(int(e.time * 10), 9), d.KINDS.index(e.kind)] = 1
    return out


def _frame_answers(view: Turned, scene, shapes, values, rng: np.random.Generator) -> Arrays:
    n = len(shapes)
    events = _events(view.events, {i: i for i in range(n)})
    said = d.Said(shapes.tolist(), events, scene, values.tolist())
    rows = []
    for k in range(ANSWERS):
        reason = rng.random() >= WITHOUT_THINK
        rows.append(vars(d.answer_of(range(d.MOST_IN_FRAME), reason, True, said)))
    return _joined(rows)


def _joined(rows: list[Arrays]) -> Arrays:
    longest = max(len(r["ask"]) for r in rows)
    return {k: np.stack([_filled(r[k], longest, k) if k in d.ANSWER_TYPES else r[k] for r in rows]) for k in rows[0]}


def _filled(row: np.ndarray, length: int, name: str) -> np.ndarray:
    fill = -1 if name in ("choice", "field") else 0
    return np.concatenate([row, np.full(length - len(row), fill, row.dtype)])


def chunks(
    motions: Iterator[Motion], rng: np.random.Generator, shares: dict[str, float], size: int = CHUNK
) -> Iterator[Arrays]:
    """Arrays KIND.N.NAME of `size` views at a time."""
    fields = Fields()
    kinds = list(shares)
    share = np.array(list(shares.values()))
    groups: dict[str, list[Arrays]] = defaultdict(list)
    made = 0
    for motion in motions:
        view = turned(motion, rng)
        if view is None:
            continue
        kind = kinds[rng.choice(len(kinds), p=share / share.sum())]
        found = example(view, kind, fields, rng)
        if found is None:
            continue
        groups[f"{kind}.{found[0]}"].append(found[1])
        made += 1
        if made == size:
            yield _stacked(groups)
            groups.clear()
            made = 0


def _stacked(groups: dict[str, list[Arrays]]) -> Arrays:
    out = {}
    for key, rows in groups.items():
        longest = max(r["ask"].shape[1] for r in rows)
        for name in rows[0]:
            each = [r[name] for r in rows]
            if name in d.ANSWER_TYPES:
                each = [np.stack([_filled(a, longest, name) for a in r]) for r in each]
            out[f"{key}.{name}"] = np.stack(each)
    return out


def shuffled(folder: Path, rng: np.random.Generator) -> Iterator[Motion]:
    """Motions of the folder's files without end, files and motions in random order."""
    while True:
        for path in rng.permutation(sorted(folder.glob("[0-9]*.npz"))):
            motions = read_motions(path)
            for k in rng.permutation(len(motions)):
                yield motions[k]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("motions", type=Path, help="folder of `training.words.motions`")
    parser.add_argument("out", type=Path, help="folder of the files")
    parser.add_argument("--worker", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--files", type=int, help="stop after so many")
    parser.add_argument("--ahead", type=int, default=400, help="wait while so many files lie there unread")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--shares", type=json.loads, default=SHARES, help="JSON of the kinds' shares")
    asked = parser.parse_args()
    torch.set_num_threads(1)
    cv2.setNumThreads(1)
    asked.out.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng((asked.seed, asked.worker))
    end, began = time.time() + asked.seconds, time.time()
    for k, arrays in enumerate(chunks(shuffled(asked.motions, rng), rng, asked.shares)):
        part = asked.out / f".{asked.worker}.npz"
        np.savez(part, **arrays)
        os.replace(part, asked.out / f"{k:06d}-{asked.worker:02d}.npz")
        if k % 20 == 0:
            print(f"worker {asked.worker}: {(k + 1) * CHUNK / (time.time() - began):.0f} views/s", flush=True)
        if time.time() > end or k + 1 == asked.files:
            return
        while len(os.listdir(asked.out)) > asked.ahead and time.time() < end:
            time.sleep(0.2)


if __name__ == "__main__":
    main()
