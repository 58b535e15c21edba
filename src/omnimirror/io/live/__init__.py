"""Cameras, streams, pipes and windows."""
