import numpy as np

from pipeline.scene.rotation import (
    integrate,
    matrix_from_quaternion,
    quaternion_conjugate,
    quaternion_from_rotation_vector,
    quaternion_multiply,
    rotate,
)


def unit_quaternions(rng: np.random.Generator, *shape: int) -> np.ndarray:
    q = rng.normal(size=(*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def test_matrices_are_rotations_whatever_the_quaternions_length(rng: np.random.Generator) -> None:
    q = unit_quaternions(rng, 3, 5)
    matrices = matrix_from_quaternion(7.0 * q)
    assert matrices.shape == (3, 5, 3, 3)
    np.testing.assert_allclose(matrices, matrix_from_quaternion(q), atol=1e-12)
    np.testing.assert_allclose(
        matrices @ matrices.swapaxes(-1, -2), np.broadcast_to(np.eye(3), matrices.shape), atol=1e-12
    )
    np.testing.assert_allclose(np.linalg.det(matrices), 1.0)


def test_a_product_of_quaternions_is_the_product_of_their_matrices(rng: np.random.Generator) -> None:
    a, b = unit_quaternions(rng, 6), unit_quaternions(rng, 6)
    product = matrix_from_quaternion(a) @ matrix_from_quaternion(b)
    np.testing.assert_allclose(matrix_from_quaternion(quaternion_multiply(a, b)), product, atol=1e-12)


def test_the_conjugate_turns_back(rng: np.random.Generator) -> None:
    q, v = unit_quaternions(rng, 4), rng.normal(size=(4, 3))
    np.testing.assert_allclose(rotate(quaternion_conjugate(q), rotate(q, v)), v, atol=1e-12)


def test_a_quarter_turn_about_z_takes_x_to_y() -> None:
    q = quaternion_from_rotation_vector(np.array([0.0, 0.0, np.pi / 2]))
    np.testing.assert_allclose(rotate(q, np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-12)


def test_no_turn_is_the_identity() -> None:
    np.testing.assert_array_equal(quaternion_from_rotation_vector(np.zeros((2, 3))), np.tile([1.0, 0, 0, 0], (2, 1)))


def test_integrating_moves_points_by_the_cross_product_with_the_angular_velocity(rng: np.random.Generator) -> None:
    q, omega, arm = unit_quaternions(rng), rng.normal(size=3), rng.normal(size=3)
    h = 1e-5
    speed = (rotate(integrate(q, omega, h), arm) - rotate(integrate(q, omega, -h), arm)) / (2 * h)
    np.testing.assert_allclose(speed, np.cross(omega, rotate(q, arm)), atol=1e-7)


def test_two_steps_at_one_angular_velocity_are_one_long_step(rng: np.random.Generator) -> None:
    q, omega = unit_quaternions(rng), rng.normal(size=3)
    np.testing.assert_allclose(integrate(integrate(q, omega, 0.3), omega, 0.4), integrate(q, omega, 0.7), atol=1e-12)
