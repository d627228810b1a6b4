"""What changes during the training of the tiny model: learning rate, noise of the flow, objects of a clip."""

from __future__ import annotations

from pipeline.language.completion import MAX_OBJECTS


def learning_rate(step: int, left: float, decay: float) -> float:
    """The learning rate as a share of its peak.

    A linear rise over the first 100 steps of a phase, then 1, then a linear fall to 2 % over the last `decay` minutes.

    Args:
        step: Of the phase.
        left: Minutes left of the training.
        decay: Minutes; 0: no fall.
    """
    return min(1.0, (step + 1) / 100) * (0.02 + 0.98 * min(1.0, left / decay) if decay else 1.0)


def noise_strength(minutes: float, ramp: float) -> float:
    """Strength of the flow's noise after so many minutes: a linear rise over `ramp` minutes to 1, which is RAFT's."""
    return min(1.0, minutes / ramp) if ramp else 1.0


def max_objects(minutes: float, vision_only: float, few_objects: float) -> int:
    """The largest number of objects of a clip after so many minutes.

    After the `vision_only` minutes come `few_objects` minutes with one object in their first third, two in the second
    and three in the last. Before and after them there is no limit. With one object, the text can only be about that
    object, so that the language part learns to use the pictures.
    """
    started = minutes - vision_only
    return 1 + int(3 * started / few_objects) if 0 <= started < few_objects else MAX_OBJECTS
