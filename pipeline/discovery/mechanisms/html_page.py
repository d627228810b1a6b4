"""report.html for a mechanism: the discovery as one self-contained page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pyarrow as pa

from pipeline.discovery.mechanisms.discovery import MechanismDiscovery
from pipeline.discovery.mechanisms.figures import motion_figure, residual_figure
from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.discovery.report.html_page import (
    TITLE,
    disagreement_table,
    parameter_table,
    sentence,
    verdict_sections,
)
from pipeline.report.written_report import Section, drawing, page


def mechanism_page(
    found: MechanismDiscovery, report: Mapping[str, Any], table: pa.Table, facts: Mapping[str, str]
) -> str:
    """The page as HTML, with all figures in it.

    Args:
        found: The discovery.
        report: Its content of report.json.
        table: Its `residual_table`.
        facts: What was read and asked, shown at the top.
    """
    where = report["where"]
    place = (
        "Nowhere." if where is None else f"At {', '.join(where['objects'])}, in {where['share']:.0%} of the windows."
    )
    sections = [
        Section("Where they disagree", place, disagreement_table(report)),
        *verdict_sections(found.verdict, found.selection, report, mechanism_effects()),
        Section("Motion", "Measured and predicted. Grey: not fitted.", drawing(motion_figure(table), "over time")),
        Section("Residuals", "Measured minus predicted.", drawing(residual_figure(table), "over time")),
        Section("Calibrated", "Numbers of the model that were not known.", parameter_table(found.calibrated)),
        Section("Notes", "", "".join(f"<p>{note}</p>" for note in report["notes"])),
    ]
    return page(TITLE, sentence(report), facts, sections)
