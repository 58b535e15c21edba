"""Design with off-the-shelf parts: a mirror for each combination of them."""
