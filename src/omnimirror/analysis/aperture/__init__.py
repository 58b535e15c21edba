"""Whole-aperture analysis: ray bundles, spot diagrams, PSF, MTF and illumination."""
