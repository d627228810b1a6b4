"""A clip beside its replays, for the report: frames, masks and flow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.clips.replay import HEIGHT, WIDTH, replay_poses
from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.evaluation.figures import painted, tiled
from pipeline.scene.scene import Scene
from pipeline.vision.flow_picture import flow_picture

COLUMNS = 5
PICTURE = (360, 240)  # px, width and height, of a rendered replay


def clip_picture(
    frames: np.ndarray, masks: np.ndarray, flow: np.ndarray, answers: Mapping[str, Scene], schedule: Schedule
) -> np.ndarray:
    """Rows of COLUMNS moments: the input, its masks, its flow; then for each answer its replay and the replay's masks
    over the input.

    frames (F, H, W, 3) uint8; masks (F, h, w); flow (P, h, w, 2) of the model's pairs.
    """
    chosen = np.linspace(0, schedule.model_frames - 1, COLUMNS).round().astype(int)
    moments = schedule.pairs[chosen, 0]
    longest = max(float(np.abs(flow).max()), 1e-6)
    rows = [
        ("input", [frames[m] for m in moments]),
        ("masks given", [painted(frames[m], masks[m]) for m in moments]),
        ("flow measured", [flow_picture(flow[c], "wheel", longest) for c in chosen]),
    ]
    for name, scene in answers.items():
        try:
            own = replay_poses(scene, schedule)
            rows.append((f"{name}: replay", list(own.pictures("raycast", moments, *PICTURE))))
            rows.append((f"{name}: its masks over the input", [painted(frames[m], own.masks[m]) for m in moments]))
        except SimulationError:
            rows.append((f"{name}: the simulation goes bad", [np.full((HEIGHT, WIDTH, 3), 128, np.uint8)]))
    return tiled(rows)
