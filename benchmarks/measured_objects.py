"""Clips as a model of objects sees them: frames rendered with random looks, masks by the network and true, RAFT's flow.

The clips are those that the graph draws for a seed and a suite. What is measured of a clip is kept, so that models are
compared on the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.clips.view import frame_masks
from pipeline.inference.measured_clip import shape_network
from pipeline.model.instances import Instances, instances_of
from pipeline.perception.found_bodies import moving_masks
from pipeline.physics.simulate import simulate
from pipeline.scene.scene import Scene
from pipeline.segmentation import MaskNetworks, load_mask_networks
from pipeline.segmentation.body_shapes import shape_probabilities
from pipeline.shards.clip_rng import clip_rng
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT, load_raft
from pipeline.vision.flow.supported_flow import supported_flow
from pipeline.vision.rendering.render_backend import choose_backend
from stages.graph.params import Params
from stages.render import Pictures
from training.drawn_scenes import drawn_scenes

NETWORK = Path("models/masks")
MEASURED = Path(".train/measured_objects")  # what is kept, by seed and suite


@dataclass(frozen=True)
class Measured:
    """What is known of a clip.

    Attributes:
        true: (P, H, W) uint8, true masks of the first frames of the model's pairs.
        found: (P, H, W) uint8, masks by the network.
        flow_true: (P, H, W, 2), RAFT's flow, filled in with the true masks.
        flow_found: Likewise with those of the network.
    """

    true: np.ndarray
    found: np.ndarray
    flow_true: np.ndarray
    flow_found: np.ndarray

    def instances(self, masks: str, frames: np.ndarray | None = None) -> Instances:
        """What the model sees; masks: "true" or "found". frames: (P, H, W, 3) uint8, in which the network for shapes
        sees the bodies; None: it is not asked."""
        ids, flow = (self.true, self.flow_true) if masks == "true" else (self.found, self.flow_found)
        prior = None if frames is None else shape_probabilities(frames, ids, int(ids.max()), shape_network())
        return instances_of(ids, flow, prior)


@lru_cache(maxsize=1)
def _networks(raft: str) -> tuple[MaskNetworks, RAFT]:
    return load_mask_networks(NETWORK), load_raft(raft)


def measure(frames: np.ndarray, masks: np.ndarray, times: np.ndarray, schedule: Schedule, params: Params) -> Measured:
    """Measure a clip.

    Args:
        frames: (F, H, W, 3) uint8.
        masks: (F, H, W) uint8, the true ones.
        times: (F,) s, when each frame was recorded.
        schedule: Which pairs of them the model sees.
        params: All parameters of the experiment.
    """
    f, pairs, interval = params.flow, schedule.pairs, 1 / schedule.fps
    size = (f.width, f.height)
    networks, raft = _networks(f.raft)
    found = moving_masks(frames, times, networks)
    raw = measured_flow(raft, frames, times, pairs, interval, f.iterations, size)

    def filled(ids: np.ndarray) -> np.ndarray:
        return supported_flow(raw, frames, ids, times, pairs, interval=interval, size=size).flow.astype(np.float16)

    seen = pairs[:, 0]
    return Measured(masks[seen], found[seen], filled(masks), filled(found))


def measured_clip(scene: Scene, suite: str, clip: int, params: Params) -> Measured:
    """What is measured of a sampled clip, rendered as the graph renders it.

    Args:
        scene: Of the clip.
        suite: Of the clip.
        clip: Its index.
        params: All parameters of the experiment, with the seed of the clips.
    """
    schedule, r = params.clip.schedule, params.render
    size = (r.width, r.height)
    trace = simulate(scene, schedule.seconds)
    settings = r.model_dump(exclude={"width", "height"}) | {"backend": choose_backend(r.backend)[0]}
    looks = clip_rng(params.seed, suite, clip, "appearance")
    frames = Pictures(seed=params.seed, **settings).render(scene, trace, schedule, size, looks)
    masks = frame_masks(scene, trace, schedule, *size)
    return measure(frames, masks, np.arange(len(frames)) / schedule.fps, schedule, params)


def kept(file: Path, make: Callable[[], Measured]) -> Measured:
    """What is in a file, else what `make` measures, which is written there."""
    if file.is_file():
        with np.load(file, allow_pickle=False) as stored:
            return Measured(**{name: stored[name] for name in stored.files})
    measured = make()
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(file, **vars(measured))
    return measured


def suite_scenes(params: Params, suite: str, clips: int) -> list[Scene]:
    """The first scenes that the graph draws for a suite."""
    own = getattr(params.suites, suite)
    return drawn_scenes(params, params.seed, suite, range(clips), own.objects, own.without, own.only)
