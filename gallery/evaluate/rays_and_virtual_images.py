"""Chief rays of a spherical mirror with its tangential and sagittal virtual images."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

sensor = om.load_sensor("paper-spherical")
table = om.evaluate(sensor, omega_deg=np.arange(1, 136, 1.0))
profile = np.linspace(0, sensor.mirror.rim_radius_mm, 200)

figure, ax = plt.subplots(figsize=(6, 6))
ax.plot(profile, sensor.mirror.sag(profile), "k", lw=2, label="mirror")
for x, z, omega in zip(
    table.x_mm[14::15], table.z_mm[14::15], np.radians(table.omega_deg[14::15]), strict=True
):
    ax.plot(
        [0, x, x + 60 * np.sin(omega)],
        [-sensor.mirror_distance_mm, z, z - 60 * np.cos(omega)],
        "0.7",
        lw=0.8,
    )
ax.plot(table.image_t_x_mm, table.image_t_z_mm, "C0", label="tangential virtual image")
ax.plot(table.image_s_x_mm, table.image_s_z_mm, "C3--", label="sagittal virtual image")
ax.set(xlim=(-8, 95), ylim=(-70, 60), aspect="equal", xlabel="x, mm", ylabel="z, mm")
ax.legend(loc="lower right")
figure.savefig("rays_and_virtual_images.png", bbox_inches="tight")
