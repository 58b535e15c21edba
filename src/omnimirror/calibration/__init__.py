"""Calibration of cameras and mirror sensors from images: rim detection, targets, estimation, camera
files.
"""
