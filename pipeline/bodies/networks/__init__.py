"""What single frames show of bodies: the networks for masks, outlines and shapes, and published segmenters."""

from pipeline.bodies.networks.mask_networks import MaskNetworks, load_mask_networks

__all__ = ["MaskNetworks", "load_mask_networks"]
