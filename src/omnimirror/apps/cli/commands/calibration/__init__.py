"""Calibration commands: targets, camera models, mirror outline, uncertainty, and file conversion."""
