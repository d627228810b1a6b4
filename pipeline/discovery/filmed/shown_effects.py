"""Discovery from clips, in which an effect is named only if clips that were not fitted show it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pipeline.discovery.filmed.measured_motion import MeasuredMotion
from pipeline.discovery.filmed.unfitted import Unfitted, forecast_unfitted
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.report.discovery import Discovery, discovery_of
from pipeline.discovery.report.report_dict import report_dict
from pipeline.discovery.selection.established import HELD_OUT_GAIN, halves_gap
from pipeline.discovery.selection.forward_selection import CLAIM_MORE
from pipeline.discovery.selection.shorter import leaves_noise, shorter_selections, simpler_selection, with_single

LEAST_EXPLAINED = 0.5  # share of what a dropped effect explains, from which another one may be named instead
LEAST_RISE = 0.03  # of the forecasts' IoU, three times the error of masks: a smaller one does not show an effect
MOST_DROPPED = 3  # best effects that may be dropped; after that nothing is named


@dataclass(frozen=True)
class ShownEffects:
    """A discovery whose effects clips that were not fitted show.

    Attributes:
        found: The discovery.
        unfitted: Forecasts of the clips, by models that were fitted to the other clips.
        notes: Of effects that fitted best and were dropped, a sentence each.
    """

    found: Discovery
    unfitted: Unfitted
    notes: tuple[str, ...]

    @property
    def report(self) -> dict[str, Any]:
        """The content of report.json (docs/formats.md)."""
        out = report_dict(self.found)
        out["gap"] |= self.unfitted.as_dict()
        return out


def discover_shown(
    motion: MeasuredMotion, effects: Sequence[str], find: Callable[[Sequence[str]], Discovery]
) -> ShownEffects:
    """Find out which effects clips show.

    With what is named, the IoU of forecasts has to rise by LEAST_RISE and by more than its uncertainty, and the gap of
    clips that were not fitted must not grow. Else these effects are dropped from the list, and the discovery begins
    again, up to MOST_DROPPED times; what it finds then has to explain at least half as much. Of several effects each
    has to be shown beside the others, which have to leave more than noise; else it is not named. An effect of fewer
    numbers that is hardly worse, in forecasts as well, is named instead; so is one that fits nearly as well and
    forecasts better, where the gap does not show the first. Where no clip is held out, nothing is asked. Where no clip
    can be forecast, half of the gap has to go.

    Args:
        motion: As measured.
        effects: Names of the effects that may be answered.
        find: The discovery in this motion, of the effects that it is told.
    """
    left, notes, most = list(effects), list[str](), 0.0
    for _ in range(MOST_DROPPED):
        found = find(left)
        if not found.answer.effects or not found.problem.held_out:
            break
        found, dropped = _without_unshown(found, motion)
        found, replaced = _simpler(found, motion)
        notes += dropped + replaced
        unfitted, fault = _beside_none(found, motion)
        if fault is None:
            found, preferred = _better_forecast(found, motion)
            if preferred:
                notes += preferred
                unfitted, fault = _beside_none(found, motion)
        named, none = found.answer.effects, found.selection.none
        explained = 1 - found.answer.score / none.score
        if fault is None and explained < LEAST_EXPLAINED * most:
            fault = "what was dropped explains more than twice as much"
        if fault is None:
            return ShownEffects(found, unfitted, tuple(notes))
        notes.append(f"{' and '.join(named)} would fit best, but {fault}")
        left, most = [name for name in left if name not in named], max(most, explained)
    else:
        found = find([])
    return ShownEffects(found, forecast_unfitted(found.selection, motion), tuple(notes))


def _without_unshown(found: Discovery, motion: MeasuredMotion) -> tuple[Discovery, list[str]]:
    """The discovery without those of several effects that are not shown beside the others, and a note on each."""
    notes = []
    while True:
        for name, shorter in shorter_selections(found.selection).items():
            if leaves_noise(found.selection, shorter.chosen):
                fault: str | None = "what is left without it may be noise"
            else:
                fault = _fault(found, shorter.chosen, forecast_unfitted(found.selection, motion, shorter.chosen))
            if fault is not None:
                notes.append(f"{name} beside {' and '.join(shorter.chosen.effects)} would fit better, but {fault}")
                found = discovery_of(shorter)
                break
        else:
            return found, notes


def _simpler(found: Discovery, motion: MeasuredMotion) -> tuple[Discovery, list[str]]:
    """The discovery with an effect of fewer numbers, if one fits nearly as well and does not forecast the clips worse,
    and a note on it."""
    simpler = simpler_selection(found.selection)
    if simpler is found.selection:
        return found, []
    rise, error = forecast_unfitted(simpler, motion, found.answer).rise
    if rise < -max(error, LEAST_RISE):
        return found, []
    shorter = simpler.chosen.name
    note = f"{found.answer.name} would fit better, but has more parameters than {shorter}, which is nearly as good"
    return discovery_of(simpler), [note]


def _better_forecast(found: Discovery, motion: MeasuredMotion) -> tuple[Discovery, list[str]]:
    """The discovery with the effect whose forecasts are the best, where the gap does not show the single one that was
    found and effects of no more numbers fit nearly as well; and a note on each one that was replaced."""
    none, notes = found.selection.none, list[str]()
    if len(found.answer.effects) != 1 or _gap_shows(found, none):
        return found, notes
    for rival in found.selection.singles:
        answer = found.answer
        alike = rival.score < min(none.score, answer.score + CLAIM_MORE)
        if rival is not answer and alike and rival.parameters <= answer.parameters:
            other = with_single(found.selection, rival)
            if forecast_unfitted(other, motion, answer).rise[0] > 0:
                notes.append(f"{answer.name} would fit better, but {rival.name} forecasts the clips better")
                found = discovery_of(other)
    return found, notes


def _gap_shows(found: Discovery, shorter: Candidate) -> bool:
    """Whether the gap of held-out clips shows what is named: it is less than half of what a shorter model leaves, and
    chi squared falls by more than chance."""
    gain = shorter.held_out - found.answer.held_out
    return gain > HELD_OUT_GAIN and halves_gap(found.selection, found.answer, shorter)


def _beside_none(found: Discovery, motion: MeasuredMotion) -> tuple[Unfitted, str | None]:
    """Forecasts without any effect and with what is named, and why the latter is not shown; None: it is."""
    unfitted = forecast_unfitted(found.selection, motion)
    return unfitted, _fault(found, found.selection.none, unfitted)


def _fault(found: Discovery, shorter: Candidate, unfitted: Unfitted) -> str | None:
    """Why the clips that were not fitted do not show what is named beside a shorter model; None: they do.

    unfitted: Forecasts by the shorter model and with what is named, each fitted to the other clips.
    """
    gain = shorter.held_out - found.answer.held_out
    rise, error = unfitted.rise
    if gain < -HELD_OUT_GAIN:
        return "the gap of clips that were not fitted is larger with it"
    if unfitted.before and rise <= max(error, LEAST_RISE):
        return f"the forecasts of clips that were not fitted do not show it (sequence IoU {rise:+.3f} ± {error:.3f})"
    if not unfitted.before and not _gap_shows(found, shorter):
        return "the gap of clips that were not fitted hardly shows it"
    return None
