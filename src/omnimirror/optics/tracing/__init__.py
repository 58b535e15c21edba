"""Chief rays in the meridian, and the way back from angles and points to the mirror."""
