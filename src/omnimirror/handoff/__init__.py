"""Sensors handed over to other programs: recordings of robots, and live views as ordinary cameras."""
