"""Metrology of manufactured mirrors: measurement files, alignment, form error and Forbes aspheres."""
