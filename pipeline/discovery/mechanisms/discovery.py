"""Discovery for a mechanism as a whole: from a log and a user's model to a verdict with its reasons."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from pipeline.discovery.fitting.estimates import ParameterEstimate
from pipeline.discovery.mechanisms.disagreement import MissingForce, disagreement, missing_forces, row, where_dict
from pipeline.discovery.mechanisms.estimates import calibrated, effect_estimates
from pipeline.discovery.mechanisms.form import missing_form
from pipeline.discovery.mechanisms.free_numbers import free_numbers
from pipeline.discovery.mechanisms.gap import gap_unit, measure_gap
from pipeline.discovery.mechanisms.log import Log
from pipeline.discovery.mechanisms.mechanism import Mechanism
from pipeline.discovery.mechanisms.noise import channel_noise
from pipeline.discovery.mechanisms.places import places_of
from pipeline.discovery.mechanisms.problem import Problem
from pipeline.discovery.mechanisms.registry import mechanism_effects
from pipeline.discovery.mechanisms.selection import MechanismSelection, select_mechanism
from pipeline.discovery.mechanisms.simulation import Simulator, with_sensors
from pipeline.discovery.mechanisms.windows import halves, levels
from pipeline.discovery.report.discovery import MOST_DISAGREEMENTS, UNKNOWN, NamedEffect, Verdict
from pipeline.discovery.report.remainder import MOST_CANDIDATES, Remainder
from pipeline.discovery.report.report_dict import candidate_rows, gap_dict, verdict_dict
from pipeline.discovery.selection.confidence import IMPERFECT, confidence_by_margin, probabilities
from pipeline.discovery.selection.equivalence import next_experiment
from pipeline.discovery.selection.gap import Gap
from pipeline.discovery.selection.shorter import LEAST_REMAINDER
from pipeline.discovery.selection.unexplained import UNEXPLAINED_Z

METRIC = "joint_rmse"


@dataclass(frozen=True)
class MechanismDiscovery:
    """Everything that was found.

    Attributes:
        selection: The models that were compared.
        verdict: The answer.
        calibrated: The numbers that the user listed as not known, without effects.
        gap: Before and after, in `unit`.
        unit: rad or m.
        disagreement: Windows in which something is missing, the strongest first.
        probability: Of `none`, `unknown` and each candidate.
        notes: What a reader should know beside the verdict, a sentence each.
    """

    selection: MechanismSelection
    verdict: Verdict
    calibrated: dict[str, ParameterEstimate]
    gap: Gap
    unit: str
    disagreement: tuple[MissingForce, ...]
    probability: dict[str, float]
    notes: tuple[str, ...]

    @property
    def problem(self) -> Problem:
        """What was fitted."""
        return self.selection.none.problem

    def report(self) -> dict[str, Any]:
        """The discovery as plain numbers, texts, lists and mappings: report.json (docs/formats.md, "Discovery")."""
        found, problem = self.selection, self.problem
        columns = {
            c.column: {"sigma": float(s), "unit": c.unit}
            for c, s in zip(problem.log.channels, problem.sigma, strict=True)
        }
        return {
            "noise": {
                "position_m": _noise(columns, "m"),
                "orientation_rad": _noise(columns, "rad"),
                "columns": columns,
            },
            "clips": problem.clips,
            "calibrated": {k: e.as_dict() for k, e in self.calibrated.items()},
            "disagreement": [row(f) for f in self.disagreement],
            "faults": [],
            "where": where_dict(found.short),
            "candidates": candidate_rows(found, self.probability, effect_estimates),
            "verdict": verdict_dict(self.verdict),
            "gap": gap_dict(self.gap, METRIC, self.unit),
            "probability_of_none": self.probability["none"],
            "unexplained": {"share": self.gap.left, "z_score": found.excess_z},
            "notes": list(self.notes),
        }


def discover_mechanism(
    log: Log,
    mechanism: Mechanism,
    held_out: float,
    effects: Sequence[str],
    fit: Sequence[str],
    rng: np.random.Generator,
    *,
    progress: Callable[[str], None] = lambda _: None,
) -> MechanismDiscovery:
    """Find out which effects a log supports that the user's model lacks.

    Args:
        log: Of the real mechanism.
        mechanism: The user's model.
        held_out: Share of the clips, or of the time of the only one, that is not fitted, but scored.
        effects: Names of the effects that may be answered.
        fit: Numbers of the model that are not known (`elbow.damping`).
        rng: Chooses the clips that are held out.
        progress: Called with the name of each effect that is fitted.

    Raises:
        MeasurementError: For a log that is too short.
        ParamsError: For a name that is not known.
    """
    places = places_of(mechanism, log)
    numbers = free_numbers(fit, mechanism, places)
    simulator = Simulator(mechanism, log, with_sensors(mechanism.physics, log.channels))
    problem = Problem(mechanism, log, simulator, (), channel_noise(log), places)
    own = 2 * mechanism.model.nv + mechanism.model.na
    cuts = levels(log, halves(log, held_out, rng), own)
    kinds = tuple(kind for name, kind in mechanism_effects().items() if name in effects)
    found = select_mechanism([problem.cut(windows) for windows in reversed(cuts)], numbers, kinds, progress)
    gap = measure_gap(found.none, found.answer)
    return MechanismDiscovery(
        selection=found,
        verdict=_verdict(found, gap),
        calibrated=calibrated(found.none),
        gap=gap,
        unit=gap_unit(found.none),
        disagreement=tuple(disagreement(found.short)[:MOST_DISAGREEMENTS]),
        probability=probabilities(found),
        notes=(*log.notes, *_notes(found)),
    )


def _verdict(found: MechanismSelection, gap: Gap) -> Verdict:
    answer, kinds = found.answer, mechanism_effects()
    names = (UNKNOWN,) if found.unknown else answer.effects
    own = {name: effect_estimates(answer, name) for name in answer.effects}
    several = len(own) > 1
    equivalent = () if found.unknown else found.alike
    sure = confidence_by_margin(found, names)
    if _leaves_more(found, gap) and not found.unknown:
        sure = min(sure, IMPERFECT)
    shares = _shares(found)
    return Verdict(
        effects=names,
        parameters={f"{n}.{k}" if several else k: e for n, numbers in own.items() for k, e in numbers.items()},
        confidence=sure,
        equivalent=equivalent,
        experiment=next_experiment(names, equivalent, kinds),
        form=missing_form(found.short) if found.unknown else None,
        named=tuple(NamedEffect(n, sure, shares.get(n), numbers) for n, numbers in own.items()),
        remainder=_remainder(found, gap),
    )


def _leaves_more(found: MechanismSelection, gap: Gap) -> bool:
    """Whether the answer leaves more than noise."""
    return found.unknown or (found.excess_z > UNEXPLAINED_Z and gap.after > LEAST_REMAINDER * gap.noise_floor)


def _shares(found: MechanismSelection) -> dict[str, float]:
    """Each named effect's share of the explained chi squared, by the models without it."""
    answer = found.answer
    if len(answer.effects) == 1:
        return {answer.effects[0]: 1.0}
    models = {c.effects: c for c in (*found.singles, *found.tried)}
    lost = {}
    for name in answer.effects:
        shorter = [c for effects, c in models.items() if set(effects) == set(answer.effects) - {name}]
        if shorter:
            lost[name] = max(min(c.score for c in shorter) - answer.score, 0.0)
    whole = sum(lost.values())
    return {n: v / whole for n, v in lost.items()} if whole else {}


def _remainder(found: MechanismSelection, gap: Gap) -> Remainder | None:
    """What is left unexplained; None where that is noise."""
    if not _leaves_more(found, gap):
        return None
    named = set(found.answer.effects)
    longer = [c for c in (found.tried if named else found.singles) if named < set(c.effects)]
    better = sorted((c for c in longer if c.score < found.answer.score), key=lambda c: c.score)
    candidates = tuple(dict.fromkeys(n for c in better for n in c.effects if n not in named))[:MOST_CANDIDATES]
    off = missing_forces(found.answer)
    loud = [f for f in off if f.z >= UNEXPLAINED_Z]
    return Remainder(
        share=gap.left,
        noise_floors=gap.after / gap.noise_floor if gap.noise_floor else 0.0,
        regimes=tuple(dict.fromkeys(f.regime for f in loud)),
        objects=tuple(dict.fromkeys(f.joint for f in loud)),
        form=missing_form(found.short) if found.unknown else "not found",
        candidates=candidates,
        experiment=next_experiment(candidates or (UNKNOWN,), (), mechanism_effects()),
    )


def _notes(found: MechanismSelection) -> tuple[str, ...]:
    problem, out = found.none.problem, []
    count, step = len(problem.windows), problem.simulator.step
    stated = problem.mechanism.model.opt.timestep
    if problem.ahead:
        out.append("there is only one clip: its end is forecast from the state in which it began")
    if count > len(problem.log.clips):
        seconds = [np.ptp(problem.log.clips[w.clip].time[w.rows]) for w in problem.windows]
        out.append(
            f"longer predictions leave the motion: the log was cut into {count} windows of {np.median(seconds):.2g} s"
        )
    if not found.stated_steps:
        integrator = mujoco.mjtIntegrator(int(problem.simulator.spec.option.integrator)).name.removeprefix("mjINT_")
        out.append(
            f"the log does not follow the model's own time steps: augmented.xml has steps of {step:g} s, {integrator}"
        )
    elif step != stated:
        out.append(f"simulated with time steps of {step:g} s, which predict the same as {stated:g} s, but for noise")
    if found.noise.variance > LEAST_REMAINDER**2:
        out.append(
            f"the best model leaves {found.noise.variance**0.5:.2g} times the noise of the sensors, counted as noise"
        )
    silent = sorted(set(problem.mechanism.actuators) - set(problem.log.driven))
    if silent:
        out.append("no control was logged, and 0 is assumed: " + ", ".join(silent))
    hidden = sorted({j.name for j in problem.mechanism.joints} - set(problem.log.joints))
    if hidden:
        out.append("not measured: " + ", ".join(hidden))
    apart = [n for n in found.answer.effects if mechanism_effects()[n].of_measurement]
    if apart:
        out.append(f"of the measurement, and not in augmented.xml: {', '.join(apart)}")
    if found.untestable:
        out.append("not testable with this log: " + ", ".join(found.untestable))
    return tuple(out)


def _noise(columns: dict[str, dict[str, Any]], unit: str) -> float | None:
    sigma = [c["sigma"] for c in columns.values() if c["unit"] == unit]
    return float(np.median(sigma)) if sigma else None
