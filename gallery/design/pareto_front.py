"""Pareto front of blur and uniformity of the resolution."""

import matplotlib.pyplot as plt

import omnimirror as om

requirements = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=135),
    mirror=om.MirrorRequirements(
        optimise="worst_blur_deg", shape="polynomial:4", rim_radius_mm=43.9
    ),
    lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
)
front = om.pareto(
    requirements, ["worst_blur_deg", "inverse_area_ratio"], population=48, generations=30
)
figure, ax = plt.subplots(figsize=(6, 4))
ax.plot(*front.values.T, "o-")
ax.set(xlabel="maximum blur, deg", ylabel="ratio of largest to smallest pixel area")
figure.savefig("pareto_front.png", bbox_inches="tight")
