"""What a user recorded: video files, mask files, and masks found from motion."""
