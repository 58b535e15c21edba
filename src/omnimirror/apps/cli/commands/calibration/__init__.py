"""Calibration commands: targets, camera models, mirror outlines, uncertainty, conversion."""
