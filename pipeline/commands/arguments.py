"""Types of the command line's arguments, for argparse."""

from __future__ import annotations

import argparse
import re
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


def length(text: str) -> tuple[float, ...]:
    """x0,y0,x1,y1=M: four px and metres."""
    ends, equals, metres = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: x0,y0,x1,y1=M, px of the video's own picture and metres")
    return (*_numbers(ends, (4,), "x0,y0,x1,y1=M"), positive(metres))


def size(text: str) -> tuple[int, str, float]:
    """BODY.KEY=M: the number at the end of the body's name, what is known, and metres."""
    found = re.fullmatch(r"(?:[A-Za-z]+_)?(\d+)\.(radius|width|height)=(.+)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: sphere_0.radius=0.033, with radius, width or height, in m")
    return int(found[1]), found[2], positive(found[3])


def add_world(parser: argparse.ArgumentParser) -> None:
    """The arguments with which the user says what is known of the world that was filmed."""
    add = parser.add_argument
    add(
        "--view",
        choices=("auto", "table", "side", "incline", "flight", "top"),
        default="auto",
        help="how the camera sees the world: a table from above and aside, from the side, an incline from the side, "
        "a throw or fall, straight from above (auto: what the tracks tell)",
    )
    add("--gravity", type=positive, default=9.81, metavar="G", help="gravity, m/s² (9.81)")
    known = parser.add_mutually_exclusive_group()
    known.add_argument(
        "--length",
        type=length,
        metavar="X0,Y0,X1,Y1=M",
        help="two points of the video's own picture, px, in the plane of motion, and their distance, m",
    )
    known.add_argument(
        "--size", type=size, metavar="BODY.KEY=M", help="a known size of a body, m: sphere_0.radius=0.033"
    )


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
