"""Values of a picture at fractional places: compiled, or with OpenCV."""
