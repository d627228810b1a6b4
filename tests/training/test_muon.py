"""Muon: momentum with orthogonalised updates."""

import pytest
import torch

from training.muon import Muon, orthogonalised

SHAPES = ((12, 20), (12, 20), (20, 12), (12, 20), (8, 4, 3, 3), (8, 4, 3, 3))


def weights_and_gradients(steps: int) -> tuple[list[torch.Tensor], list[list[torch.Tensor | None]]]:
    """Weights of SHAPES and for each step their gradients; in the first step one of them has none."""
    generator = torch.Generator().manual_seed(5)
    weights = [torch.randn(s, generator=generator) for s in SHAPES]
    gradients: list[list[torch.Tensor | None]] = [
        [torch.randn(s, generator=generator) for s in SHAPES] for _ in range(steps)
    ]
    gradients[0][1] = None
    return weights, gradients


def stepped(weights: list[torch.Tensor], gradients: list[list[torch.Tensor | None]], lr: float, decay: float):
    """Copies of the weights after a step with each of the gradients."""
    weights = [w.clone().requires_grad_() for w in weights]
    optimiser = Muon(weights, lr=lr, weight_decay=decay)
    for row in gradients:
        for weight, gradient in zip(weights, row, strict=True):
            weight.grad = gradient
        optimiser.step()
    return [w.detach() for w in weights]


@pytest.mark.parametrize("decay", [0.0, 0.1])
def test_steps_of_stacked_matrices_equal_the_steps_of_each_alone(decay: float) -> None:
    weights, gradients = weights_and_gradients(4)
    together = stepped(weights, gradients, 0.02, decay)
    for k, weight in enumerate(weights):
        alone = stepped([weight], [[row[k]] for row in gradients], 0.02, decay)[0]
        torch.testing.assert_close(together[k], alone, rtol=1e-5, atol=1e-6)


def test_the_length_of_a_step_does_not_depend_on_the_gradients_length() -> None:
    weights, gradients = weights_and_gradients(3)
    longer: list[list[torch.Tensor | None]] = [[None if g is None else 1000 * g for g in row] for row in gradients]
    for a, b in zip(stepped(weights, gradients, 0.02, 0.0), stepped(weights, longer, 0.02, 0.0), strict=True):
        torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


def test_an_orthogonalised_matrix_keeps_its_singular_vectors_and_has_singular_values_near_one() -> None:
    generator = torch.Generator().manual_seed(6)
    matrices = torch.randn(3, 24, 10, generator=generator)
    u, _, v = torch.linalg.svd(matrices, full_matrices=False)
    inner = u.mT @ orthogonalised(matrices) @ v.mT
    values = inner.diagonal(dim1=-2, dim2=-1)
    assert (values > 0.6).all() and (values < 1.3).all()
    torch.testing.assert_close(inner, torch.diag_embed(values), rtol=0, atol=1e-4)
    torch.testing.assert_close(orthogonalised(matrices.mT), orthogonalised(matrices).mT, rtol=0, atol=1e-5)


def test_a_weight_without_gradients_only_decays() -> None:
    weight = torch.ones(12, 20)
    assert torch.equal(stepped([weight], [[None]], 0.02, 0.0)[0], weight)
    torch.testing.assert_close(stepped([weight], [[None]], 0.02, 0.5)[0], 0.99 * weight)
