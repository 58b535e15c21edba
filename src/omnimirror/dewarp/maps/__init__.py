"""Where each pixel of a view lies in the picture."""
