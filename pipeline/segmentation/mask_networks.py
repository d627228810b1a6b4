"""The networks for masks: two find bodies in whole frames, one draws the outline of each body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pipeline.segmentation.network import SegmentationNetwork, load_network
from pipeline.segmentation.outline_network import OutlineNetwork, load_outline_network

SECOND = "second"  # folder of the second network, within that of the first


@dataclass(frozen=True)
class MaskNetworks:
    """The networks.

    Attributes:
        moving: Finds the bodies that move.
        outlines: Sharpens their outlines; None: they stay as `moving` sees them.
        second: Of the same kind as `moving`, trained for longer. The second look at a clip is the mean of both; None:
            `moving` alone.
    """

    moving: SegmentationNetwork
    outlines: OutlineNetwork | None = None
    second: SegmentationNetwork | None = None


def load_mask_networks(folder: Path | str) -> MaskNetworks:
    """The networks of a folder, as models/masks, ready to infer. Raises ModelError."""
    second = Path(folder) / SECOND
    return MaskNetworks(
        load_network(folder), load_outline_network(folder), load_network(second) if second.is_dir() else None
    )
