"""What searches for reflection points keep to."""

MAX_STEPS = 60
LONGEST_STEP = 0.3  # of the rim radius, and of the distance from the tip of a pointed mirror
REFLECTS = 1e-9  # largest miss of the law of reflection, as a sine
RIM_SLACK = 1e-9  # relative; a point this little past the rim is on it
