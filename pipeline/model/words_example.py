"""Examples for the training of the words model: what is seen of a clip, and answers that are right."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from pipeline.clips.events import Event
from pipeline.model import decisions as d
from pipeline.model.fields import (
    MOTION,
    NOTHING,
    OBJECT_FIELDS,
    SCENE_FIELDS,
    object_numbers,
    on_scale,
    scene_numbers,
)
from pipeline.model.language.completion import MAX_OBJECTS
from pipeline.model.shown import SeenBodies, SeenFrames
from pipeline.scene.rotation import quaternion_conjugate, quaternion_multiply
from pipeline.scene.scene import BASIC_SHAPES, Scene

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class Truth:
    """What is true of a clip.

    Attributes:
        scene: (4,) `SCENE_FIELDS` on their scales.
        shapes: (N,) int8 index of the basic shape of each body.
        values: (N, 19) `OBJECT_FIELDS` on their scales.
        motion: (N, T, 9) position, velocity and spin in each frame.
        events: In order of time; times as shares of the clip.
    """

    scene: np.ndarray
    shapes: np.ndarray
    values: np.ndarray
    motion: np.ndarray
    events: list[Event]


def truth_of(scene: Scene, motion: np.ndarray, events: Sequence[Event], seconds: float) -> Truth:
    """The truth of a clip.

    Args:
        scene: In canonical form.
        motion: Of `motions`.
        events: The true ones, times in s.
        seconds: Of the clip.
    """
    values = np.array([object_numbers(o) for o in scene.objects], np.float32)
    return Truth(
        on_scale(torch.from_numpy(scene_numbers(scene)), SCENE_FIELDS).numpy(),
        np.array([BASIC_SHAPES.index(o.shape) for o in scene.objects], np.int8),
        on_scale(torch.from_numpy(values), OBJECT_FIELDS).numpy(),
        motion,
        [Event(e.time / seconds, e.kind, e.first, e.second) for e in events if e.kind in d.KINDS],
    )


def motions(position: np.ndarray, quaternion: np.ndarray, interval: float) -> np.ndarray:
    """(N, T, 9) position, velocity and spin of bodies between the two frames of each pair.

    Args:
        position: (T, 2, N, 3) m.
        quaternion: (T, 2, N, 4).
        interval: s between the two frames.
    """
    turned = quaternion_multiply(quaternion[:, 1], quaternion_conjugate(quaternion[:, 0]))
    turned = turned * np.where(turned[..., :1] < 0, -1, 1)
    sine = np.linalg.norm(turned[..., 1:], axis=-1, keepdims=True)
    angle = 2 * np.arctan2(sine, turned[..., :1])
    spin = turned[..., 1:] / np.maximum(sine, 1e-9) * angle / interval
    velocity = (position[:, 1] - position[:, 0]) / interval
    return np.concatenate([position[:, 0], velocity, spin], -1).transpose(1, 0, 2).astype(np.float32)


def bodies_example(seen: SeenBodies, truth: Truth, reasons: Sequence[bool], rng: np.random.Generator) -> Arrays:
    """An example with an answer for each of `reasons`, each with its own order and places of the bodies.

    Args:
        seen: What is shown. An instance whose id is beyond the bodies of the truth is no body.
        truth: Of the clip.
        reasons: Whether each answer begins with `<think>`.
        rng: Of orders and places.

    Returns:
        crops, places, shapes (N,), motion, soon (N, T, 8: whether an event of each kind comes before the next of the
        model's frames); order and numbers (A, N) and the arrays of `Answer` (A, L).
    """
    n = len(seen.instances)
    at = seen.instances.ids - 1
    real = at < len(truth.shapes)
    shapes = np.full(n, NOTHING, np.int8)
    shapes[real] = truth.shapes[at[real]]
    values = np.zeros((n, len(OBJECT_FIELDS)), np.float32)
    values[real] = truth.values[at[real]]
    motion = np.zeros((n, seen.instances.places.shape[1], MOTION), np.float32)
    motion[real] = truth.motion[at[real]]
    rows = []
    for reason in reasons:
        order = rng.permutation(n)
        places = np.sort(rng.permutation(d.PLACES)[:n])
        index = {int(at[j]): i for i, j in enumerate(order) if real[j]}
        told = _told(truth.events, index)
        said = d.Said([int(s) for s in shapes[order]], told, truth.scene.tolist(), values[order].tolist())
        answer = d.answer_of(places.tolist(), reason, False, said)
        rows.append({"order": order.astype(np.int8), "numbers": places.astype(np.int16), **vars(answer)})
    soon = _soon(truth.events, {int(a): i for i, a in enumerate(at)}, motion.shape[:2])
    seen_arrays = {
        "crops": seen.crops,
        "places": seen.instances.places,
        "shapes": shapes,
        "motion": motion,
        "soon": soon,
    }
    return seen_arrays | _joined(rows)


def answers_example(seen: SeenBodies | SeenFrames, answers: Sequence[d.Said], reasoning: bool) -> Arrays:
    """An example of the model's own answers, bodies in the order and at the places in which it was asked.

    Returns:
        crops and places, or frames; order and numbers (A, N) of bodies, and the arrays of `Answer` (A, L).
    """
    if isinstance(seen, SeenFrames):
        rows = [vars(d.answer_of(range(MAX_OBJECTS), reasoning, True, said)) for said in answers]
        return {"frames": seen.frames} | _joined(rows)
    n = len(seen.instances)
    asked = {"order": np.arange(n, dtype=np.int8), "numbers": np.arange(n, dtype=np.int16)}
    rows = [asked | vars(d.answer_of(range(n), reasoning, False, said)) for said in answers]
    return {"crops": seen.crops, "places": seen.instances.places} | _joined(rows)


def frames_example(seen: SeenFrames, truth: Truth, reasons: Sequence[bool]) -> Arrays:
    """An example of whole frames: frames, and the arrays of `Answer` (A, L). Bodies stand in the order of the truth."""
    told = _told(truth.events, {i: i for i in range(len(truth.shapes))})
    said = d.Said(truth.shapes.tolist(), told, truth.scene.tolist(), truth.values.tolist())
    rows = [vars(d.answer_of(range(MAX_OBJECTS), reason, True, said)) for reason in reasons]
    return {"frames": seen.frames} | _joined(rows)


def _told(events: list[Event], index: dict[int, int]) -> list[tuple[float, int, int, int | None]]:
    """Events of bodies that the prompt has, by their index there."""
    return [
        (e.time, d.KINDS.index(e.kind), index[e.first], None if e.second is None else index[e.second])
        for e in events
        if e.first in index and (e.second is None or e.second in index)
    ]


def _soon(events: list[Event], index: dict[int, int], shape: tuple[int, int]) -> np.ndarray:
    """(N, T, 8) int8."""
    out = np.zeros((*shape, len(d.KINDS)), np.int8)
    for e in events:
        for body in e.objects:
            if body in index:
                out[index[body], min(int(e.time * shape[1]), shape[1] - 1), d.KINDS.index(e.kind)] = 1
    return out


def padded(row: np.ndarray, length: int, name: str) -> np.ndarray:
    """An array of answers (…, L), longer."""
    width = [(0, 0)] * (row.ndim - 1) + [(0, length - row.shape[-1])]
    return np.pad(row, width, constant_values=d.FILL.get(name, 0))


def _joined(rows: list[Arrays]) -> Arrays:
    longest = max(len(r["ask"]) for r in rows)
    return {k: np.stack([padded(r[k], longest, k) if k in d.ANSWER_TYPES else r[k] for r in rows]) for k in rows[0]}


def stacked(examples: Sequence[Arrays]) -> Arrays:
    """Examples of one kind and number of bodies, one after another."""
    longest = max(e["ask"].shape[-1] for e in examples)
    return {
        k: np.stack([padded(e[k], longest, k) if k in d.ANSWER_TYPES else e[k] for e in examples]) for k in examples[0]
    }


def groups_of(examples: Sequence[Arrays]) -> Iterator[dict[str, Tensor]]:
    """The examples as tensors, with the first answer of each; those with equally many bodies together.

    Clips in which no body is seen are left out.
    """
    groups: dict[int, list[Arrays]] = defaultdict(list)
    for e in examples:
        if "frames" in e or len(e["places"]):
            groups[0 if "frames" in e else len(e["places"])].append(e)
    for members in groups.values():
        arrays = tensors(members)
        rows = torch.arange(len(members))
        yield chosen(arrays, rows, torch.zeros_like(rows))


def tensors(examples: Sequence[Arrays]) -> dict[str, Tensor]:
    """Examples of one kind and number of bodies, with all their answers."""
    return {k: torch.from_numpy(np.ascontiguousarray(v)) for k, v in stacked(examples).items()}


def chosen(arrays: dict[str, Tensor], rows: Tensor, which: Tensor) -> dict[str, Tensor]:
    """Examples `rows` (B,) with their answers `which` (B,), bodies in the order of the answer: a group for `losses`."""
    out: dict[str, Tensor] = {}
    if "frames" in arrays:
        out["frames"] = arrays["frames"][rows]
    else:
        order = arrays["order"][rows, which].long()
        for name in {"crops", "places", "shapes", "motion", "soon"} & arrays.keys():
            x = arrays[name][rows]
            index = order.view(*order.shape, *[1] * (x.ndim - 2)).expand(-1, -1, *x.shape[2:])
            out[name] = x.gather(1, index)
        if "shapes" in out:
            out["shapes"] = out["shapes"].long()
        out["numbers"] = arrays["numbers"][rows, which].long()
    answer = {k: arrays[k][rows, which] for k in d.ANSWER_TYPES}
    longest = int((answer["ask"] > 0).sum(1).max())
    return out | {k: v[:, :longest] if v.is_floating_point() else v[:, :longest].long() for k, v in answer.items()}
