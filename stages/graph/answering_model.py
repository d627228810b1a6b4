"""Which checkpoint answers: the fine-tuned one, or the one that preference optimisation made of it.

`prefer` writes it down in data/prefer, so that nothing is copied where it is not enabled, and with it which clips it
has used: scores on these say nothing about others.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pipeline.errors import ShardError
from pipeline.shards.contents import check_contents
from stages.graph.run import DATA

FOLDER = DATA / "prefer"
FILE = "answering_model.json"
CURVE = "curve.csv"  # of the optimisation; a header alone where there was none
FINETUNED = DATA / "finetune" / "model"
PREFERRED = FOLDER / "model"


@dataclass(frozen=True)
class AnsweringModel:
    """preferred: whether the optimisation made it; used: the clips of `suite` that it has seen."""

    preferred: bool
    suite: str | None = None
    used: tuple[int, ...] = ()

    @property
    def folder(self) -> Path:
        return PREFERRED if self.preferred else FINETUNED

    def has_used(self, suite: str, clip: int) -> bool:
        return suite == self.suite and clip in self.used

    def write(self, folder: Path) -> None:
        (folder / FILE).write_text(json.dumps(asdict(self), indent=1) + "\n")


def answering_model(folder: Path = FOLDER) -> AnsweringModel:
    """What `prefer` wrote down. Raises ShardError where it has not run, or is damaged."""
    file = folder / FILE
    if not file.is_file():
        raise ShardError(f"{file} is missing; `dvc repro` makes it, or `dvc checkout` brings it back")
    check_contents(folder)
    stored = json.loads(file.read_text())
    return AnsweringModel(stored["preferred"], stored["suite"], tuple(stored["used"]))


def split_clips(rng: np.random.Generator, clips: int, used: int) -> tuple[int, ...]:
    """Which of so many clips the optimisation may use, in order; all others are for the evaluation."""
    return tuple(sorted(rng.permutation(clips)[:used].tolist()))
