"""What was filmed: arcs of tracks, the views that compete to explain them, and scenes in one plane that are fitted."""
