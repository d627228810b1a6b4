"""How round bodies turn, from their texture."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from pipeline.search.outlines.spin import about


def test_rotations_about_vectors_are_those_of_rodrigues() -> None:
    vectors = np.random.default_rng(0).normal(size=(40, 3))
    vectors[0] = 0
    np.testing.assert_allclose(about(vectors, 0.7), Rotation.from_rotvec(0.7 * vectors).as_matrix(), atol=1e-12)
