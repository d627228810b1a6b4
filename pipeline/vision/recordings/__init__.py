"""What a user recorded: video files and mask files."""
