"""How well a sensor must be built, and how many of those built will be good."""
