"""What a camera sees: rendering of scenes, optical flow, and video files."""
