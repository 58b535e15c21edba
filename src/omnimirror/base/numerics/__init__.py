"""Roots, minima, and the largest of many functions made small: what several rooms need."""
