"""A sensor folded by a flat second mirror, as the workshop sees it."""

import omnimirror as om

sensor = om.load_sensor("folded-spherical")
om.export(sensor, "folded_in_half.png", formats=["png"])
