"""A recording whose lengths are another multiple of the true ones than those of the other recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.least_squares import fit
from pipeline.discovery.fitting.predictions import SCALE_PLACE, free_state, linearise
from pipeline.discovery.fitting.priors import own_covariance
from pipeline.discovery.tracks.fault import Fault
from pipeline.discovery.tracks.problem import with_length_scale_nuisance
from pipeline.discovery.tracks.track import Track

WRONG_SCALES = 0.02  # prior: share of the recordings whose scale is wrong
SCALE_SIGMA = 0.1  # prior: by how much a wrong scale is off, relative
LEAST_RECORDINGS = 4  # of which one can differ from the others


def outlying_scale(found: Candidate) -> Fault | None:
    """The recording whose scale differs from the others', if one does by more than chance; None where none does.

    Each arc is fitted with a length scale of its own beside a model. A recording's scale is the mean of its arcs'. The
    scatter of the other recordings beyond their errors counts as error: where all differ, no single one is named.

    Args:
        found: The model.
    """
    problem = with_length_scale_nuisance(found.problem)
    if len(problem.clips) < LEAST_RECORDINGS or problem.one_camera:
        return None
    free = fit(problem.stacks, found.fit.model, found.fit.theta, found.fit.starts, problem.chosen)
    linear = linearise(problem.stacks, free.model, free.theta, free.starts)
    clips = list(dict.fromkeys(arc.clip for arc in problem.arcs))
    scale, precision = np.zeros(len(clips)), np.zeros(len(clips))
    for stack, start, local, chi2 in zip(problem.stacks, free.starts, linear.local, free.position_chi2, strict=True):
        place = int(np.flatnonzero(free_state(stack) == SCALE_PLACE)[0])
        variance = own_covariance(stack, local)[:, place, place]
        misfit = np.maximum(chi2 / np.maximum(stack.free_rows(problem.floor.information), 1.0), 1.0)
        prior = 1 / stack.length_scale_sigma**2
        of_data = np.maximum(1 / variance - prior, 0.0) * problem.floor.information / misfit  # without the prior
        mean = start[:, SCALE_PLACE] / np.maximum(1 - prior * variance, 1e-9)
        recording = [clips.index(problem.arcs[i].clip) for i in stack.index]
        np.add.at(scale, recording, of_data * mean)
        np.add.at(precision, recording, of_data)
    told = precision > 0
    if told.sum() < LEAST_RECORDINGS:
        return None
    mean, variance = scale[told] / precision[told], 1 / precision[told]
    off, gains = zip(*(_outlying(mean, variance, k) for k in range(len(mean))), strict=True)
    k = int(np.argmax(gains))
    if gains[k] < -2 * np.log(WRONG_SCALES):
        return None
    return Fault("recording_scale", 1 + off[k], "-", clips[int(np.flatnonzero(told)[k])])


def _mean(values: np.ndarray, variance: np.ndarray) -> float:
    return float((values / variance).sum() / (1 / variance).sum())


def _outlying(mean: np.ndarray, variance: np.ndarray, k: int) -> tuple[float, float]:
    """By how much one recording differs from the others, and twice the log evidence that it does.

    The scatter of the others counts as error, known from so many of them (Student's distribution); by how much a wrong
    scale is off has a normal prior.
    """
    values, own = np.delete(mean, k), np.delete(variance, k)
    off, count = float(mean[k] - _mean(values, own)), len(values)
    noise = (float(variance[k]) + max(float(np.var(values, ddof=1)) - float(own.mean()), 0.0)) * (1 + 1 / count)
    with_prior = noise + SCALE_SIGMA**2
    by_chance, by_fault = (count * np.log1p(off**2 / v / (count - 1)) for v in (noise, with_prior))
    return off, float(by_chance - by_fault - np.log(with_prior / noise))


def with_true_scale(tracks: Sequence[Track], fault: Fault) -> list[Track]:
    """The tracks, those of the recording with a wrong scale divided by it."""
    return [replace(t, position=t.position / fault.size) if t.clip == fault.clip else t for t in tracks]
