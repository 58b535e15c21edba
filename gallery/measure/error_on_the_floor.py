"""What an uncertain focal length means on the floor 1.2 m below: millimetres, over the picture."""

import matplotlib.pyplot as plt

import omnimirror as om

model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
found = om.uncertainty_map(model, covariance=[[0.0116**2]], height_mm=1200, steps=64)  # .1 %
figure, ax = plt.subplots(figsize=(5, 4))
colours = ax.pcolormesh(found.columns, found.rows, found.sigma, cmap="viridis", vmax=30)
figure.colorbar(colours, label=f"error on the floor, {found.unit}")
ax.set(aspect="equal", ylim=(1023, 0))
figure.savefig("error_on_the_floor.png", bbox_inches="tight")
