"""Drawing of a sensor that is folded by a flat secondary mirror."""

import omnimirror as om

sensor = om.load_sensor("folded-spherical")
om.export(sensor, "drawing_of_a_folded_sensor.png", formats=["png"])
