"""What is asked of a sensor: requirements, the quantities they limit, and merits."""
