"""Types of the command line's arguments, for argparse."""

from __future__ import annotations

import argparse
from math import isfinite


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


def point(text: str) -> tuple[float, ...]:
    """x,y or x,y,t."""
    return _numbers(text, (2, 3), "x,y or x,y,t")


def box(text: str) -> tuple[float, ...]:
    """x0,y0,x1,y1 or x0,y0,x1,y1,t."""
    return _numbers(text, (4, 5), "x0,y0,x1,y1 or x0,y0,x1,y1,t")


def add_prompts(parser: argparse.ArgumentParser) -> None:
    """The arguments with which the user says what is a body."""
    add = parser.add_argument
    where = (
        " (px of the video's own picture; t in s from its beginning, default: where the clip begins); may be repeated"
    )
    add("--point", type=point, action="append", default=[], metavar="X,Y[,T]", help="a body is there" + where)
    add(
        "--box",
        type=box,
        action="append",
        default=[],
        metavar="X0,Y0,X1,Y1[,T]",
        help="a body fills this box; as --point",
    )
    add("--ignore", type=point, action="append", default=[], metavar="X,Y[,T]", help="what is found there is no body")
    add("--objects", type=count, metavar="N", help="keep the N most likely bodies (default: those that are likely)")


def _numbers(text: str, lengths: tuple[int, ...], form: str) -> tuple[float, ...]:
    parts = text.split(",")
    if len(parts) not in lengths:
        raise argparse.ArgumentTypeError(f"{text!r} has {len(parts)} numbers; valid: {form}")
    return tuple(_number(part) for part in parts)


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value
