"""Manufacturing yield before and after calibration of each sensor."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-spherical")
errors = {f"mirror.decentre_{axis}_mm": om.Tolerance(0.1) for axis in "xy"}
errors |= {f"mirror.tilt_{axis}_deg": om.Tolerance(0.1) for axis in "xy"}
figure, ax = plt.subplots(figsize=(7, 4))
limits = np.linspace(0.1, 4, 14)
for merit in ("motion_px", "motion_px after principal-point", "motion_px after pose"):
    yields = [
        om.tolerance(
            sensor, om.Tolerances(sensor, errors), limits={merit: limit}, trials=400
        ).statistics.yields.value
        for limit in limits
    ]
    ax.plot(limits, yields, label=merit)
ax.set(xlabel="permitted image shift, px", ylabel="yield")
ax.legend()
figure.savefig("manufacturing_yield.png", bbox_inches="tight")
