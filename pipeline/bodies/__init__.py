"""What a user's clip shows: its frames, the bodies that move in it, and what the user says of them."""
