"""From requirements to a sensor, a verdict, and what would have to give."""
