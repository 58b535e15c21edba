"""What must be given for what: the front of sharpness against even resolution, by a small search."""

import matplotlib.pyplot as plt

import omnimirror as om

needs = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=135),
    mirror=om.MirrorRequirements(optimise="worst_blur_deg", shape="polynomial:4", rim_radius_mm=43.9),
    lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12),
)
front = om.pareto(needs, ["worst_blur_deg", "inverse_area_ratio"], population=48, generations=30)
figure, ax = plt.subplots(figsize=(6, 4))
ax.plot(*front.values.T, "o-")
ax.set(xlabel="worst blur, deg", ylabel="largest pixel area over smallest")
figure.savefig("trade_offs.png", bbox_inches="tight")
