"""Instance masks of the moving bodies in a clip, by a small network and a grouping over time."""

from pipeline.segmentation.bodies import BodyTracks, find_bodies
from pipeline.segmentation.network import SegmentationNetwork, load_network

__all__ = ["BodyTracks", "SegmentationNetwork", "find_bodies", "load_network"]
