"""Commands that export to other programs."""
