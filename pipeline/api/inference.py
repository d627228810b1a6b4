"""What `pipeline.infer` found, and what it was asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from pipeline.api.result_folder import FolderResult
from pipeline.bodies.prompts import Prompts
from pipeline.clips.replay import Replay, replay
from pipeline.inference.asking import Question, estimation_size, input_of
from pipeline.inference.filmed_world import World
from pipeline.inference.find_scenes import FoundScenes, SearchBudget
from pipeline.inference.measure_clip import FlowSource
from pipeline.inference.measured_clip import MeasuredClip
from pipeline.inference.method import TRACKS, Method, steady_line_doubt
from pipeline.inference.progress import Progress
from pipeline.inference.trust import Grade, grade
from pipeline.scene.joint import span
from pipeline.scene.scene import Scene
from pipeline.vision.recordings.corrections import Correction
from pipeline.worlds.scale import KNOWN, Scale

if TYPE_CHECKING:
    from pipeline.model.base import Base
    from pipeline.model.words_model import WordsModel


@dataclass(frozen=True)
class Settings:
    """What `infer` was asked for; see there."""

    start: float | None
    seconds: float | None
    fps: float | None
    prompts: Prompts
    correction: Correction
    world: World
    flow: FlowSource
    question: Question
    search: SearchBudget


@dataclass(frozen=True)
class Inference(FolderResult):
    """What `infer` found.

    Attributes:
        name: Of the clip.
        clip: What was measured.
        settings: What was asked for.
        base: The model.
        scenes: The model's answers, and the scene that each method found.
        seconds: The time that each step took.
        files: Writes the files.
    """

    name: str
    clip: MeasuredClip
    settings: Settings
    base: Base | WordsModel
    scenes: FoundScenes
    seconds: dict[str, float]
    files: Callable[[Path, Inference, Progress], None]

    @property
    def best(self) -> Method:
        """The method with the highest reward."""
        return self.scenes.best

    @property
    def methods(self) -> tuple[Method, ...]:
        """Each way to a scene, in the order in which they were tried."""
        return self.scenes.methods

    @property
    def scene(self) -> Scene:
        return self.best.scene

    @property
    def flow_size(self) -> tuple[int, int]:
        """px, width and height, at which the flow was measured."""
        return estimation_size(self.clip.taken.clip, input_of(self.base))

    @property
    def grade(self) -> Grade:
        """How far the answer can be trusted."""
        return grade(self.best.overlap.sequence, self.scenes.forecast)

    @property
    def scale(self) -> Scale | None:
        """The scale of the tracks, where they are the answer."""
        answer = self.scenes.filmed.answer
        return answer.scale if answer and self.best.name == TRACKS else None

    @property
    def measured_gravity(self) -> float | None:
        """m/s², where bodies fall or swing and a length is known, so that the motion tells it; else None."""
        falls = self.scenes.filmed.motion.view.gravity_px is not None
        if self.scale is None or self.scale.by not in KNOWN or not falls:
            return None
        return float(np.linalg.norm(self.scene.gravity))

    @property
    def metric(self) -> str:
        """What fixed the scale: "gravity", "length", "size", "board" or "none"."""
        return "none" if self.scale is None else self.scale.by

    @property
    def joints(self) -> list[str]:
        """What holds the bodies, a sentence each."""
        return [
            f"{o.name} hangs on a {o.joint.kind} of {span(o, o.joint):.3g} m; damping of the joint: "
            f"{o.joint.damping / o.mass:.2g} N m s/rad for each kg"
            for o in self.scene.objects
            if o.joint is not None
        ]

    @property
    def doubts(self) -> list[str]:
        """Why the answer should not be relied on."""
        filmed = self.scenes.filmed
        steady = steady_line_doubt(filmed.motion.view, self.settings.world)
        return [*self.clip.taken.doubts, *filmed.doubts, *([] if steady is None else [steady])]

    def replay(self) -> Replay:
        """The scene, run over the clip."""
        return replay(self.scene, self.clip.schedule, *self.clip.taken.clip.letterbox.size)

    def write(self, folder: Path, progress: Progress) -> None:
        """Write scene.yaml, scene.xml, replay.mp4, overlay.png, masks.png, recording.rrd and result.json."""
        self.files(folder, self, progress)
