"""Meridional analysis from chief rays: imaging characteristics, viewpoints, virtual images, and
through-focus blur.
"""
