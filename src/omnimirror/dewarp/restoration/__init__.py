"""Deblurring of images with known blur and noise."""
