"""Muon (Jordan et al. 2024): momentum with orthogonalised updates, for hidden weight matrices and convolutions.

Gradients of small batches have a low effective rank; an orthogonalised update has the same length in every direction.
The step's length follows Liu et al. 2025 (arXiv:2502.16982), so that learning rates have the size usual for AdamW.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

import torch
from torch import Tensor

STEPS = 5
COEFFICIENTS = (3.4445, -4.7750, 2.0315)


def orthogonalised(matrices: Tensor) -> Tensor:
    """Approximately U V^T of each of matrices (..., M, N) = U S V^T, by a quintic Newton-Schulz iteration."""
    a, b, c = COEFFICIENTS
    tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if tall else matrices
    x = x / (x.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    for _ in range(STEPS):
        square = x @ x.mT
        x = a * x + (b * square + c * square @ square) @ x
    return x.mT if tall else x


class Muon(torch.optim.Optimizer):
    """For parameters with two or more axes, flattened to matrices (outputs, all other axes)."""

    def __init__(
        self, parameters: Iterable[Tensor], lr: float, momentum: float = 0.95, weight_decay: float = 0.0
    ) -> None:
        super().__init__(parameters, {"lr": lr, "momentum": momentum, "weight_decay": weight_decay})

    @torch.no_grad()
    def step(self, closure: None = None) -> None:  # type: ignore[override]
        """One step. Matrices of one shape are stacked, so that a GPU has few operations to start."""
        for group in self.param_groups:
            stacks: dict[tuple[int, ...], list[Tensor]] = defaultdict(list)
            for p in group["params"]:
                stacks[tuple(p.shape)].append(p)
            for shape, members in stacks.items():
                state = self.state[members[0]]
                gradient = torch.stack([torch.zeros_like(p) if p.grad is None else p.grad for p in members])
                if "momentum" not in state:
                    state["momentum"] = torch.zeros_like(gradient)
                average = state["momentum"].mul_(group["momentum"]).add_(gradient)
                towards = gradient.add(average, alpha=group["momentum"]).flatten(2)
                step = orthogonalised(towards.bfloat16() if towards.is_cuda else towards).to(gradient.dtype)
                length = 0.2 * max(step.shape[1:]) ** 0.5
                torch._foreach_mul_(members, 1 - group["lr"] * group["weight_decay"])
                steps = [part.reshape(shape) for part in step.unbind(0)]
                torch._foreach_add_(members, steps, alpha=-group["lr"] * length)
