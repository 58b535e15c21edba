"""Mirrors, lenses, housing, image sensor, ray tracing, sensors and sensor files."""
