"""Figures of a calibration: residuals and coverage."""

from .coverage import coverage_map
from .residuals import residual_histograms, residual_vectors, residuals_by_picture, residuals_by_radius

__all__ = ["coverage_map", "residual_histograms", "residual_vectors", "residuals_by_picture", "residuals_by_radius"]
