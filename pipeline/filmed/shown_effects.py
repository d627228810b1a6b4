"""Discovery from clips, in which an effect is named only if clips that were not fitted show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pipeline.discrepancy.report.discovery import Discovery
from pipeline.discrepancy.selection.established import HELD_OUT_GAIN
from pipeline.filmed.measured_motion import MeasuredMotion
from pipeline.filmed.unfitted import Unfitted, forecast_unfitted


@dataclass(frozen=True)
class ShownEffects:
    """A discovery whose effects clips that were not fitted show.

    Attributes:
        found: The discovery.
        unfitted: Forecasts of the clips that were not fitted.
        notes: Of effects that fitted best and were dropped, a sentence each.
    """

    found: Discovery
    unfitted: Unfitted
    notes: tuple[str, ...]


def discover_shown(
    motion: MeasuredMotion, effects: Sequence[str], find: Callable[[Sequence[str]], Discovery]
) -> ShownEffects:
    """Find out which effects clips show.

    What is named has to forecast the clips that were not fitted better than the scene without it, in metres or in the
    picture, by more than the uncertainty, and worse in neither. Else these effects are dropped from the list, and the
    discovery begins again. Where no clip is held out, nothing is asked.

    Args:
        motion: As measured.
        effects: Names of the effects that may be answered.
        find: The discovery in this motion, of the effects that it is told.
    """
    left, notes = list(effects), list[str]()
    while True:
        found = find(left)
        unfitted = forecast_unfitted(found, motion)
        named = found.answer.effects
        fault = _fault(found, unfitted) if named and found.problem.held_out else None
        if fault is None:
            return ShownEffects(found, unfitted, tuple(notes))
        notes.append(f"{' and '.join(named)} would fit best, but {fault}")
        left = [name for name in left if name not in named]


def _fault(found: Discovery, unfitted: Unfitted) -> str | None:
    """Why the clips that were not fitted do not show what is named; None: they do."""
    gain = found.selection.none.held_out - found.answer.held_out
    rise, error = unfitted.rise
    if gain < -HELD_OUT_GAIN:
        return "the gap of clips that were not fitted is larger with it"
    if rise < -error:
        return f"clips that were not fitted are forecast worse with it (sequence IoU {rise:+.3f} ± {error:.3f})"
    if gain <= HELD_OUT_GAIN and rise <= error:
        return "clips that were not fitted do not show it"
    return None
