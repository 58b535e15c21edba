"""Uncertainty of points on the ground, 1.2 m below the mirror, due to the focal length."""

import matplotlib.pyplot as plt

import omnimirror as om

model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
uncertainty = om.uncertainty_map(model, covariance=[[0.0116**2]], height_mm=1200, steps=64)  # 0.1 %
figure, ax = plt.subplots(figsize=(5, 4))
colours = ax.pcolormesh(
    uncertainty.columns, uncertainty.rows, uncertainty.sigma, cmap="viridis", vmax=30
)
figure.colorbar(colours, label=f"uncertainty on the ground, {uncertainty.unit}")
ax.set(aspect="equal", ylim=(1023, 0))
figure.savefig("uncertainty_on_the_ground.png", bbox_inches="tight")
