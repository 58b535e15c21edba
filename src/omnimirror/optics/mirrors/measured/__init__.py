"""Profiles that were measured: columns of a file, clouds and grids of points, and their smoothing."""
