"""Forward selection: effects are added to the best models one by one, as long as each wins by enough."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar

from pipeline.discovery.fitting.extension import CLAIM
from pipeline.discovery.selection.comparison import Scored

CLAIM_MORE = 16.0  # by how much the score of a second and a third effect must win
MOST_EFFECTS = 3
LEADERS = 2  # models of one effect that a second effect is added to
Model = TypeVar("Model", bound=Scored)


class Search(Protocol[Model]):
    """How models of one kind of problem are made longer and shorter; the kinds differ in this alone."""

    def longer(self, base: Model) -> list[Model]:
        """`base` with one effect more, the best first."""

    def shorter(self, found: Model) -> list[Model]:
        """`found` without each one of its effects."""

    def rank(self, found: Model) -> float:
        """A model's score, and what is known beside the motion."""

    def leaves_noise(self, found: Model) -> bool:
        """Whether what a model leaves may be noise, so that no further effect is sought."""

    def holds(self, found: Model) -> bool:
        """Whether a model's effects are the same without each recording, where it leaves more than noise."""


@dataclass(frozen=True)
class ForwardSelection(Generic[Model]):
    """chosen: the model that wins; tried: all models of several effects that were fitted."""

    chosen: Model
    tried: tuple[Model, ...]


def forward_selection(
    search: Search[Model], none: Model, best: Model, singles: Sequence[Model]
) -> ForwardSelection[Model]:
    """Add effects to the best model of one effect and to its runner-up.

    Args:
        search: Makes models longer and shorter.
        none: The model without effects.
        best: The best model of one effect.
        singles: All models of one effect, the best first.
    """
    leaders = [c for c in singles if c.score < none.score - CLAIM][:LEADERS]
    chosen = best
    tried: list[Model] = []
    for _ in range(MOST_EFFECTS - 1):
        if search.leaves_noise(chosen):
            break
        longer = [c for base in leaders for c in search.longer(base)]
        winner = min(longer, key=search.rank, default=chosen)
        if len(winner.effects) == 2:  # what the first effect had to make up for may now cost less
            last = [c for c in singles if c.effects == winner.effects[-1:] and all(c is not base for base in leaders)]
            longer += [c for base in last for c in search.longer(base)]
        tried += longer
        winner = min(longer, key=search.rank, default=chosen)
        if winner.score > chosen.score - CLAIM_MORE:
            break
        if not search.holds(winner):
            break
        shorter = search.shorter(winner)
        tried += [c for c in shorter if len(c.effects) > 1]
        least = min(shorter, key=search.rank, default=winner)
        chosen = least if least.score < winner.score + CLAIM_MORE else winner
        leaders = [chosen]
    return ForwardSelection(chosen, tuple(tried))
