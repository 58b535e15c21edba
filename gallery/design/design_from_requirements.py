"""Design from a requirement file, with the margin of each limit."""

import matplotlib.pyplot as plt

import omnimirror as om

requirements = om.Requirements(
    field=om.FieldRequirements(omega_max_deg=110, object_distance_mm=800),
    mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=25),
    lens=om.LensRequirements(theta_max_deg=12, f_number=8),
    limits=(om.Limit("total_blur_deg", at_most=0.6), om.Limit("length_mm", at_most=130)),
)
design = om.design_sensor(requirements)
rows = [row for row in design.verdict.rows if row.is_limit]
figure, ax = plt.subplots(figsize=(7, 2.2))
ax.barh([row.name for row in rows], [row.reached / row.at_most for row in rows])
ax.axvline(1, color="C3")
ax.set(xlabel="fraction of the limit", title="met" if design.is_met else "not met")
figure.savefig("design_from_requirements.png", bbox_inches="tight")
om.save_sensor(design.sensor, "requirements_to_sensor.toml")
