"""Motion in the picture: the tracks of bodies, their arcs, and which view of the world explains them."""
