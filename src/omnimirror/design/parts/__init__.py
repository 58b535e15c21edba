"""Parts that can be bought inside the design: each combination of them with its own mirror."""
