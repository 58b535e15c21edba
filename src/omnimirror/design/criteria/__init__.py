"""Requirements on a sensor, limitable quantities, and merits."""
