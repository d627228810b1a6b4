"""Precision, recall and F1 of events, as docs/formats.md defines them: said or simulated events against true ones.

Two events match where their kind and their objects are the same and their times differ by at most `TOLERANCE_S`. Each
event matches at most once. Counts are added over clips before a share is taken of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.clips.events import ANSWERED_KINDS, Event

TOLERANCE_S = 0.1  # largest difference of the times of two events that match
ROUNDING_S = 1e-9  # times are decimal numbers of a text


@dataclass(frozen=True)
class EventCounts:
    """How many events of two lists match. Shares are NaN where there is nothing to take a share of.

    Attributes:
        matched: Pairs of events that match.
        found: Events that are judged.
        true: Events that they are compared with.
    """

    matched: int = 0
    found: int = 0
    true: int = 0

    def __add__(self, other: EventCounts) -> EventCounts:
        """The counts of both together."""
        return EventCounts(self.matched + other.matched, self.found + other.found, self.true + other.true)

    @property
    def precision(self) -> float:
        """Share of the events found that match."""
        return _share(self.matched, self.found)

    @property
    def recall(self) -> float:
        """Share of the true events that match."""
        return _share(self.matched, self.true)

    @property
    def f1(self) -> float:
        """Harmonic mean of precision and recall: 2 matched / (found + true)."""
        return _share(2 * self.matched, self.found + self.true)


def count_by_kind(found: Sequence[Event], true: Sequence[Event]) -> dict[str, EventCounts]:
    """The counts of each of `ANSWERED_KINDS`.

    Args:
        found: Events that are judged.
        true: Events that they are compared with. Objects of both lists have the same numbers.
    """
    matched = [found[i].kind for i, _ in match_events(found, true)]
    sides = matched, [e.kind for e in found], [e.kind for e in true]
    return {kind: EventCounts(*(side.count(kind) for side in sides)) for kind in ANSWERED_KINDS}


def match_events(found: Sequence[Event], true: Sequence[Event]) -> list[tuple[int, int]]:
    """The largest matching of two lists of events, as pairs of their indices.

    Only events of one kind and of the same objects can match; of these, the earliest of each list are compared. Where
    they are near enough they become a pair. Else the earlier of the two has no partner, since all that are left in the
    other list are even later. No matching has more pairs: if a largest matching does not pair the two earliest,
    although they are near enough, their partners are near enough to each other, too, and partners can be exchanged.
    """
    ours, theirs = _lines_of_time(found), _lines_of_time(true)
    pairs = []
    for what in ours.keys() & theirs.keys():
        left, right = ours[what], theirs[what]
        while left and right:
            later = found[left[0]].time - true[right[0]].time
            if abs(later) <= TOLERANCE_S + ROUNDING_S:
                pairs.append((left.pop(0), right.pop(0)))
            else:
                (right if later > 0 else left).pop(0)
    return sorted(pairs)


def with_objects(events: Sequence[Event], numbers: Sequence[int]) -> list[Event]:
    """The events with other numbers for their objects; numbers: the new one of each object."""
    out = []
    for event in events:
        first, *others = (numbers[i] for i in event.objects)
        out.append(replace(event, first=first, second=others[0] if others else event.second))
    return out


def true_numbers(pairs: np.ndarray, objects: int) -> list[int]:
    """For each object of an answer the index of the true object that it was assigned to.

    An object without a partner gets a negative number of its own, so that its events match none.

    Args:
        pairs: (P, 2) Answered and true objects, of `pipeline.clips.overlap.assign`.
        objects: Of the answer.
    """
    partners = {int(i): int(j) for i, j in pairs}
    return [partners.get(i, -1 - i) for i in range(objects)]


def _lines_of_time(events: Sequence[Event]) -> dict[tuple[object, ...], list[int]]:
    """Indices of the events in the order of time, by kind and objects. Who hits and who is hit makes no difference."""
    lines: dict[tuple[object, ...], list[int]] = {}
    for i in sorted(range(len(events)), key=lambda i: events[i].time):
        event = events[i]
        fixed = event.second if event.kind == "hits_fixed" else None
        lines.setdefault((event.kind, *sorted(event.objects), fixed), []).append(i)
    return lines


def _share(part: int, whole: int) -> float:
    return part / whole if whole else float("nan")
