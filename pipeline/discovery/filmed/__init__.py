"""Measured motion from several clips of one camera, without any simulation."""
