"""Sensors with errors, by the thousand: where their pictures move, how they blur, what calibration leaves."""
