"""Types of the command line's arguments, for argparse."""

from __future__ import annotations

import argparse
import re
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pipeline.editing.edit_list import Edit


def positive(text: str) -> float:
    """A finite number greater than 0."""
    value = number(text)
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


def start(text: str) -> float | None:
    """auto, or a number of seconds."""
    return None if text == "auto" else number(text)


def add_stretch(parser: argparse.ArgumentParser) -> None:
    """The arguments that say which part of a video is the clip."""
    add = parser.add_argument
    add(
        "--start",
        type=start,
        metavar="S",
        help="where the clip begins in the video, s (auto: of a video of more than 1.2 s, where bodies move freely and "
        "no hand holds one; of masks, where they begin)",
    )
    add(
        "--seconds",
        type=positive,
        metavar="S",
        help="its length, s (as long as bodies move freely, at most 12; 1 where --start is given)",
    )


def add_corrections(parser: argparse.ArgumentParser) -> None:
    """The arguments that ask for corrections of frames."""
    add = parser.add_argument
    said = "; px elsewhere are those of the corrected picture"
    add(
        "--distortion",
        type=number,
        default=0.0,
        metavar="K",
        help="correct the lens: what is at the picture's corner is seen at 1 + K of its distance from the centre "
        f"(barrel: K < 0){said}",
    )
    add("--steady", action="store_true", help=f"remove the camera's small shake, by the background{said}")


def length(text: str) -> tuple[float, ...]:
    """x0,y0,x1,y1=M: four px and metres."""
    ends, equals, metres = text.partition("=")
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: x0,y0,x1,y1=M, px of the video's own picture and metres")
    return (*_numbers(ends, (4,), "x0,y0,x1,y1=M"), positive(metres))


def table_length(text: str) -> tuple[float, ...]:
    """x0,y0,x1,y1=M or N=M: four or one number in a table's unit, and metres."""
    ends, equals, metres = text.partition("=")
    form = "X0,Y0,X1,Y1=M, two points in the table's unit and their distance in m, or N=M"
    if not equals:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: {form}")
    return (*_numbers(ends, (1, 4), form), positive(metres))


def size(text: str) -> tuple[int, str, float]:
    """BODY.KEY=M: the number at the end of the body's name, what is known, and metres."""
    found = re.fullmatch(r"(?:[A-Za-z]+_)?(\d+)\.(radius|width|height)=(.+)", text)
    if found is None:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: sphere_0.radius=0.033, with radius, width or height, in m")
    return int(found[1]), found[2], positive(found[3])


def board(text: str) -> tuple[tuple[int, int] | None, float]:
    """7x5=M or apriltag=M: inner corners across and down, or None, and metres."""
    kind, _, metres = text.partition("=")
    found = re.fullmatch(r"(\d+)x(\d+)|apriltag", kind)
    if found is None or not metres or (found[1] and min(int(found[1]), int(found[2])) < 3):
        raise argparse.ArgumentTypeError(
            f"{text!r}; valid: 7x5=0.025, inner corners across and down (3 or more) and m, or apriltag=0.05"
        )
    return (int(found[1]), int(found[2])) if found[1] else None, positive(metres)


def fixed(text: str) -> tuple[float, ...]:
    """box@x,y or box@x0,y0,x1,y1."""
    shape, at, place = text.partition("@")
    if shape != "box" or not at:
        raise argparse.ArgumentTypeError(f"{text!r}; valid: box@x,y or box@x0,y0,x1,y1")
    return _numbers(place, (2, 4), "box@x,y or box@x0,y0,x1,y1")


def add_world(parser: argparse.ArgumentParser) -> None:
    """The arguments with which the user says what is known of the world that was filmed."""
    add = parser.add_argument
    add(
        "--view",
        choices=("auto", "table", "side", "incline", "flight", "top", "hanging"),
        default="auto",
        help="how the camera sees the world: a table from above and aside, from the side, an incline from the side, "
        "a throw or fall, straight from above, what hangs and swings from the side (auto: what the tracks tell)",
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
        "--board",
        type=board,
        metavar="BOARD=M",
        help="a board in the plane of motion, and the side of its squares, m: 7x5=0.025, a checkerboard with so many "
        "inner corners across and down, or apriltag=0.05 (family 36h11, side of the black border)",
    )
    known.add_argument(
        "--size", type=size, metavar="BODY.KEY=M", help="a known size of a body, m: sphere_0.radius=0.033"
    )
    add(
        "--fixed",
        type=fixed,
        action="append",
        default=[],
        metavar="box@X,Y",
        help="a fixed box that bodies hit, where none of them moves: a point on it, told apart by its colour, or the "
        "corners of its face, box@X0,Y0,X1,Y1 (px of the video's own picture); may be repeated",
    )


def add_edits(parser: argparse.ArgumentParser) -> None:
    """The arguments that change a scene."""
    add = parser.add_argument
    add("--set", dest="set", action="append", default=[], metavar="PATH=VALUE", help="a change of a number")
    add("--remove", action="append", default=[], metavar="NAME", help="an object that is taken away")
    add("--add", action="append", type=Path, default=[], metavar="FILE", help="an object (YAML) that is put in")
    add("--at", type=number, default=0.0, metavar="S", help="when these changes are made, s from the beginning (0)")
    add("--edits", type=Path, metavar="FILE", help="a list of edits (YAML), each with its own time")


def edits_of(arguments: argparse.Namespace) -> list[Edit]:
    """The edits that the arguments of `add_edits` say. Raises SceneError for a file that is not right."""
    from pipeline.editing.edit_list import Edit, read_edits, read_object

    a = arguments
    edits = [] if a.edits is None else read_edits(a.edits)
    edits += [Edit(a.at, remove=name) for name in a.remove]
    edits += [Edit(a.at, set=text) for text in a.set]
    edits += [Edit(a.at, add=read_object(path)) for path in a.add]
    return edits


def _numbers(text: str, lengths: tuple[int, ...], form: str) -> tuple[float, ...]:
    parts = text.split(",")
    if len(parts) not in lengths:
        raise argparse.ArgumentTypeError(f"{text!r} has {len(parts)} numbers; valid: {form}")
    return tuple(number(part) for part in parts)


def number(text: str) -> float:
    """A finite number."""
    try:
        value = float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number") from None
    if not isfinite(value):
        raise argparse.ArgumentTypeError(f"{text} is not finite")
    return value
