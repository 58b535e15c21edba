"""Simulation: scenes, and rendering of camera images."""
