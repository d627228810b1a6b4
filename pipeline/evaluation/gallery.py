"""A clip beside its replays, for the report: frames, masks and flow."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pipeline.clips.schedule import Schedule
from pipeline.errors import SimulationError
from pipeline.evaluation.figures import painted, tiled
from pipeline.evaluation.scene_scores import HEIGHT, WIDTH, replay
from pipeline.physics.batch import BatchSimulator, stack_scenes
from pipeline.scene.scene import Scene
from pipeline.vision.flow.flow_picture import flow_picture
from pipeline.vision.rendering.appearance import plain_appearance
from pipeline.vision.rendering.render import render_raycast

COLUMNS = 5


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
            own = replay(scene, schedule)
            rows.append((f"{name}: replay", list(_rendered(scene, schedule, moments))))
            rows.append((f"{name}: its masks over the input", [painted(frames[m], own.masks[m]) for m in moments]))
        except SimulationError:
            rows.append((f"{name}: the simulation goes bad", [np.full((HEIGHT, WIDTH, 3), 128, np.uint8)]))
    return tiled(rows)


def _rendered(scene: Scene, schedule: Schedule, moments: np.ndarray) -> np.ndarray:
    states = BatchSimulator(scene.shapes, scene.ground is not None, 1, 1).run(
        stack_scenes([scene]), schedule.frame_steps[moments]
    )
    return render_raycast(
        scene, states.position[0], states.quaternion[0], plain_appearance(len(scene.objects)), 360, 240
    )
