"""Faults of a measurement: what is wrong with a recording, not with the physics."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Fault:
    """One fault, as `faults` in report.json has it (docs/formats.md).

    Attributes:
        fault: `recording_scale`, `bumped_camera`, `dropped_frames`, `swapped_names`, `correlated_noise` or `outliers`.
        size: In `unit`.
        unit: "-" for a ratio, "m", "frames", "samples".
        clip: Which recording; None: all.
        object: Which object; None: all of the recording.
        time: s, on the recording's own clock; None: throughout.
    """

    fault: str
    size: float
    unit: str
    clip: str | None = None
    object: str | None = None
    time: float | None = None
