"""A law and the region in which it acts, fitted to what the known scene leaves of the measured paths.

A simulation that enters the region at another place goes astray. So the law is evaluated along the measured paths, on
short pieces that stay near them: the fit then converges from poor starts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.discovery.fitting.calibration import LEAST_BETTER
from pipeline.discovery.fitting.initial_states import initial_states
from pipeline.discovery.fitting.least_squares import fit_initial_states
from pipeline.discovery.fitting.model import Model, with_effect
from pipeline.discovery.fitting.screening import BATCH, starts
from pipeline.discovery.tracks.problem import Problem
from pipeline.discovery.where.clean_part import short_motions, short_parts
from pipeline.discovery.where.path_evidence import Paths, explained
from pipeline.discovery.where.region_search import HALVINGS, RegionSearch, samples_inside
from pipeline.scene.effects.discovery_rules import Start
from pipeline.scene.effects.kind import EffectKind
from pipeline.scene.effects.region import Region

ROUNDS = 12  # region and numbers in turn
STEP = 2e-3  # of a parameter's scale, of finite differences
Place = tuple[Region, tuple[int, ...] | None]
"""A region, and the objects in it; None: all."""


@dataclass(frozen=True)
class LocalLaw:
    """A law in a region: kind; numbers (k,); region, and the objects on which it acts, None: all; gain: by how much chi
    squared falls, less the price of all numbers."""

    kind: EffectKind
    numbers: np.ndarray
    region: Region
    objects: tuple[int, ...] | None
    gain: float


@dataclass(frozen=True)
class _LawForces:
    """The regression on a law near some numbers: fields, per part (1 + D, n, 3) m/s², the law's and its changes."""

    paths: Paths
    fields: list[np.ndarray]
    price: float

    def gains(self, inside: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(R,) as `SimpleForces.gains`."""
        return self.solved(inside)[0]

    def solved(self, inside: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(R,) by how much chi squared falls, less the price, and (R, D) amplitudes of the changes."""
        normal, reach = self.paths.normals(self.fields, inside)
        right, square = reach[:, 1:] - normal[:, 1:, 0], normal[:, 1:, 1:]
        gain = 2 * reach[:, 0] - normal[:, 0, 0] + explained(square, right)
        amplitude = (np.linalg.pinv(square, hermitian=True) @ right[..., None])[..., 0]
        return gain - self.price, amplitude

    def gains_of_each(self, inside: np.ndarray) -> np.ndarray:
        """(1 + D,) the same in one region (1, S), with the law's numbers and with each change."""
        normal, reach = self.paths.normals(self.fields, inside)
        change = np.eye(normal.shape[-1])
        change[:, 0] = 1.0
        square = np.einsum("ij,jk,ik->i", change, normal[0], change)
        return np.asarray(2 * change @ reach[0] - square - self.price)


@dataclass(frozen=True)
class LawFits:
    """Fits of laws in regions to the paths of a problem.

    Attributes:
        problem: Whose known scene states the fitted free numbers.
        pieces: Its short pieces.
        states: Per stack of the pieces (A, 11), initial states.
        model: Of the known scene.
        theta: (G,) its free numbers.
        paths: What they leave.
    """

    problem: Problem
    pieces: Problem
    states: list[np.ndarray]
    model: Model
    theta: np.ndarray
    paths: Paths

    @staticmethod
    def of(problem: Problem, model: Model, theta: np.ndarray, paths: Paths) -> LawFits:
        """The fits for what a model leaves at theta (G,)."""
        pieces = short_parts(problem)
        pairs = zip(pieces.stacks, initial_states(pieces), strict=True)
        states = [fit_initial_states(stack, model, theta, begin)[0] for stack, begin in pairs]
        return LawFits(problem, pieces, states, model, theta, paths)

    def best(self, kind: EffectKind, places: Sequence[Place], most: int, *, stay: bool = False) -> LocalLaw | None:
        """A law with the numbers and in the region that explain most; None where it shows nothing.

        Args:
            kind: Of the law.
            places: Where the search begins.
            most: Starts, each of some numbers in a place, from which the law is fitted: the most promising.
            stay: The regions stay as they are.
        """
        if not places:
            return None
        begin = starts(kind, self.problem)
        begun: list[tuple[float, int, np.ndarray]] = []
        samples, clips = self.paths.samples, self.problem.clips
        inside = np.stack([samples_inside(samples, clips, *place) for place in places])
        paid = self.paths.price * np.array([region.numbers + (bodies is not None) for region, bodies in places])
        for start, forces in zip(begin, self._near(kind, begin), strict=True):
            gains, amplitudes = forces.solved(inside)
            numbers = start.centre + amplitudes @ start.directions
            begun += zip((gains - paid).tolist(), range(len(places)), numbers, strict=True)
        begun = sorted((b for b in begun if b[0] > 0), key=lambda b: -b[0])
        ends = [self._fitted(kind, numbers, places[k], stay) for _, k, numbers in begun[:most]]
        return max(ends, key=lambda law: law.gain, default=None)

    def _fitted(self, kind: EffectKind, numbers: np.ndarray, place: Place, stay: bool) -> LocalLaw:
        """A law fitted from numbers (k,) and a region, which are moved in turn as long as that explains more."""
        low, high, scale = (
            np.concatenate([np.full(p.length, getattr(p, name)) for p in kind.parameters])
            for name in ("low", "high", "scale")
        )
        region, steps = place[0], STEP * np.diag(scale)
        numbers, best = np.clip(numbers, low, high), -np.inf
        for _ in range(ROUNDS):
            (forces,) = self._near(kind, [Start(numbers, steps)])
            if not stay:
                search = RegionSearch(self.paths, forces, self.problem.clips, place[1])
                region = search.improved(search.tried([region], 1)[0]).region
            inside = samples_inside(self.paths.samples, self.problem.clips, region, place[1])[None]
            change = forces.solved(inside)[1][0] @ steps
            moved = np.clip(numbers + np.outer([0, *0.5 ** np.arange(HALVINGS)], change), low, high)
            (forces,) = self._near(kind, [Start(moved[0], moved[1:] - moved[0])])
            gains = forces.gains_of_each(inside)
            numbers, before = moved[int(gains.argmax())], best
            best = float(gains.max()) - self.paths.price * (region.numbers + (place[1] is not None))
            if best < before + LEAST_BETTER:
                break
        return LocalLaw(kind, numbers, region, place[1], best)

    @cached_property
    def _without(self) -> list[np.ndarray]:
        """Per part (n, 3) m/s², what the known scene makes of it."""
        return [own[0] for own in self._accelerations(self.model, self.theta[None])]

    def _near(self, kind: EffectKind, begin: Sequence[Start]) -> list[_LawForces]:
        """The forces of a law with each start's numbers, and their changes by its directions; none where the motion
        diverges."""
        model = with_effect(self.model, replace(kind, only=None, bodies=None), self.problem.known)
        own = np.vstack([np.vstack([s.centre, s.centre + s.directions]) for s in begin])
        theta = np.hstack([np.tile(self.theta, (len(own), 1)), own])
        with np.errstate(all="ignore"):
            found = [a - base for a, base in zip(self._accelerations(model, theta), self._without, strict=True)]
        diverges = ~np.all([np.isfinite(a).all((1, 2)) for a in found], axis=0)
        for a in found:
            a[diverges] = 0.0
        out, place = [], 0
        for start in begin:
            rows = slice(place, place + 1 + len(start.directions))
            place = rows.stop
            fields = [np.concatenate([a[rows][:1], a[rows][1:] - a[rows][:1]]) for a in found]
            out.append(_LawForces(self.paths, fields, self.paths.price * kind.size))
        return out

    def _accelerations(self, model: Model, theta: np.ndarray) -> list[np.ndarray]:
        """Per part (P, n, 3) m/s² at theta (P, G)."""
        out: list[list[np.ndarray]] = [[] for _ in self.paths.parts]
        for first in range(0, len(theta), BATCH):
            motions = short_motions(self.problem, self.pieces, self.states, model, theta[first : first + BATCH])
            for rows, part in zip(out, self.paths.parts, strict=True):
                rows += [m.at(self.paths.samples.time[part.rows]) for m in motions[part.arc]]
        return [np.stack(rows) for rows in out]
