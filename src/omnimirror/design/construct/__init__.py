"""Mirrors made from what is wanted of them: families, mappings, fits."""
