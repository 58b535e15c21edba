"""Designs on the bench: as tables, judged by their requirements, bent by hand."""
