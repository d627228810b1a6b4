"""Clips: scenes that pass the filters, the frames that are looked at, their events, and how alike two clips are."""
