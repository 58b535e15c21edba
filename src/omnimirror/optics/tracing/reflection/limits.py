"""Limits of the search for reflection points."""

MAX_STEPS = 60
LONGEST_STEP = 0.3  # of the rim radius, and of the distance from the apex of a pointed mirror
REFLECTS = 1e-9  # largest deviation from the law of reflection, as a sine
RIM_SLACK = 1e-9  # relative tolerance at the rim
