"""Instance masks of the moving bodies in a clip, by a small network and a grouping over time."""

from pipeline.segmentation.bodies import BodyTracks, find_bodies
from pipeline.segmentation.mask_networks import MaskNetworks, load_mask_networks

__all__ = ["BodyTracks", "MaskNetworks", "find_bodies", "load_mask_networks"]
