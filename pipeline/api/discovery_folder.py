"""What the results of discoveries have in common: a report, a verdict in words, and the files of a folder."""

from __future__ import annotations

import json
from abc import abstractmethod
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from pipeline.api.result_folder import FolderResult, write_result
from pipeline.discovery.report.html_page import sentence
from pipeline.errors import ParamsError
from pipeline.inference.progress import Progress

REPORT = "report.json"
_VERSIONS = ("dynamics-pipeline", "mujoco", "numpy")

HELD_OUT = 0.3  # share of the recordings that is not fitted


class DiscoveryFolder(FolderResult):
    """A discovery that can be saved.

    Attributes:
        seconds: The time that each step took.
    """

    seconds: dict[str, float]

    @property
    @abstractmethod
    def report(self) -> dict[str, Any]:
        """The content of report.json (docs/formats.md)."""

    @property
    @abstractmethod
    def residuals(self) -> pa.Table:
        """Every measured number, and what the models before and after make of it."""

    @property
    @abstractmethod
    def asked(self) -> dict[str, Any]:
        """What was asked, for result.json."""

    @abstractmethod
    def write_pages(self, folder: Path) -> None:
        """Write report.html, the augmented model and the recording."""

    @property
    def verdict(self) -> tuple[str, ...]:
        """The effects that the scene or the model lacks: none, their names, or "unknown"."""
        return tuple(self.report["verdict"]["effects"])

    @property
    def sentence(self) -> str:
        """The verdict in words."""
        return sentence(self.report)

    def write(self, folder: Path, progress: Progress) -> None:
        """Write report.html, report.json, the augmented model, residuals.parquet, recording.rrd, times.json and
        result.json.
        """
        with progress.step("report"):
            pq.write_table(self.residuals, folder / "residuals.parquet", compression="zstd")
            self.write_pages(folder)
            text = json.dumps(self.report, indent=1, ensure_ascii=False, allow_nan=False)
            (folder / REPORT).write_text(text + "\n", encoding="utf-8")
            versions = {n: version(n) for n in _VERSIONS}
            result = {**self.asked, "verdict": self.report["verdict"], "versions": versions}
            write_result(folder, "discover", result, self.seconds)


def write_augmented(folder: Path, xml: str, forces: str | None) -> None:
    """Write augmented.xml, and augmented_forces.py where MJCF cannot say an effect."""
    (folder / "augmented.xml").write_text(xml, encoding="utf-8")
    if forces is not None:
        (folder / "augmented_forces.py").write_text(forces, encoding="utf-8")


def check_share(held_out: float) -> None:
    """Raise ParamsError for a share that leaves no clip to be fitted."""
    if not 0 <= held_out < 1:
        raise ParamsError(f"held_out is {held_out:g}; valid: a share of the clips, from 0 to less than 1")
