"""What a camera sees: masks, depth, exact flow and RGB of a scene, measured flow, and video files."""
