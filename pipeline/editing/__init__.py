"""Edits of a clip: what would have been filmed had the scene been another."""
