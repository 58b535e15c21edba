"""Sensors handed over to other programs: rays of pixels, maps of views, recordings of robots, live views."""
