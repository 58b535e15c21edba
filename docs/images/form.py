"""Generate the image of docs/measured.md: a hyperboloid with astigmatism, ring-shaped errors and
noise, measured at a lateral offset from the machine axis.

python docs/images/form.py
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

import omnimirror as om
from omnimirror.analysis.figures.style import save_figure, styled
from omnimirror.manufacturing.metrology.form_map import plot_form_error

mirror, rng = om.load_sensor("paper-hyperboloidal").mirror, np.random.default_rng(0)
r = mirror.rim_radius_mm * np.sqrt(rng.uniform(0, 1, 15_000))
phi = rng.uniform(0, 2 * np.pi, r.size)
u = r / mirror.rim_radius_mm
form = (
    1.2 * np.sqrt(6) * u**2 * np.sin(2 * phi)
    - 0.6 * np.sqrt(5) * (6 * u**4 - 6 * u**2 + 1)
    + 0.15 * np.cos(30 * u)
)
z = mirror.sag(r) + 1e-3 * (form + 0.1 * rng.normal(size=r.size))
points = np.stack([r * np.cos(phi) + 3, r * np.sin(phi) - 2, z], axis=-1)
with TemporaryDirectory() as folder, styled():
    save_figure(plot_form_error(om.form_error(mirror, points)), Path(folder) / "form.png")
    om.write_image(Path(__file__).with_name("form.webp"), om.read_image(f"{folder}/form.png"))
