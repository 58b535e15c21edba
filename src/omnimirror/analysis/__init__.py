"""Sensor analysis: imaging characteristics, viewpoints, virtual images, blur and evaluation."""
