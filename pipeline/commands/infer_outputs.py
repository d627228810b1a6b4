"""The files that `dynamics infer` writes beside result.json."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.commands.clip_input import ClipInput
from pipeline.commands.lettering import side_by_side
from pipeline.commands.overlay import Sheet, draw
from pipeline.commands.replay import Replay, pictures
from pipeline.commands.scoring import relabelled
from pipeline.commands.table import Row, markdown
from pipeline.scene.mjcf import scene_xml
from pipeline.scene.text import write_scene
from pipeline.viewer.footage import Footage, MotionLayer, Pictures
from pipeline.viewer.recording import save
from pipeline.vision.recordings.video import write_video
from pipeline.vision.rendering.render_backend import choose_backend


@dataclass(frozen=True)
class Outcome:
    """What came out: a title, a table of the methods, the clip, the replay of the best scene, which object belongs to
    which instance of the clip's masks (P, 2), the model's own words, and notes on what was assumed or is in doubt."""

    name: str
    title: str
    rows: tuple[Row, ...]
    clip: ClipInput
    run: Replay
    pairs: np.ndarray
    think: str
    notes: tuple[str, ...]


def write_outputs(folder: Path, outcome: Outcome) -> str:
    """Write scene.yaml, scene.xml, replay.mp4, overlay.png, recording.rrd; returns which renderer made the pictures."""
    clip, run = outcome.clip, outcome.run
    (folder / "scene.yaml").write_text(write_scene(run.scene), encoding="utf-8")
    (folder / "scene.xml").write_text(scene_xml(run.scene), encoding="utf-8")
    backend, reason = choose_backend("auto")
    drawn = pictures(run.scene, run.trace, clip.schedule, backend)
    frames, first = clip.taken.clip.frames, clip.schedule.pairs[:, 0]
    write_video(folder / "replay.mp4", side_by_side(frames, drawn, ("input", "replay")), clip.schedule.fps)
    masks = relabelled(clip.taken.masks, outcome.pairs, len(run.scene.objects))
    start = float(clip.taken.clip.source_times[0])
    sheet = Sheet(first, clip.schedule.fps, start, frames, drawn, masks, run.masks, clip.flow, run.flow,
                  tuple(o.name for o in run.scene.objects), outcome.title, outcome.rows)  # fmt: skip
    Image.fromarray(draw(sheet)).save(folder / "overlay.png")
    seen = Pictures(frames, masks, flow=clip.flow, flow_frames=first)
    replayed = Pictures(drawn, run.masks, run.depth, first, run.flow, first)
    notes = "\n".join([f"### {outcome.title}", "", *markdown(outcome.rows), "", *(f"- {n}" for n in outcome.notes), "",
                       "**The model's words**", "", *outcome.think.splitlines()])  # fmt: skip
    motion = MotionLayer("replay", run.scene, run.trace, True, run.events)
    save(Footage(outcome.name, notes, (motion,), seen, replayed, clip.schedule.fps), folder / "recording.rrd")
    return reason
