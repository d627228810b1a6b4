"""Optical flow: estimators, the model of their errors, and flow as pictures."""
