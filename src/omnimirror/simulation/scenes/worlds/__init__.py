"""Bundled scenes, and their paint and parts."""
