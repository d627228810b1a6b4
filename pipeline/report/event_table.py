"""The table of events: how many of each kind were found, and how many are right."""

from __future__ import annotations

from pipeline.clips.matched_events import ANSWERED_KINDS, EventCounts
from pipeline.report.event_scores import CONSISTENCY, SAID, SIMULATED
from pipeline.report.summary import Summary
from pipeline.report.tables import NONE, Table, cell

#: Metric -> heading of the table of scores.
EVENTS = {
    SAID: "events F1, said",
    SIMULATED: "events F1, simulated",
    CONSISTENCY: "events F1, said and simulated",
}
#: Metric -> which events are compared with which.
COMPARED = {
    SAID: "said, with the truth",
    SIMULATED: "simulated, with the truth",
    CONSISTENCY: "said, with the simulated",
}
ALL_KINDS = "all"
HEADER = ["suite", "method", "events", "kind", "found", "compared with", "matched", "precision", "recall", "F1"]


def events_table(summary: Summary) -> Table:
    """A line per suite, method, comparison and kind of event, without those that no clip has.

    Args:
        summary: With the metrics of `EVENTS`, and `<metric>.<kind>` for each of `ANSWERED_KINDS`.
    """
    rows = []
    for (suite, method), counts in summary.counts.items():
        for metric, compared in COMPARED.items():
            for kind in (ALL_KINDS, *ANSWERED_KINDS):
                name = metric if kind == ALL_KINDS else f"{metric}.{kind}"
                c = EventCounts(*counts[name])
                if c.found or c.true:
                    numbers = [str(n) for n in (c.found, c.true, c.matched)]
                    shares = [_share(c.precision), _share(c.recall), cell(summary.intervals[suite, method][name])]
                    rows.append([suite, method, compared, kind.replace("_", " "), *numbers, *shares])
    return HEADER, rows


def _share(value: float) -> str:
    return NONE if value != value else f"{value:.3g}"
