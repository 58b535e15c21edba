"""Maps from the pixels of a view to source coordinates."""
