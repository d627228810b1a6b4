"""Types of the words on the command line, for argparse."""

from __future__ import annotations

import argparse
from math import isfinite
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def positive(text: str) -> float:
    """A finite number greater than 0."""
    value = _number(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f"{text} is not greater than 0")
    return value


def share(text: str) -> float:
    """A number greater than 0 and at most 1."""
    value = positive(text)
    if value > 1:
        raise argparse.ArgumentTypeError(f"{text} is greater than 1")
    return value


def count(text: str) -> int:
    """A whole number, 0 or more."""
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number, 0 or more")
    return int(text)


def existing_or_shipped(name: str) -> str:
    """A path as given; where it is not there from here, the same path in this project (models/tiny), if it is there."""
    if not Path(name).exists() and not Path(name).is_absolute() and (ROOT / name).exists():
        return str(ROOT / name)
    return name


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value
