"""Clips and scenes in the rerun viewer: everything that imports rerun."""
