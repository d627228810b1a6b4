"""Intersection over union, and confidence intervals of means and shares. Imports nothing but numerics."""
