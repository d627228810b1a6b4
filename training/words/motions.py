"""Motions of sampled scenes, in compact files: made once with MuJoCo, seen by any camera afterwards.

    python -m training.words.motions OUT [--seed 1] [--first 0] [--files 20] [--worker 0 --workers 1]

A file has FILE motions. Positions are steps of 0.2 mm, quaternions of 1/32767; of both the second differences are
stored. Reading needs NumPy alone.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.clips.events import KINDS, Event

FILE = 500
SUITE = "words-training"
STEP_M, STEP_Q = 2e-4, 1 / 32767
#: Weights of the numbers of bodies. The parameters' suite `train` says which compositions are never drawn.
OBJECTS = {1: 0.2, 2: 0.27, 3: 0.28, 4: 0.25}


@dataclass(frozen=True)
class Motion:
    """What happens, whoever looks.

    Attributes:
        shapes: (N,) int8 index of the basic shape.
        values: (N, 20) float32: sizes (3), mass, sliding friction, rolling friction, damping, position (3), orientation
            (4), velocity (3) and angular velocity (3).
        gravity: m/s².
        position: (F, N, 3) m.
        quaternion: (F, N, 4).
        events: All physical ones, in order of time, seen or not.
    """

    shapes: np.ndarray
    values: np.ndarray
    gravity: float
    position: np.ndarray
    quaternion: np.ndarray
    events: list[Event]


#: Columns of `values`.
SIZE, MASS, SLIDING, ROLLING, DAMPING, PLACE, TURN, VELOCITY, SPIN = 0, 3, 4, 5, 6, 7, 10, 14, 17


def _packed(values: np.ndarray, step: float) -> np.ndarray:
    """int16 second differences along the last axis of values in multiples of `step`, which wrap around."""
    units = np.clip(np.rint(values / step), -32767, 32767).astype(np.int16)
    return np.diff(units, 2, prepend=np.zeros((*units.shape[:-1], 2), np.int16))


def _unpacked(packed: np.ndarray, step: float) -> np.ndarray:
    units = np.cumsum(np.cumsum(packed, -1, dtype=np.int16), -1, dtype=np.int16)
    return units.astype(np.float64) * step


def write_motions(motions: list[Motion], path: Path) -> None:
    """Write a file, whole or not at all."""
    events = [
        (k, round(e.time * 240), KINDS.index(e.kind), e.first, -1 if e.second is None else e.second)
        for k, m in enumerate(motions)
        for e in m.events
    ]
    position = np.concatenate([m.position.transpose(1, 2, 0) for m in motions])  # (bodies, 3, F)
    quaternion = np.concatenate([m.quaternion.transpose(1, 2, 0) for m in motions])
    arrays: dict[str, Any] = {
        "count": np.array([len(m.shapes) for m in motions], np.int8),
        "gravity": np.array([m.gravity for m in motions], np.float32),
        "shapes": np.concatenate([m.shapes for m in motions]),
        "values": np.concatenate([m.values for m in motions]).astype(np.float32),
        "events": np.array(events, np.int16).reshape(-1, 5),
    }
    for name, packed in (("position", _packed(position, STEP_M)), ("quaternion", _packed(quaternion, STEP_Q))):
        planes = packed.view(np.uint8).reshape(*packed.shape, 2)
        arrays[name + "_low"], arrays[name + "_high"] = (np.ascontiguousarray(planes[..., k]) for k in (0, 1))
    part = path.with_suffix(".part.npz")
    np.savez_compressed(part, **arrays)
    part.rename(path)


def read_motions(path: Path) -> list[Motion]:
    """The motions of a file."""
    with np.load(path) as stored:
        arrays = dict(stored)
    tracks = {}
    for name, step in (("position", STEP_M), ("quaternion", STEP_Q)):
        packed = np.stack([arrays[name + "_low"], arrays[name + "_high"]], -1).view(np.int16)[..., 0]
        tracks[name] = _unpacked(packed, step)
    start = np.concatenate([[0], np.cumsum(arrays["count"])])
    at = np.searchsorted(arrays["events"][:, 0], np.arange(len(arrays["count"]) + 1))
    motions = []
    for k in range(len(arrays["count"])):
        rows = slice(start[k], start[k + 1])
        events = [
            Event(float(t / 240), KINDS[kind], int(first), None if second < 0 else int(second))
            for _, t, kind, first, second in arrays["events"][at[k] : at[k + 1]]
        ]
        motions.append(
            Motion(
                arrays["shapes"][rows],
                arrays["values"][rows],
                float(arrays["gravity"][k]),
                np.ascontiguousarray(tracks["position"][rows].transpose(2, 0, 1)),
                np.ascontiguousarray(tracks["quaternion"][rows].transpose(2, 0, 1)),
                events,
            )
        )
    return motions


def drawn_motions(params, seed: int, suite: str, indices: range, objects=OBJECTS, without=()) -> list[Motion]:
    """Motions of scenes drawn as those of the suites; those whose simulation fails are left out."""
    from pipeline.clips.events import Thresholds, physical_events
    from pipeline.errors import SimulationError
    from pipeline.physics.batch import scene_model
    from pipeline.physics.simulate import simulate_model
    from training.drawn_scenes import drawn_scenes

    schedule = params.clip.schedule
    thresholds = Thresholds(**params.events.model_dump(), visible_px=params.sample.filters.visible_px)
    motions = []
    for scene in drawn_scenes(params, seed, suite, indices, objects, without):
        try:
            trace = simulate_model(scene_model(scene), schedule.seconds)
        except SimulationError:
            continue
        motions.append(motion_of(scene, trace, schedule, physical_events(trace, scene.shapes, thresholds)))
    return motions


def motion_of(scene, trace, schedule, events) -> Motion:
    """The motion of a simulated scene."""
    from pipeline.scene.scene import BASIC_SHAPES

    values = np.array(
        [
            [
                *[*o.size, 0.0, 0.0][:3],
                *(o.mass, o.sliding_friction, o.rolling_friction, o.damping),
                *o.position,
                *o.orientation,
                *o.velocity,
                *o.angular_velocity,
            ]
            for o in scene.objects
        ],
        np.float32,
    )
    steps = schedule.frame_steps
    shapes = np.array([BASIC_SHAPES.index(s) for s in scene.shapes], np.int8)
    return Motion(shapes, values, -scene.gravity[2], trace.position[steps], trace.quaternion[steps], events)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path, help="folder of the files")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--first", type=int, default=0, help="number of the first file")
    parser.add_argument("--files", type=int, default=20)
    parser.add_argument("--worker", type=int, default=0)
    parser.add_argument("--workers", type=int, default=1)
    asked = parser.parse_args()
    from stages.graph.params import PARAMS_FILE, Params
    from stages.graph.params_file import read_params_file

    params = read_params_file(PARAMS_FILE, Params)
    asked.out.mkdir(parents=True, exist_ok=True)
    for file in range(asked.first + asked.worker, asked.first + asked.files, asked.workers):
        path = asked.out / f"{file:05d}.npz"
        if path.exists():
            continue
        began = time.perf_counter()
        indices = range(file * FILE, (file + 1) * FILE)
        motions = drawn_motions(params, asked.seed, SUITE, indices, OBJECTS, params.suites.train.without)
        write_motions(motions, path)
        print(
            f"{path.name}: {len(motions) / (time.perf_counter() - began):.0f} motions/s, {path.stat().st_size} B",
            flush=True,
        )


if __name__ == "__main__":
    main()
