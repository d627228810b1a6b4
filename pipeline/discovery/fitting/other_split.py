"""Models of one problem, fitted again with another clip held out."""

from __future__ import annotations

from collections.abc import Sequence

from pipeline.discovery.fitting.calibration import Calibration, calibration_of, fit_model
from pipeline.discovery.fitting.candidate import Candidate
from pipeline.discovery.fitting.extension import completed
from pipeline.discovery.tracks.problem import hold_out


def hold_out_instead(
    calibration: Calibration, models: Sequence[Candidate], clip: str
) -> tuple[Calibration, tuple[Candidate, ...]] | None:
    """The calibration and some models, fitted to all clips but one; None where the others do not determine them.

    The fits begin where the models' own fits ended.

    Args:
        calibration: Of the problem.
        models: Fitted to it.
        clip: Name of the clip that is held out.
    """
    problem = hold_out(calibration.problem, (clip,))
    if not any(chosen.any() for chosen in problem.chosen):
        return None
    none = _fitted_again(calibration, calibration.none, clip)
    again = calibration_of(problem, none, calibration.noise_scale)
    if again.restitution is None and any(model.restitution is not None for model in models):
        return None
    return again, tuple(
        again.none if model is calibration.none else completed(again, _fitted_again(calibration, model, clip), model)
        for model in models
    )


def _fitted_again(calibration: Calibration, model: Candidate, clip: str) -> Candidate:
    """A model fitted without a clip; its score has no part of bounces and hits."""
    problem = hold_out(model.problem, (clip,))
    return fit_model(calibration, problem, model.fit.model, model.fit.theta, model.fit.starts, effects=model.effects)
