"""Image commands: render, dewarp, restore, view and serve."""
