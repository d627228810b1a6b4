"""An inference and a discovery enter each package at most twice (docs/architecture.md)."""

import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import groupby
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import small_clip

from pipeline.api.discover import discover
from pipeline.api.infer import infer
from pipeline.shards.code_hash import ROOT

MEASURED = ROOT / "data" / "measured"
Function = Callable[..., Any]


def package_of(module: str) -> str:
    """`pipeline.scene` of pipeline.scene.text; the packages of `discrepancy` are told apart."""
    return ".".join(module.split(".")[: 3 if module.startswith("pipeline.discovery.") else 2])


@contextmanager
def calls(conductors: set[str]) -> Iterator[list[str]]:
    """The packages whose functions are called, in this order, by the modules that only pass results on."""
    entered: list[str] = []

    def module(frame: FrameType | None) -> str:
        while frame is not None and not str(frame.f_globals.get("__name__")).startswith("pipeline."):
            frame = frame.f_back
        return "" if frame is None else str(frame.f_globals["__name__"])

    def note(frame: FrameType, event: str, _: object) -> None:
        if event != "call":
            return
        own = str(frame.f_globals.get("__name__"))
        called = own.startswith("pipeline.") and own not in conductors and frame.f_code.co_name != "<module>"
        if called and module(frame.f_back) in conductors:
            entered.append(package_of(own))

    sys.setprofile(note)
    try:
        yield entered
    finally:
        sys.setprofile(None)


def stays(entered: list[str]) -> Counter[str]:
    """How often each package is entered; a word on progress is no stay."""
    return Counter(package for package, _ in groupby(p for p in entered if p != "pipeline.inference"))


def test_a_discovery_enters_each_package_at_most_twice(tmp_path: Path) -> None:
    with calls({"pipeline.api.discover", "pipeline.discovery.discover"}) as entered:
        found = discover(MEASURED / "thrown_ball.csv", MEASURED / "thrown_ball.yaml", effects="air_drag,wind")
        found.save(tmp_path / "found")
    counts = stays(entered)
    assert {f"pipeline.discovery.{part}" for part in ("tracks", "selection", "report")} <= set(counts)
    assert max(counts.values()) <= 2, counts


def test_an_inference_enters_each_package_at_most_twice(tmp_path: Path) -> None:
    clip = tmp_path / "clip"
    clip.mkdir()
    small_clip.write(clip / "clip.mp4")
    np.savez(clip / "masks.npz", masks=small_clip.masks())
    conductors = {f"pipeline.{name}" for name in ("api.infer", "inference.measure_clip", "inference.find_scenes")}
    with calls(conductors) as entered:
        infer(clip, samples=1, flow="dis")
    counts = stays(entered)
    assert {"pipeline.bodies", "pipeline.search"} <= set(counts)
    assert max(counts.values()) <= 2, [package for package, _ in groupby(entered)]
