"""A short clip of two bodies, drawn by our ray caster, as files; and a very small model that has learned nothing."""

from fractions import Fraction
from functools import cache
from pathlib import Path

import av
import numpy as np

from pipeline.clips.replay import Replay, replay
from pipeline.clips.schedule import Schedule
from pipeline.model.model_input import ModelInput
from pipeline.physics.trace import Trace
from pipeline.scene.scene import Scene
from pipeline.scene.text import read_scene
from pipeline.vision.recordings.video import write_video

WIDTH, HEIGHT = 240, 160
SCHEDULE = Schedule()
INPUT = ModelInput(
    input="flow", picture="channels", flow_source="exact", flow_size=(240, 160), flow_iterations=4, reasoning=True
)
TEXT = """\
camera: {position: [0.0, -2.0, 0.7], pitch: -18.0, fov: 38.0}
gravity: 9.81
ground: {height: 0.0}
objects:
- name: ball
  shape: sphere
  radius: 0.15
  mass: 1.0
  sliding_friction: 0.6
  rolling_friction: 0.0
  damping: 0.7
  position: [-0.5, 0.0, 0.15]
  velocity: [1.0, 0.0, 0.0]
  angular_velocity: [0.0, 6.67, 0.0]
  orientation: [1.0, 0.0, 0.0, 0.0]
- name: crate
  shape: box
  width: 0.2
  depth: 0.2
  height: 0.25
  mass: 0.5
  sliding_friction: 0.3
  rolling_friction: 0.0
  damping: 0.9
  position: [0.35, 0.3, 0.5]
  velocity: [-0.4, 0.0, 0.0]
  angular_velocity: [0.0, 0.0, 1.0]
  orientation: [1.0, 0.0, 0.0, 0.0]
effects: []
"""


@cache
def scene() -> Scene:
    return read_scene(TEXT)


@cache
def run() -> Replay:
    return replay(scene(), SCHEDULE, WIDTH, HEIGHT)


def trace() -> Trace:
    made = run().trace
    assert made is not None
    return made


@cache
def frames() -> np.ndarray:
    """(30, H, W, 3) uint8."""
    return run().pictures("raycast")


def masks() -> np.ndarray:
    """(30, H, W) uint8."""
    return run().masks


def write(path: Path, pictures: np.ndarray | None = None) -> Path:
    write_video(path, frames() if pictures is None else pictures)
    return path


def write_uneven(path: Path) -> Path:
    """The clip at a variable frame rate: every third frame is missing."""
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=Fraction(30), options={"crf": "18"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.codec_context.time_base = Fraction(1, 30)
        for k, picture in enumerate(frames()):
            if k % 3 != 1:
                frame = av.VideoFrame.from_ndarray(picture, format="rgb24")
                frame.pts, frame.time_base = k, Fraction(1, 30)
                container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def write_model(folder: Path, model_input: ModelInput | None = None) -> Path:
    """A Qwen2.5-VL of some thousand parameters with random weights."""
    from small_tokenizer import build_tokenizer
    from tiny_qwen import TinySize, build_tiny

    from pipeline.model.base import Base
    from pipeline.model.language.codec import Codec
    from pipeline.model.patches import PatchLayout

    tokenizer = build_tokenizer()
    size = TinySize(
        hidden=24,
        layers=1,
        heads=2,
        intermediate=32,
        vision_hidden=32,
        vision_depth=1,
        vision_heads=2,
        vision_intermediate=32,
    )
    layout = PatchLayout(96, 64, SCHEDULE.model_frames, patch=16, mean=(0.5, 0.5, 0.5), std=(0.5, 0.5, 0.5))
    codec = Codec(tokenizer, layout.tokens)
    Base(build_tiny(tokenizer, size, 1), tokenizer, layout, codec, model_input or INPUT).save(folder)
    return folder
