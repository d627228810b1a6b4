"""Bodies through the frames: pixels are grouped to tracks, tracks joined, followed at rest, and measured."""
