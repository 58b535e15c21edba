"""Light from a scene by way of the mirror to the imager."""
