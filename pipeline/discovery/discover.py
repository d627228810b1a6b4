"""Discovery as a whole: from tracks and a known scene to a verdict with its reasons."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from pipeline.discovery.fitting.recording_scale import outlying_scale, with_true_scale
from pipeline.discovery.report.discovery import Discovery, discovery_of
from pipeline.discovery.selection.forward_selection import CLAIM_MORE
from pipeline.discovery.selection.select_effects import select_effects
from pipeline.discovery.selection.selection import Selection
from pipeline.discovery.tracks.breaks import mend_breaks
from pipeline.discovery.tracks.fault import Fault
from pipeline.discovery.tracks.known_scene import KnownScene
from pipeline.discovery.tracks.problem import build_problem
from pipeline.discovery.tracks.track import Track


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

    Faults of the measurement are mended first: they would pass for physics.

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

    def select(tracks: Sequence[Track]) -> Selection:
        return select_effects(build_problem(tracks, known, held_out, copy.deepcopy(rng)), effects, progress)

    whole, faults = mend_breaks(tracks)
    found = select(whole)
    while (fault := outlying_scale(found.chosen)) is not None and not _is_known(fault, faults):
        mended = with_true_scale(whole, fault)
        again = select(mended)
        if again.chosen.score > found.chosen.score - CLAIM_MORE:
            break
        whole, found = mended, again
        faults.append(fault)
    return discovery_of(found, faults)


def _is_known(fault: Fault, faults: Sequence[Fault]) -> bool:
    """Whether the same fault of the same recording was found before."""
    return any((f.fault, f.clip) == (fault.fault, fault.clip) for f in faults)
