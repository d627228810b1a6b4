"""Clips to train on, read when asked for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from torch.utils.data import Dataset

Row = TypeVar("Row")


class ClipDataset(Dataset, Generic[Row]):
    """So many clips, each as what `read` gives for its index."""

    def __init__(self, length: int, read: Callable[[int], Row]) -> None:
        self._length, self._read = length, read

    def __len__(self) -> int:
        return self._length

    def __getitem__(self, index: int) -> Row:
        return self._read(index)
