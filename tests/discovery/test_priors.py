"""Priors of the arcs' own parameters."""

import numpy as np
import pytest
from small_world import KNOWN, thrown

from pipeline.discovery.fitting.least_squares import LARGEST
from pipeline.discovery.fitting.predictions import free_state
from pipeline.discovery.fitting.priors import own_covariance, own_precision
from pipeline.discovery.tracks.known_scene import known_scene
from pipeline.discovery.tracks.problem import build_problem


def test_where_a_motion_diverges_initial_states_still_have_a_covariance(rng: np.random.Generator) -> None:
    (stack,) = build_problem(thrown(rng, spin=False), known_scene(KNOWN), 0.3, rng).stacks
    bound = np.full((len(stack), len(free_state(stack)), 30), LARGEST)  # all derivatives
    assert np.isfinite(own_covariance(stack, bound)).all()


def test_the_covariance_is_the_inverse_of_the_precision(rng: np.random.Generator) -> None:
    (stack,) = build_problem(thrown(rng), known_scene(KNOWN), 0.3, rng).stacks
    local = rng.normal(size=(len(stack), len(free_state(stack)), 40))
    product = own_covariance(stack, local) @ own_precision(stack, local)
    assert product == pytest.approx(np.broadcast_to(np.eye(local.shape[1]), product.shape), abs=1e-6)
