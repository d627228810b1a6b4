"""The networks for masks: one finds bodies in whole frames, another draws the outline of each body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.bodies.networks.network import SegmentationNetwork, load_network
from pipeline.bodies.networks.outline_network import OutlineNetwork, load_outline_network


@dataclass(frozen=True)
class MaskNetworks:
    """The networks.

    Attributes:
        moving: Finds the bodies that move.
        outlines: Sharpens their outlines; None: they stay as `moving` sees them.
    """

    moving: SegmentationNetwork
    outlines: OutlineNetwork | None = None


def load_mask_networks(folder: Path | str) -> MaskNetworks:
    """The networks of a folder, as models/masks, ready to infer. Raises ModelError."""
    return MaskNetworks(load_network(folder), load_outline_network(folder))
