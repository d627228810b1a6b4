"""Discovery as a whole: from tracks and a known scene to a verdict with its reasons."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from pipeline.discrepancy.report.discovery import Discovery, discovery_of
from pipeline.discrepancy.selection.select_effects import select_effects
from pipeline.discrepancy.tracks.known_scene import KnownScene
from pipeline.discrepancy.tracks.problem import build_problem
from pipeline.discrepancy.tracks.track import Track


def discover(
    tracks: Sequence[Track],
    known: KnownScene,
    held_out: float,
    effects: Sequence[str],
    rng: np.random.Generator,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> Discovery:
    """Find out which effects the measurements support.

    Args:
        tracks: Measured motion of all clips.
        known: What is known of the scene.
        held_out: Share of the clips that is not fitted, but scored.
        effects: Names of the effects that may be answered.
        rng: Chooses the clips that are held out.
        progress: Called with the name of each effect that is fitted.

    Raises:
        MeasurementError: For tracks that do not fit the scene, or that have nothing to be fitted.
    """
    problem = build_problem(tracks, known, held_out, rng)
    selection = select_effects(problem, effects, progress)
    return discovery_of(selection)
