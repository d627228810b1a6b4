"""The search for the scene whose simulation matches a clip."""
