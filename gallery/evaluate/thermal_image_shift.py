"""Image shift due to thermal expansion of mirror and spacer in winter and summer."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

figure, ax = plt.subplots(figsize=(7, 4))
celsius = np.arange(-20, 61, 10.0)
for mirror, spacer in (
    ("acrylic", "aluminium"),
    ("aluminium", "acrylic"),
    ("aluminium", "aluminium"),
):
    thermal = om.Thermal(mirror_material=mirror, spacer_material=spacer, mount_material="aluminium")
    sensor = replace(om.load_sensor("paper-spherical"), thermal=thermal)
    ax.plot(
        celsius,
        [om.thermal_motion_px(sensor, t) for t in celsius],
        "o-",
        label=f"{mirror} mirror, {spacer} spacer",
    )
ax.set(xlabel="temperature, °C", ylabel="maximum image shift, px")
ax.legend()
figure.savefig("thermal_image_shift.png", bbox_inches="tight")
