"""`pipeline.discover` for a user's own MuJoCo model: which law it lacks, from a log of the real mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from pipeline.api.discovery_folder import DiscoveryFolder, check_share, write_augmented
from pipeline.discovery.mechanisms.augmented import augmented_document, augmented_forces
from pipeline.discovery.mechanisms.discovery import MechanismDiscovery, discover_mechanism
from pipeline.discovery.mechanisms.html_page import mechanism_page
from pipeline.discovery.mechanisms.log import read_log
from pipeline.discovery.mechanisms.mechanism import Mechanism, read_mechanism
from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.discovery.mechanisms.residual_table import residual_table
from pipeline.discovery.selection.testable import names_among
from pipeline.inference.progress import Progress
from pipeline.viewer.logged import save_logged

MODEL = ".xml"


@dataclass(frozen=True)
class LogDiscoveryResult(DiscoveryFolder):
    """What `discover_log` found.

    Attributes:
        log: Where the motion is from.
        mechanism: The user's model.
        held_out: Share of the clips, or of the only one's time, that was not fitted.
        fit: Numbers of the model that were not known.
        effects: Which might be named.
        seed: That chose the clips held out.
        found: Everything that was computed.
        seconds: The time that each step took.
    """

    log: str
    mechanism: Mechanism
    held_out: float
    fit: tuple[str, ...]
    effects: str
    seed: int
    found: MechanismDiscovery
    seconds: dict[str, float]

    @cached_property
    def report(self) -> dict[str, Any]:
        """The content of report.json (docs/formats.md)."""
        return self.found.report()

    @cached_property
    def model_xml(self) -> str:
        """The model with what it lacked, as MJCF."""
        selection = self.found.selection
        document = augmented_document(self.mechanism, selection.answer, selection.stated_steps)
        document.compile()
        return str(document.to_xml())

    @cached_property
    def residuals(self) -> pa.Table:
        """Every measured number, and what the models before and after make of it."""
        return residual_table(self.found.selection.none, self.found.selection.answer)

    @property
    def asked(self) -> dict[str, Any]:
        """What was asked, for result.json."""
        return {
            "measured": self.log,
            "model": str(self.mechanism.path),
            "held_out": self.held_out,
            "fit": list(self.fit),
            "effects": self.effects,
            "seed": self.seed,
        }

    def write_pages(self, folder: Path) -> None:
        """Write report.html, the augmented model and the recording."""
        facts = {
            "log": self.log,
            "model": str(self.mechanism.path),
            "clips": str(len(self.found.problem.log.clips)),
            "held out": ", ".join(self.report["clips"]["held_out"]) or "none",
            "not known": ", ".join(self.fit) or "nothing",
            "seed": str(self.seed),
        }
        page = mechanism_page(self.found, self.report, self.residuals, facts)
        (folder / "report.html").write_text(page, encoding="utf-8")
        write_augmented(folder, self.model_xml, augmented_forces(self.found.selection.answer))
        save_logged(self.residuals, Path(self.log).stem, self.sentence, folder / "recording.rrd")


def discover_log(
    log: str | Path,
    model: str | Path,
    *,
    held_out: float,
    fit: Sequence[str],
    effects: str,
    seed: int,
    progress: Progress,
) -> LogDiscoveryResult:
    """Find out which law a user's own MuJoCo model lacks.

    Args:
        log: Of the real mechanism: Parquet, CSV or other text (docs/formats.md, "Logs of mechanisms").
        model: The model, MJCF. Nothing in it is executed.
        held_out: Share of the clips, or of the time of the only one, that is not fitted, for judging.
        fit: Numbers of the model that are not known, such as "elbow.damping" or "joint.damping" of all.
        effects: Which may be named: "all", or names with commas between.
        seed: Chooses the clips that are held out.
        progress: Told of each step.

    Returns:
        The verdict with its reasons, and the model with what it lacked.

    Raises:
        MeasurementError: For a log that cannot be used, or does not fit the model.
        SceneError: For a model that cannot be read.
        ParamsError: For another argument that is not valid.
    """
    check_share(held_out)
    names = names_among(effects, mechanism_effects(), "effects")
    mechanism = read_mechanism(Path(model))
    measured = read_log(Path(log), mechanism)
    with progress.step("discover"):
        rng = np.random.default_rng(seed)
        found = discover_mechanism(measured, mechanism, held_out, names, fit, rng, progress=progress.detail)
    return LogDiscoveryResult(
        log=str(log),
        mechanism=mechanism,
        held_out=held_out,
        fit=tuple(fit),
        effects=effects,
        seed=seed,
        found=found,
        seconds=progress.seconds,
    )
