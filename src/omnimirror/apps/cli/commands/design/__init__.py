"""Commands that make a sensor, choose its parts, and hand it to a workshop."""
