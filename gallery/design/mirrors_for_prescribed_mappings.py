"""Equiangular, equiareal, conformal and ground-plane mirrors, designed from their mappings."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4))
for mapping, omega_max in (
    ("equidistant", 120),
    ("equiareal", 120),
    ("conformal", 120),
    ("ground-plane", 75),
):
    plane_mm = 1500 if mapping == "ground-plane" else None
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=omega_max),
        mirror=om.MirrorRequirements(mapping=mapping, rim_radius_mm=30, plane_distance_mm=plane_mm),
        lens=om.LensRequirements(theta_max_deg=12),
    )
    sensor = om.design_sensor(requirements).sensor
    table = om.evaluate(sensor, omega_deg=np.linspace(1, omega_max, 200))
    left.plot(table.x_mm, table.z_mm, label=mapping)
    right.plot(table.omega_deg, table.h_px)
left.set(xlabel="x, mm", ylabel="z, mm", title="mirror")
left.legend()
right.set(xlabel="field angle, deg", ylabel="image height, px", title="mapping")
figure.savefig("mirrors_for_prescribed_mappings.png", bbox_inches="tight")
