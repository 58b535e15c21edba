"""Measured profiles: column files, point clouds and grids, and their smoothing."""
