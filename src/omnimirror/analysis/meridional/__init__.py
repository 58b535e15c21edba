"""Meridional analysis: imaging characteristics, viewpoints, virtual images and focus."""
