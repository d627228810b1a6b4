"""Intersection over union, and intervals of means and shares. Below everything that searches or evaluates."""
