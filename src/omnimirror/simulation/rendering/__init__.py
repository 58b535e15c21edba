"""Rendering: light from a scene via the mirror to the image sensor."""
