"""What a table has of one body: times and coordinates as they stand in the file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

COORDINATES = ("x", "y", "z")


@dataclass(frozen=True)
class Piece:
    """T rows of one body in one recording, in order. A missing number is NaN.

    Attributes:
        label: What the header calls the body or the recording; empty where it says nothing.
        clip: The recording, where a column has it.
        object: The body, where a column has it.
        time: (T,) in `time_unit`, or frames.
        numbers: Column -> (T,): the coordinates x, y, z that are there, or `along` alone; quaternions, spins, sigma.
        lines: (T,) line of the file.
        time_unit: A unit of time, "frame" for frames; empty where the file does not say.
        unit: A unit of length or px; empty where the file does not say.
        rate: Frames per second, where the file says it.
    """

    label: str
    clip: str
    object: str
    time: np.ndarray
    numbers: dict[str, np.ndarray]
    lines: np.ndarray
    time_unit: str = ""
    unit: str = ""
    rate: float | None = None
