"""Clips as the words model sees them: masks by the network and true ones, RAFT's flow, the frames.

What is measured of a clip is kept, so that models are compared on the same.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from pipeline.bodies.found_bodies import moving_masks
from pipeline.bodies.networks import MaskNetworks, load_mask_networks
from pipeline.bodies.networks.body_shapes import shape_probabilities
from pipeline.clips.schedule import Schedule
from pipeline.inference.measured_clip import shape_network
from pipeline.model.shown import SeenBodies, SeenFrames, seen_clip
from pipeline.vision.flow.measured_flow import measured_flow
from pipeline.vision.flow.raft import RAFT, load_raft
from pipeline.vision.flow.supported_flow import supported_flow
from stages.graph.params import Params

NETWORK = Path("models/masks")
MEASURED = Path(".train/measured_clips")  # what is kept, by seed and suite


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

    def seen(
        self, frames: np.ndarray, input: str, sees: str, true_masks: bool, shape_prior: bool
    ) -> SeenBodies | SeenFrames:
        """What the model is shown.

        Args:
            frames: (P, H, W, 3) uint8, the first ones of the pairs.
            input: "flow" or "rgb".
            sees: "bodies" or "frame".
            true_masks: Whether the true masks count.
            shape_prior: Whether the network for shapes is asked about the bodies.
        """
        ids, flow = (self.true, self.flow_true) if true_masks else (self.found, self.flow_found)
        asked = shape_prior and sees == "bodies"
        prior = shape_probabilities(frames, ids, int(ids.max()), shape_network()) if asked else None
        return seen_clip(input, sees, ids, flow, frames, prior)


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


def kept(file: Path, make: Callable[[], Measured]) -> Measured:
    """What is in a file, else what `make` measures, which is written there."""
    if file.is_file():
        with np.load(file, allow_pickle=False) as stored:
            return Measured(**{name: stored[name] for name in stored.files})
    measured = make()
    file.parent.mkdir(parents=True, exist_ok=True)
    np.savez_compressed(file, **vars(measured))
    return measured
