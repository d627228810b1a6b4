"""Where a model and the measurements disagree: short stretches, with the missing force and its significance."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate, residuals_m
from pipeline.discovery.fitting.predictions import run
from pipeline.discovery.tracks.arc import FAR_AWAY
from pipeline.discovery.tracks.stack import ArcStack
from pipeline.scene.effects.kind import Regime

WINDOW = 0.2  # s
LEAST_SAMPLES = 5
SLIPS, MOVES, SPINS = 0.05, 0.03, 1.0  # m/s, m/s, rad/s above which a body on the ground slides, moves, spins
ALIGNED = 15  # degrees within which a direction is named without a deviation


@dataclass(frozen=True)
class Stretch:
    """A short stretch of an arc.

    Attributes:
        clip: Which recording.
        object: Index of the object in the scene.
        start: s.
        end: s.
        regime: What the body is doing.
        force: (3,) N, what the model lacks.
        stderr: N, of each component.
        z: Significance of the force, in standard deviations of a normal distribution.
        velocity: (3,) m/s.
        towards: (3,) m, from the body to another object; None without one.
        unit: Of force and stderr: N, or N s of a blow.
    """

    clip: str
    object: int
    start: float
    end: float
    regime: Regime
    force: np.ndarray
    stderr: float
    z: float
    velocity: np.ndarray
    towards: np.ndarray | None
    unit: str = "N"


def stretches(found: Candidate) -> list[Stretch]:
    """The stretches of all arcs of a model's problem, the most significant first."""
    out: list[Stretch] = []
    problem = found.problem
    share = np.sqrt(problem.floor.information)
    for stack, start, rows in zip(problem.stacks, found.fit.starts, residuals_m(problem, found), strict=True):
        _, nodes = run(stack, found.fit.model, found.fit.theta[None], start[None])
        for i in range(len(stack)):
            arc = problem.arcs[stack.index[i]]
            there = stack.weight[i].max(1) > 0
            if not there.any():
                continue
            t, r = stack.time[i, there], rows[i, there]
            sigma = 1 / stack.weight[i].max()
            count = max(1, round(stack.duration[i] / WINDOW))
            edges = np.linspace(0, stack.duration[i] + 1e-9, count + 1)
            for left, right in itertools.pairwise(edges):
                inside = (t >= left) & (t < right)
                if inside.sum() < LEAST_SAMPLES:
                    continue
                tau = t[inside] - t[inside].mean()
                design = np.column_stack([np.ones_like(tau), tau, tau * tau / 2])
                inverse = np.linalg.pinv(design.T @ design)
                acceleration = (inverse @ (design.T @ r[inside]))[2]
                error = sigma * np.sqrt(inverse[2, 2]) / share
                node = int((left + right) / 2 / max(stack.duration[i], 1e-9) * stack.steps)
                velocity, spin = nodes.velocity[0, i, node], nodes.angular_velocity[0, i, node]
                others = stack.others[i, 2 * node]
                near = others[np.abs(others).max(1) < FAR_AWAY] if len(others) else others
                out.append(
                    Stretch(
                        clip=arc.clip,
                        object=arc.object,
                        start=float(stack.start[i] + left),
                        end=float(stack.start[i] + right),
                        regime=regime_of(stack, i, velocity, spin),
                        force=acceleration * stack.mass[i],
                        stderr=float(error * stack.mass[i]),
                        z=normal_z(float((acceleration**2).sum() / error**2)),
                        velocity=velocity,
                        towards=near[0] - nodes.position[0, i, node] if len(near) else None,
                    )
                )
    return sorted(out, key=lambda s: -s.z)


def normal_z(chi2: float) -> float:
    """A chi squared of three degrees of freedom as standard deviations (Wilson and Hilferty's cube root)."""
    return float(((chi2 / 3) ** (1 / 3) - (1 - 2 / 27)) / np.sqrt(2 / 27))


def regime_of(stack: ArcStack, i: int, velocity: np.ndarray, spin: np.ndarray) -> Regime:
    """What the body of arc i is doing, from its velocity (3,) m/s and angular velocity (3,) rad/s."""
    if not stack.grounded:
        return Regime.FLIGHT
    speed = float(np.linalg.norm(velocity[:2]))
    radius = stack.radius[i]
    slip = speed if radius == 0 else float(np.hypot(velocity[0] - spin[1] * radius, velocity[1] + spin[0] * radius))
    if slip > SLIPS:
        return Regime.SLIDING
    if speed > MOVES:
        return Regime.ROLLING
    return Regime.SPINNING if abs(spin[2]) > SPINS else Regime.RESTING


def direction_words(s: Stretch) -> str:
    """The direction of a stretch's force in words, relative to the vertical, the velocity or another object."""
    size = float(np.linalg.norm(s.force))
    if size == 0:
        return "none"
    unit = s.force / size
    speed = float(np.linalg.norm(s.velocity))
    named = [("up", np.array([0, 0, 1.0])), ("down", np.array([0, 0, -1.0]))]
    if speed > 1e-3:
        ahead = s.velocity / speed
        side = np.cross([0, 0, 1.0], ahead)
        named += [("along the velocity", ahead), ("against the velocity", -ahead)]
        if np.linalg.norm(side) > 1e-6:
            side = side / np.linalg.norm(side)
            named += [("across the velocity, to the left", side), ("across the velocity, to the right", -side)]
    if s.towards is not None and np.linalg.norm(s.towards) > 1e-6:
        there = s.towards / np.linalg.norm(s.towards)
        named += [("towards the other object", there), ("away from the other object", -there)]
    words, along = max(((w, float(unit @ d)) for w, d in named), key=lambda pair: pair[1])
    angle = np.degrees(np.arccos(np.clip(along, -1, 1)))
    return words if angle < ALIGNED else f"{words}, {angle:.0f} degrees off"
