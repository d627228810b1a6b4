"""Pictures of a scene: masks, depth, exact flow and RGB."""
