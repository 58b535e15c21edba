"""Design commands: sensors, off-the-shelf parts, tolerances, and export."""
