"""Outlines of instances at the clip's resolution, and shapes that are fitted to them without physics."""
