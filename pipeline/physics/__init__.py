"""Simulation of scenes: one at a time with a full trace, or many at once."""
