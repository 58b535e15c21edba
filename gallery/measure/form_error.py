"""Form error of a measured mirror: 0.5 um of astigmatism in noisy points."""

import matplotlib.pyplot as plt
import numpy as np

import omnimirror as om
from omnimirror.optics.mirrors import Sphere

rng, ball = np.random.default_rng(1), Sphere(50.0, 40.0)
r, phi = 40 * np.sqrt(rng.uniform(0, 1, 4000)), rng.uniform(0, 2 * np.pi, 4000)
x, y = r * np.cos(phi), r * np.sin(phi)
z = ball.sag(r) + 0.5e-3 * np.sqrt(6) * (x**2 - y**2) / 40**2 + 1e-4 * rng.normal(size=4000)
result = om.form_error(ball, np.stack([x, y, z], axis=-1))
terms = [term for term in result.terms if abs(term.um) > 0.005][:8]
figure, ax = plt.subplots(figsize=(7, 3))
ax.barh(
    [term.name for term in terms],
    [term.um for term in terms],
    xerr=[3 * term.sigma_um for term in terms],
)
ax.set(xlabel="form error, um (bars: 3 sigma)")
figure.savefig("form_error.png", bbox_inches="tight")
