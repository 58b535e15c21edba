"""Calibrate tab: board detection in images, and camera calibration."""
