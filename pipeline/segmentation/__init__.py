"""Instance masks of the moving bodies in a clip, by a small network and a grouping over time."""

from pipeline.segmentation.mask_networks import MaskNetworks, load_mask_networks

__all__ = ["MaskNetworks", "load_mask_networks"]
