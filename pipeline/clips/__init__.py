"""Clips: scenes that pass the filters, and the frames that are looked at."""
