"""Where the known scene fails: the part that it explains, and intervals and a region of the rest."""
