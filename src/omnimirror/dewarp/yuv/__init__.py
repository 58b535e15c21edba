"""Frames of videos straightened plane by plane, as they are coded."""
