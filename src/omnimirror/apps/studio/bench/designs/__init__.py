"""Designs on the bench: tables, requirement checks and manual shape editing."""
