"""Camera protocol, coordinate frames and calibrated camera models."""
