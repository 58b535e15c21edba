"""Calibration of cameras and mirror sensors from images, and camera files."""
