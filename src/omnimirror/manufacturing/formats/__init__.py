"""Files for workshops and other programs."""
