"""Sheets of drawing paper, and DXF."""
