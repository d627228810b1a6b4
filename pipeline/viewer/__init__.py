"""Clips and scenes in the rerun viewer. No other package imports rerun."""
