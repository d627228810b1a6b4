"""How right the events of an answer are: those that it says and those of its simulation, against the clip's true ones.

Objects of an answer are compared with the true objects to which the replay's masks assign them, as in `scene_scores`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pipeline.clips.events import Event, Thresholds, find_events
from pipeline.clips.matched_events import ANSWERED_KINDS, EventCounts, count_by_kind, true_numbers, with_objects
from pipeline.clips.schedule import Schedule
from pipeline.clips.view import event_areas
from pipeline.errors import SimulationError
from pipeline.model.language.completion import read_completion
from pipeline.model.language.said_events import said_events
from pipeline.physics.simulate import simulate
from pipeline.report.summary import COUNTS
from pipeline.scene.scene import Scene

SAID, SIMULATED, CONSISTENCY = "events_f1_said", "events_f1_simulated", "events_f1_consistency"
#: What is compared: said events with true ones, simulated events with true ones, said events with simulated ones.
EVENT_METRICS = (SAID, SIMULATED, CONSISTENCY)
#: The metrics of each kind alone, `events_f1_said.hits_ground`.
KIND_METRICS = tuple(f"{metric}.{kind}" for metric in EVENT_METRICS for kind in ANSWERED_KINDS)


def read_said_events(text: str) -> list[Event] | None:
    """The events that a completion says; None where it has no `<think>`, since nothing was asked for then."""
    think = read_completion(text).think
    return said_events(think) if think else None


def simulated_events(scene: Scene, schedule: Schedule, thresholds: Thresholds) -> list[Event]:
    """What happens in a scene as it is simulated; nothing where the simulation becomes unstable."""
    try:
        trace = simulate(scene, schedule.seconds)
    except SimulationError:
        return []
    areas = event_areas(scene, trace, schedule)
    return find_events(trace, scene.shapes, areas, schedule.frame_steps, thresholds)


def compare_events(
    said: Sequence[Event] | None, simulated: Sequence[Event], true: Sequence[Event], numbers: Sequence[int]
) -> dict[str, dict[str, EventCounts]]:
    """The counts of an answer by metric of `EVENT_METRICS` and kind of event.

    Args:
        said: Events of `<think>`, with the answer's numbers of objects; None where the answer has no words, and then
            there are no counts of what is said.
        simulated: Events of the answered scene, with the answer's numbers of objects.
        true: Events of the clip.
        numbers: For each object of the answer the index of the true object, negative for none.
    """
    out = {SIMULATED: count_by_kind(with_objects(simulated, numbers), true)}
    if said is not None:
        out[SAID] = count_by_kind(with_objects(said, numbers), true)
        out[CONSISTENCY] = count_by_kind(said, simulated)
    return out


def event_columns(counts: Mapping[str, Mapping[str, EventCounts]]) -> dict[str, int]:
    """Columns of a row of scores: `<metric>.<count>` of all kinds together, `<metric>.<kind>.<count>` of each."""
    out: dict[str, int] = {}
    for metric, by_kind in counts.items():
        total = sum(by_kind.values(), EventCounts())
        for name, one in {metric: total, **{f"{metric}.{kind}": one for kind, one in by_kind.items()}}.items():
            out |= {f"{name}.{count}": getattr(one, count) for count in COUNTS}
    return out


def score_events(
    scene: Scene,
    pairs: np.ndarray,
    completion: str | None,
    true: Sequence[Event],
    schedule: Schedule,
    thresholds: Thresholds,
) -> dict[str, int]:
    """The counts of one answer, as columns of its row of scores.

    Args:
        scene: The answer.
        pairs: (P, 2) Its objects and the true objects that they were assigned to.
        completion: The text that the model wrote; None where the answer was found without words.
        true: Events of the clip.
        schedule: Of the clip.
        thresholds: By which the true events were found.
    """
    said = None if completion is None else read_said_events(completion)
    simulated = simulated_events(scene, schedule, thresholds)
    return event_columns(compare_events(said, simulated, true, true_numbers(pairs, len(scene.objects))))
