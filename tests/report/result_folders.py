"""Small folders as `dynamics infer` writes them, as far as a page reads them."""

import json
from pathlib import Path
from typing import Any

import small_clip

from pipeline.editing.filmed_clip import CLIP, FilmedClip, write_clip

INFER: dict[str, Any] = {
    "command": "infer",
    "clip": "clips/rolling <b>ball</b></script>.mp4",
    "grade": "good",
    "grade_reason": "the forecast is better than at constant velocity",
    "forecast": {"from_s": 0.7, "iou": 0.9, "constant_velocity_iou": None},
    "view": {"kind": "table", "reason": "bodies are larger where they are lower"},
    "assumed": {"scale": "lengths are relative"},
    "answer": {"from": "search", "events_of_replay": ["t=0.10s: ball hits crate"], "doubts": ["a hand is in view"]},
    "methods": [
        {"method": "search", "composition": "box+sphere", "sequence_iou": 0.9, "epe_frame_px": None, "simulations": 9}
    ],
    "certainty": [{"place": "objects[0].mass", "determined": False}],
    "files": [],
}


def write_inferred(folder: Path, result: dict[str, Any] = INFER) -> Path:
    """A folder with clip, scene and result."""
    folder.mkdir(parents=True)
    (folder / "scene.yaml").write_text(small_clip.TEXT)
    write_clip(folder / CLIP, FilmedClip(small_clip.frames(), small_clip.masks(), small_clip.SCHEDULE.times))
    (folder / "result.json").write_text(json.dumps(result))
    return folder
