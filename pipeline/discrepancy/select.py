"""Which effects the measurements ask for.

The model with the lowest score (pipeline/discrepancy/fitter.py) wins, if it wins by more than chance makes it win
where nothing is hidden (`CLAIM`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.candidate import Candidate
from pipeline.discrepancy.fitter import CLAIM, MOST_FITTED, Fitter
from pipeline.discrepancy.frame_rate import is_standard
from pipeline.discrepancy.impact import Bounce
from pipeline.discrepancy.problem import Problem
from pipeline.discrepancy.testable import testable
from pipeline.scene.effects.registry import effect_kinds

CLAIM_MORE = 16.0  # the same for a second and a third
NEAR = 25.0  # candidates whose scores are so near the best are fitted from its initial states, too
ALIKE = 7.0  # effects whose scores differ by less are not told apart
MOST_EFFECTS = 3
LEAST_CLIPS_FOR_MORE = 3  # fewer clips differ from each other in too many ways for two effects
UNEXPLAINED_Z, UNEXPLAINED_SHARE = 5.0, 0.015  # a model explains the data unless both are exceeded
UNEXPLAINED_OF_NOISE = 0.05  # and unless it is so much of the noise: the best of models are a little off
UNEXPLAINED_LOUD = 0.5  # of the noise: so much is too much whatever its share, where clips are enough to tell
UNEXPLAINED_SHARE_FEW = 0.06  # of one or two clips, whose own peculiarities nothing averages out
SCALES_GRAVITY = ("buoyancy", "clock_rate", "gravity_error", "length_scale")
SWALLOWED_SHARE = 1 / 3  # of what such a number explains: a law that explains as much may be what it stands for
BROKEN_Z, BROKEN_SHARE = 6.0, 0.15  # arcs so far off, and so few, are left out


@dataclass(frozen=True)
class Selection:
    """none: the calibrated model without effects; singles: every effect alone, best first; chosen: the winner;
    alike: sets of effects that cannot be told from one of the winner's; excess: what the winner leaves beyond
    noise, as a share of what the calibrated model leaves, and as a z-score; unknown: whether that
    is too much, or a number that scales gravity may have swallowed a law; ruled_out:
    effects that something beside the motion speaks against."""

    none: Candidate
    singles: tuple[Candidate, ...]
    chosen: Candidate
    alike: tuple[tuple[str, ...], ...]
    excess_share: float
    excess_z: float
    unknown: bool
    bounces: tuple[Bounce, ...]
    untestable: tuple[str, ...]
    ruled_out: tuple[str, ...] = ()


class Selector:
    """Which models of a problem win. `effects`: the names that may be answered."""

    def __init__(
        self, problem: Problem, effects: Sequence[str], progress: Callable[[str], None] = lambda _: None
    ) -> None:
        self.known, self.progress = problem.known, progress
        kinds = effect_kinds()
        self.kinds = [kinds[name] for name in effects if testable(kinds[name], problem)]
        self.untestable = tuple(name for name in effects if not testable(kinds[name], problem))
        self._pose(problem)

    def _pose(self, problem: Problem) -> None:
        self.fitter = Fitter(problem, self.kinds, self.progress)
        self.none = self.fitter.none

    @property
    def problem(self) -> Problem:
        """What is left of the problem, without the arcs that no model explains."""
        return self.fitter.problem

    def select(self) -> Selection:
        """The models that explain the measurements best."""
        beside_impacts = self._without_broken(self.none, beside_impacts=True)
        if beside_impacts is not None:
            self._pose(beside_impacts)
        singles = self.fitter.extended(self.none)
        best = self._best(singles)
        for _ in range(2):
            left_out = self._without_broken(best)
            if left_out is None:
                break
            self._pose(left_out)
            singles = self.fitter.extended(self.none)
            best = self._best(singles)
        singles = self._polished(best, singles)
        self.fitter.sharpen(best)
        self.none, singles = (
            self.fitter.rescored(self.none),
            sorted(map(self.fitter.rescored, singles), key=lambda c: c.score),
        )
        best, chosen = self._best(singles), self.none
        longer: list[Candidate] = []
        if best.effects and best.score < self.none.score - (CLAIM_MORE if self.problem.blunt else CLAIM):
            chosen, longer = self._more(best, singles)
        z, share = self._excess(chosen)
        alike = self._one_exchanged(chosen, longer) if len(chosen.effects) > 1 else self._alike(chosen, singles)
        few = len(self.problem.fitted) < LEAST_CLIPS_FOR_MORE
        limit = UNEXPLAINED_SHARE_FEW if few else UNEXPLAINED_SHARE
        rest = self._of_noise(chosen)
        loud = rest > UNEXPLAINED_LOUD and not few and chosen.obstacle is None  # near its hits outliers hide
        much = z > UNEXPLAINED_Z and (loud or (share > limit and rest > UNEXPLAINED_OF_NOISE))
        swallowed = self._swallowed(chosen, singles) if self.problem.blunt else ()
        unknown = much and not self.problem.blunt
        alike = () if unknown else ((*alike[0], *swallowed),) if swallowed and alike else alike
        return Selection(
            self.none, tuple(singles), chosen, alike, share, z, unknown or len(swallowed) > 0,
            tuple(self.fitter.bounces), self.untestable,
            ("clock_rate",) if any(self._clock_doubt(c) < 0 for c in singles) else (),
        )  # fmt: skip

    def _swallowed(self, chosen: Candidate, singles: Sequence[Candidate]) -> tuple[str, ...]:
        """Laws that a number which only scales gravity may have swallowed: they explain much of what it explains, and
        what tells them from it is no larger than what the clips leave of either."""
        if len(chosen.effects) != 1 or chosen.name not in SCALES_GRAVITY:
            return ()
        least = self.none.score - SWALLOWED_SHARE * (self.none.score - chosen.score)
        return tuple(c.name for c in singles if c.score < least and c.name not in SCALES_GRAVITY)

    def _best(self, singles: Sequence[Candidate]) -> Candidate:
        return self._likeliest([self.none, *singles], self.none)

    def _likeliest(self, candidates: Sequence[Candidate], default: Candidate) -> Candidate:
        return min(candidates, key=lambda c: c.score - self._clock_doubt(c), default=default)

    def _polished(self, best: Candidate, singles: Sequence[Candidate]) -> list[Candidate]:
        """The candidates near the best, fitted again from its initial states: on the ground, where a body stops makes
        for local minima, which would tell effects apart that are one law."""
        out = list(singles)
        if not best.effects or best.obstacle is not None or not any(s.grounded for s in best.problem.stacks):
            return out
        for i, c in enumerate(out):
            plain = c.effects != best.effects and c.restitution is None and c.obstacle is None
            if plain and c.problem is best.problem and c.score < best.score + NEAR:
                again = self.fitter.fitted(c.problem, c.fit.model, c.fit.theta, best.fit.starts, c.effects)
                again = self.fitter.with_bounces(again, False)
                out[i] = again if again.score < c.score else c
        return out

    def _without_broken(self, best: Candidate, beside_impacts: bool = False) -> Problem | None:
        """The problem without the few arcs that the best model misses while it explains all others: an impact that
        was not seen, an outlier among few samples. None where there are no such arcs, or too many. beside_impacts: only
        arcs that an impact begins or ends, and without jumps: what is left of a contact in them looks like a force that
        nothing has."""
        if self._excess(best)[0] < UNEXPLAINED_Z or best.obstacle is not None:
            return None
        touched = {i for impact in self.problem.impacts for i in (impact.before, impact.after)}
        share, broken, left, freedom = self.problem.floor.information, [], 0.0, 0.0
        for stack, chi2 in zip(self.problem.stacks, best.fit.position_chi2, strict=True):
            rows = np.maximum((stack.weight > 0).sum((1, 2)) - stack.own, 1)
            z = (chi2 * share - rows) / np.sqrt(2 * rows)
            broken.append(z > BROKEN_Z)
            if beside_impacts:
                broken[-1] &= np.array([i in touched and not self.problem.arcs[i].jumps for i in stack.index])
            left += float(chi2[~broken[-1]].sum() * share)
            freedom += float(rows[~broken[-1]].sum())
        count, arcs = sum(int(b.sum()) for b in broken), sum(map(len, broken))
        if not 0 < count <= BROKEN_SHARE * (arcs + 2) or (left - freedom) / np.sqrt(2 * max(freedom, 1)) > 3:
            return None
        stacks = tuple(replace(s, weight=np.where(b[:, None, None], 0.0, s.weight))
                       for s, b in zip(self.problem.stacks, broken, strict=True))  # fmt: skip
        kept = [replace(p, chi2=np.where(b, 0, p.chi2), parameters=np.where(b, 0, p.parameters))
                for p, b in zip(self.problem.parts, broken, strict=True)]  # fmt: skip
        return replace(self.problem, stacks=stacks, parts=tuple(kept), broken=self.problem.broken + count)

    def _more(self, best: Candidate, singles: Sequence[Candidate]) -> tuple[Candidate, list[Candidate]]:
        """Forward selection, from the best and the runners-up, as long as an effect more wins by enough. Returns the
        winner and all models of several effects that were fitted."""
        leaders = [c for c in singles if c.score < self.none.score - CLAIM][:2]
        chosen, tried = best, list[Candidate]()
        if len(self.problem.fitted) < LEAST_CLIPS_FOR_MORE:
            return chosen, tried
        for _ in range(MOST_EFFECTS - 1):
            z, _ = self._excess(chosen)
            if z < 2.5 and not (self.fitter.sharper > 1 and self.fitter.promises(chosen, CLAIM_MORE)):
                break
            longer = [c for leader in leaders for c in self.fitter.extended(leader, MOST_FITTED - 4)]
            winner = self._likeliest(longer, chosen)
            swapped = [
                c for c in singles if c.name == winner.effects[-1] and len(winner.effects) == 2 and c not in leaders
            ]
            for single in swapped:  # what the first effect had to make up for may now be had at a lower price
                longer += self.fitter.extended(single, MOST_FITTED - 4)
            tried += longer
            winner = self._likeliest(longer, chosen)
            if winner.score > chosen.score - CLAIM_MORE:
                break
            shorter = self.fitter.one_less(winner)
            tried += [c for c in shorter if len(c.effects) > 1]
            least = self._likeliest(shorter, winner)
            chosen = least if least.score < winner.score + CLAIM_MORE else winner
            leaders = [chosen]
        return chosen, tried

    def _alike(self, chosen: Candidate, singles: Sequence[Candidate]) -> tuple[tuple[str, ...], ...]:
        if not chosen.effects:
            return ()
        names = [c.name for c in singles if c.score < chosen.score + ALIKE + self._clock_doubt(c)]
        hits = {c.name: c.obstacle.hits for c in singles if c.obstacle is not None}
        if chosen.name in ("impulse", "hidden_obstacle") and hits.get("hidden_obstacle") == 1:
            either = [c.name for c in singles if c.name in ("impulse", "hidden_obstacle")]
            names = list(dict.fromkeys([chosen.name, *names, *either]))
        return (tuple(names),) if len(names) > 1 else ()

    def _one_exchanged(self, chosen: Candidate, tried: Sequence[Candidate]) -> tuple[tuple[str, ...], ...]:
        """For each effect of a model of several: itself, with those that could stand in its place as well."""
        near = [c for c in tried if len(c.effects) == len(chosen.effects)
                and c.score < chosen.score + ALIKE + self._clock_doubt(c)]  # fmt: skip
        groups = []
        for name in chosen.effects:
            others = set(chosen.effects) - {name}
            names = [n for c in near for n in c.effects if others == set(c.effects) - {n} and n not in others]
            groups.append(tuple(dict.fromkeys([name, *names])))
        return tuple(group for group in groups if len(group) > 1)

    def _clock_doubt(self, found: Candidate) -> float:
        """What a wrong clock has against or for it: cameras run at standard rates, so that a recording whose rate
        is one speaks against a wrong clock that would make it none, and the other way round."""
        column = found.fit.model.column("clock_rate", "ratio") if "clock_rate" in found.effects else None
        rate = self.problem.frame_rate
        if column is None or rate is None:
            return 0.0
        ratio, error = found.fit.theta[column], max(float(found.fit.covariance[column, column]) ** 0.5, 2e-4)
        stated, true = is_standard(rate, 2e-4), is_standard(rate * float(ratio), 2 * error)
        return 2 * ALIKE if true and not stated else -2 * ALIKE if stated and not true else 0.0

    def _of_noise(self, found: Candidate) -> float:
        """What a model leaves beyond noise, as a share of the noise."""
        left = found.left * self.fitter.sharper / max(found.problem.rows - found.own, 1) - 1
        if self.fitter.restitution is None:
            return left
        # bounces are few, and each is a measurement
        return max(left, self.fitter.bounce_chi2(found) / max(len(self.fitter.bounces), 1) - 1)

    def _excess(self, found: Candidate) -> tuple[float, float]:
        """What a model leaves beyond noise: as a z-score, and as a share of what the calibrated model leaves."""
        share = self.problem.floor.information * self.fitter.sharper

        def beyond(c: Candidate) -> tuple[float, float]:
            floor = sum(float(p.chi2.sum()) for p in c.problem.parts) / self.fitter.sharper
            smooth = sum(int(p.parameters.sum()) for p in c.problem.parts)
            return (c.left - floor) * share, max(smooth - c.own, 1)

        left, freedom = beyond(found)
        whole, freedom_none = beyond(self.none)
        bounce = self.fitter.bounce_chi2(found) - len(self.fitter.bounces) * (self.fitter.restitution is not None)
        z = (left + bounce - freedom) / np.sqrt(2 * (freedom + len(self.fitter.bounces)))
        whole += self.fitter.bounce_chi2(self.none) - freedom_none
        return float(z), float(np.clip((left + max(bounce, 0) - freedom) / max(whole, 1e-9), 0, 1))
