"""Scenes whose bodies move in a plane parallel to the picture: side views, inclines, flights and top views."""
