"""Which effects the measurements ask for.

Every model, from none to three effects, gets one score, in the units of chi squared: what it leaves of the fitted
clips, plus BIC's price of its parameters, plus what it leaves of the held-out clips. The lowest score wins, if it
wins by more than chance makes it win where nothing is hidden (`CLAIM`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.discrepancy.candidate import Candidate, with_obstacle
from pipeline.discrepancy.fit import MOST_ITERATIONS, fit, unstuck
from pipeline.discrepancy.frame_rate import is_standard
from pipeline.discrepancy.impact import Bounce, RestitutionFit, bounces, fit_restitution
from pipeline.discrepancy.model import Model, known_model, with_effect, without_effect
from pipeline.discrepancy.obstacle import fit_obstacle
from pipeline.discrepancy.problem import Problem, split_at_jumps, starts_of
from pipeline.discrepancy.quick import Guess, QuickRegression
from pipeline.discrepancy.starts import starts
from pipeline.discrepancy.testable import testable
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.registry import effect_kinds

CLAIM = 8.0  # by how much a first effect must win; frozen on development worlds (benchmarks/discovery.py)
CLAIM_MORE = 16.0  # the same for a second and a third
NEAR = 25.0  # candidates whose scores are so near the best are fitted from its initial states, too
ALIKE = 7.0  # effects whose scores differ by less are not told apart
WORTH_FITTING = 0.5  # share of the best quick gain that makes a further fit worth while
BEGINNINGS, MANY_BEGINNINGS = 2, 5  # starts of an effect that are fitted; of one that acts by the place
MOST_EFFECTS = 3
LEAST_CLIPS_FOR_MORE = 3  # fewer clips differ from each other in too many ways for two effects
UNEXPLAINED_Z, UNEXPLAINED_SHARE = 5.0, 0.015  # a model explains the data unless both are exceeded
UNEXPLAINED_OF_NOISE = 0.05  # and unless it is so much of the noise: the best of models are a little off
UNEXPLAINED_LOUD = 0.5  # of the noise: so much is too much whatever its share, where clips are enough to tell
UNEXPLAINED_SHARE_FEW = 0.06  # of one or two clips, whose own peculiarities nothing averages out
SCALES_GRAVITY = ("buoyancy", "clock_rate", "gravity_error", "length_scale")
SWALLOWED_SHARE = 1 / 3  # of what such a number explains: a law that explains as much may be what it stands for
SHUFFLED_SHARE = 0.5  # of the gain with a measured spin, that the spin of other clips may reach
OBSTACLE_MISFIT = 0.1  # m; friction of a hit turns its direction
FRICTIONS = (0.5, 0.2, 0.07)  # sliding friction, with which calibration begins
BROKEN_Z, BROKEN_SHARE = 6.0, 0.15  # arcs so far off, and so few, are left out
SHARPER = 0.9  # of the noise's variance as polynomials have it: what the best model must leave less than
EQUALS = 5  # further effects that are fitted because they promise nearly as much as the best
MOST_FITTED = 9  # effects that are fitted at a time, the most promising by the quick regression


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
    """Fits and scores models of one problem. `effects`: the names that may be answered."""

    def __init__(
        self, problem: Problem, effects: Sequence[str], progress: Callable[[str], None] = lambda _: None
    ) -> None:
        self.known, self.progress = problem.known, progress
        kinds = effect_kinds()
        self.kinds = [kinds[name] for name in effects if testable(kinds[name], problem)]
        self.untestable = tuple(name for name in effects if not testable(kinds[name], problem))
        self._pose(problem)

    def _pose(self, problem: Problem) -> None:
        """Calibrate the model without effects."""
        self.problem = problem
        self.sharper = 1.0
        self.restitution: RestitutionFit | None = None
        self.none = self._calibrated()
        clips = frozenset(problem.fitted)
        self.bounces = bounces(problem.impacts, problem.stacks, self.none.fit, self.known, clips)
        self.restitution = None if "damping" in self.known.fit else fit_restitution(self.bounces)
        self.none = self._with_bounces(self.none, False)

    def _calibrated(self) -> Candidate:
        """The model without effects, from several frictions: with too much of it bodies stop and nothing tells how
        much."""
        model = known_model(self.known, self.problem.stacks)
        sliding = [i for i, u in enumerate(model.unknowns) if u.name == "sliding_friction"]
        begin = starts_of(self.problem)
        best: Candidate | None = None
        for friction in FRICTIONS if sliding else (0.0,):
            theta = model.start
            theta[sliding] = friction
            found = self._fitted(self.problem, model, theta, begin, ())
            if best is None or found.bic < best.bic - 0.1:
                best = found
        assert best is not None
        return best

    def select(self) -> Selection:
        """The models that explain the measurements best."""
        beside_impacts = self._without_broken(self.none, beside_impacts=True)
        if beside_impacts is not None:
            self._pose(beside_impacts)
        singles = self._extended(self.none)
        best = self._best(singles)
        for _ in range(2):
            left_out = self._without_broken(best)
            if left_out is None:
                break
            self._pose(left_out)
            singles = self._extended(self.none)
            best = self._best(singles)
        singles = self._polished(best, singles)
        self._sharpen(best)
        self.none, singles = self._rescored(self.none), sorted(map(self._rescored, singles), key=lambda c: c.score)
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
            self.none, tuple(singles), chosen, alike, share, z, unknown or len(swallowed) > 0, tuple(self.bounces),
            self.untestable, ("clock_rate",) if any(self._clock_doubt(c) < 0 for c in singles) else (),
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
                again = self._fitted(c.problem, c.fit.model, c.fit.theta, best.fit.starts, c.effects)
                again = self._with_bounces(again, False)
                out[i] = again if again.score < c.score else c
        return out

    def _sharpen(self, best: Candidate) -> None:
        """Take the noise from the best model, where that leaves less than polynomials do: they miss what turns fast or
        stops suddenly."""
        freedom = best.problem.rows - best.own
        left = best.left / max(freedom, 1)
        if best.obstacle is None and freedom > 30 and left < SHARPER:
            self.sharper = 1 / left

    def _rescored(self, found: Candidate) -> Candidate:
        """The same with the noise that the best model leaves."""
        more = (self.sharper - 1) * self.problem.floor.information
        inside = more * found.fit.total(found.problem.chosen)
        outside = more * found.fit.total(found.problem.held)
        return replace(found, score=found.score + inside + outside, bic=found.bic + inside,
                       held_out=found.held_out + outside)  # fmt: skip

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
            if z < 2.5 and not (self.sharper > 1 and self._promises(chosen)):
                break
            longer = [c for leader in leaders for c in self._extended(leader, MOST_FITTED - 4)]
            winner = self._likeliest(longer, chosen)
            swapped = [
                c for c in singles if c.name == winner.effects[-1] and len(winner.effects) == 2 and c not in leaders
            ]
            for single in swapped:  # what the first effect had to make up for may now be had at a lower price
                longer += self._extended(single, MOST_FITTED - 4)
            tried += longer
            winner = self._likeliest(longer, chosen)
            if winner.score > chosen.score - CLAIM_MORE:
                break
            shorter = self._one_less(winner)
            tried += [c for c in shorter if len(c.effects) > 1]
            least = self._likeliest(shorter, winner)
            chosen = least if least.score < winner.score + CLAIM_MORE else winner
            leaders = [chosen]
        return chosen, tried

    def _one_less(self, found: Candidate) -> list[Candidate]:
        """`found` without one of its effects but the last: an effect that stood in for those that came after it is no
        longer needed with them."""
        out = []
        for name in found.effects[:-1]:
            if name not in found.fit.model.names:
                continue  # a restitution or an obstacle, which stand in for none
            model, kept = without_effect(found.fit.model, name)
            effects = tuple(e for e in found.effects if e != name)
            shorter = self._fitted(found.problem, model, found.fit.theta[kept], found.fit.starts, effects)
            shorter = self._with_bounces(shorter, "restitution" in effects)
            out.append(with_obstacle(shorter, found.obstacle, found.obstacle_price))
        return out

    def _promises(self, base: Candidate) -> bool:
        """Whether a further effect would win by the quick regression: where the noise is taken from the best model
        itself, what it leaves cannot tell that it is not enough."""
        quick = QuickRegression(base.problem.stacks, base.fit, base.problem.chosen)
        share = self.problem.floor.information * self.sharper
        for kind in self.kinds:
            if kind.name not in (*base.effects, "hidden_obstacle", "restitution"):
                gain = quick.guesses(kind, starts(kind, self.known, base.problem.stacks), self.known)[0].gain * share
                if gain > CLAIM_MORE + kind.size * np.log(self.problem.effective_rows):
                    return True
        return False

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

    def _extended(self, base: Candidate, most: int = MOST_FITTED) -> list[Candidate]:
        """`base` with one effect more, best first: the `most` that the quick regression finds promising, and its
        equals."""
        quick = QuickRegression(base.problem.stacks, base.fit, base.problem.chosen)
        out, promising = [], []
        for kind in self.kinds:
            if kind.name in base.effects:
                continue
            if kind.name in ("hidden_obstacle", "restitution"):
                found = self._special(kind, base)
                if found is not None:
                    out.append(found)
                continue
            guesses = quick.guesses(kind, starts(kind, self.known, base.problem.stacks), self.known)
            promising.append((kind, guesses))
        promising.sort(key=lambda pair: -pair[1][0].gain)
        enough = promising[0][1][0].gain * WORTH_FITTING if promising else 0.0
        for number, (kind, guesses) in enumerate(promising):
            if number < most or (guesses[0].gain > enough and number < most + EQUALS):
                self.progress(kind.name)
                found = self._one(kind, base, guesses)
                if found is not None:
                    out.append(found)
        return sorted(out, key=lambda c: c.score)

    def _one(self, kind: EffectKind, base: Candidate, guesses: Sequence[Guess]) -> Candidate | None:
        best: Candidate | None = None
        tried = _apart(guesses) if kind.name == "hidden_attractor" and not base.effects else guesses[:BEGINNINGS]
        for guess in tried:
            if guess is not guesses[0] and guess.gain < WORTH_FITTING / 2 * guesses[0].gain:
                continue
            model = with_effect(base.fit.model, kind, self.known)
            low, high = (
                np.array([getattr(u, k) for u in model.unknowns[base.fit.model.size :]]) for k in ("low", "high")
            )
            theta = np.concatenate([base.fit.theta, np.clip(guess.values, low, high)])
            found = self._fitted(base.problem, model, theta, base.fit.starts, (*base.effects, kind.name))
            balls = any(s.grounded and (s.radius > 0).any() for s in base.problem.stacks)
            if found.fit.slipping or (balls and not base.effects):
                again = self._fitted(
                    base.problem, model, self._unslipped(model, theta), starts_of(base.problem), found.effects
                )
                found = min(found, again, key=lambda c: c.score)
            found = self._with_bounces(found, "restitution" in base.effects)
            found = with_obstacle(found, base.obstacle, base.obstacle_price)
            if np.isfinite(found.score) and (best is None or found.score < best.score):
                best = found
        if best is not None and kind.name == "magnus_lift" and not self._spin_earns_its_place(base, best):
            return None
        return best

    def _unslipped(self, model: Model, theta: np.ndarray) -> np.ndarray:
        """theta with frictions as stated: without the effect they may have been far off to make up for it."""
        return np.where([u.owner.startswith("object:") for u in model.unknowns], model.start, theta)

    def _special(self, kind: EffectKind, base: Candidate) -> Candidate | None:
        if kind.name == "restitution":
            if self.restitution is None:
                return None
            return replace(self._with_bounces(self._unbounced(base), True), effects=(*base.effects, kind.name))
        obstacle = fit_obstacle(self.problem.arcs, self.known)
        if obstacle is None or obstacle.misfit > OBSTACLE_MISFIT or base.obstacle is not None:
            return None
        if 2 * obstacle.hits < self.problem.jumps:
            return None
        split = split_at_jumps(base.problem)  # also where an outlier jumps: its pieces are paid for
        found = self._fitted(split, base.fit.model, base.fit.theta, starts_of(split), (*base.effects, kind.name))
        lost = max(base.problem.rows - split.rows, 0)
        added = sum(map(len, split.stacks)) - sum(map(len, base.problem.stacks))
        price = (
            5 * np.log(self.problem.effective_rows) + 6 * added + lost
        )  # a sphere and how it bounces; free restarts overfit
        found = with_obstacle(found, obstacle, price)
        return self._with_bounces(found, "restitution" in base.effects)

    def _spin_earns_its_place(self, base: Candidate, found: Candidate) -> bool:
        """Whether the measured spins explain more than those of other clips in their places."""
        stacks = found.problem.stacks
        spins = np.concatenate([s.spin for s in stacks])
        if np.linalg.norm(spins - spins.mean(0), axis=1).mean() < 0.2 * np.linalg.norm(spins, axis=1).mean():
            return True  # all the same: shuffling says nothing
        gain = base.score - found.score
        if gain < CLAIM:
            return True
        shuffled = [replace(s, spin=np.roll(s.spin, max(1, len(s) // 2), axis=0)) for s in stacks]
        begin = [np.concatenate([b[:, :6], s.spin, b[:, 9:]], 1) if not s.grounded else b
                 for b, s in zip(found.fit.starts, shuffled, strict=True)]  # fmt: skip
        copy = replace(found.problem, stacks=tuple(shuffled))
        other = self._with_bounces(self._fitted(copy, found.fit.model, found.fit.theta, begin, found.effects),
                                   "restitution" in base.effects)  # fmt: skip
        return base.score - other.score < SHUFFLED_SHARE * gain

    def _fitted(
        self, problem: Problem, model: Model, theta: np.ndarray, begin: Sequence[np.ndarray], effects: tuple[str, ...]
    ) -> Candidate:
        iterations = MOST_ITERATIONS if len(effects) < 2 else MOST_ITERATIONS // 2
        found = fit(problem.stacks, model, theta, begin, problem.chosen, iterations)
        other = unstuck(problem.stacks, found)
        if other is not None:
            found = fit(problem.stacks, model, found.theta, other, problem.chosen, iterations)
        share = problem.floor.information * self.sharper
        inside, outside = found.total(problem.chosen) * share, found.total(problem.held) * share
        bic = inside + model.size * np.log(self.problem.effective_rows) + found.slip_price
        return Candidate(effects, found, problem, bic + outside, bic, outside)

    def _with_bounces(self, found: Candidate, free: bool) -> Candidate:
        """With the bounces' part of the score: as known damping has them, or with a restitution of their own."""
        if self.restitution is None:
            return found
        found = replace(found, restitution=self.restitution if free else None)
        term = self._bounce_chi2(found) + (np.log(max(len(self.bounces), 2)) if free else 0.0)
        return replace(found, score=found.score + term, bic=found.bic + term)

    def _unbounced(self, found: Candidate) -> Candidate:
        term = self._bounce_chi2(found)
        return replace(found, score=found.score - term, bic=found.bic - term)

    def _bounce_chi2(self, found: Candidate) -> float:
        """Chi squared of the bounces: by a restitution of their own, or as known damping has them."""
        if self.restitution is None:
            return 0.0
        return self.restitution.chi2 if found.restitution else self.restitution.chi2_expected

    def _of_noise(self, found: Candidate) -> float:
        """What a model leaves beyond noise, as a share of the noise."""
        left = found.left * self.sharper / max(found.problem.rows - found.own, 1) - 1
        if self.restitution is None:
            return left
        # bounces are few, and each is a measurement
        return max(left, self._bounce_chi2(found) / max(len(self.bounces), 1) - 1)

    def _excess(self, found: Candidate) -> tuple[float, float]:
        """What a model leaves beyond noise: as a z-score, and as a share of what the calibrated model leaves."""
        share = self.problem.floor.information * self.sharper

        def beyond(c: Candidate) -> tuple[float, float]:
            floor = sum(float(p.chi2.sum()) for p in c.problem.parts) / self.sharper
            smooth = sum(int(p.parameters.sum()) for p in c.problem.parts)
            return (c.left - floor) * share, max(smooth - c.own, 1)

        left, freedom = beyond(found)
        whole, freedom_none = beyond(self.none)
        bounce = self._bounce_chi2(found) - len(self.bounces) * (self.restitution is not None)
        z = (left + bounce - freedom) / np.sqrt(2 * (freedom + len(self.bounces)))
        whole += self._bounce_chi2(self.none) - freedom_none
        return float(z), float(np.clip((left + max(bounce, 0) - freedom) / max(whole, 1e-9), 0, 1))


def _apart(guesses: Sequence[Guess]) -> list[Guess]:
    """The best of the guesses of a place that are well apart from each other."""
    places = np.array([g.values[:3] for g in guesses])
    spacing = float(np.ptp(places, axis=0).max()) / 3
    out: list[Guess] = []
    for guess in guesses:
        if all(np.linalg.norm(guess.values[:3] - other.values[:3]) > spacing for other in out):
            out.append(guess)
    return out[:MANY_BEGINNINGS]
