"""Reproducible image datasets with ground truth."""
