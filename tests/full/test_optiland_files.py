"""OpticStudio files read by Optiland: surface, and chief rays through the system.

Optiland does not read extended aspheres, but its own surfaces accept any number of terms, which are
set here.
"""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.manufacturing import fit_asphere
from omnimirror.manufacturing.formats.zmx import field_angles, write_zmx
from omnimirror.manufacturing.surface_approximation import EXACT_UM
from tests.analysis.test_two_mirrors import SENSORS as FOLDED
from tests.conftest import MIRRORS, SURFACES_OF_LENS_FILES, sensor_of

pytestmark = [pytest.mark.full, pytest.mark.filterwarnings("ignore")]


@pytest.fixture(scope="module")
def load():
    pytest.importorskip("optiland", reason="Optiland is installed by `make test-full` only")
    import matplotlib as mpl

    mpl.use("Agg")
    from optiland.fileio import load_zemax_file

    def read(path):
        text = path.read_text(encoding="utf-16")
        plain = text.replace("XASPHERE", "EVENASPH").replace("XOSPHERE", "ODDASPHE")
        path.write_text(plain, encoding="utf-16")
        system = load_zemax_file(str(path))
        if plain != text:
            lines = text.split("SURF 2")[1].split("SURF 3")[0].splitlines()
            _, N, *a = (float(line.split()[2]) for line in lines if line.startswith("  XDAT"))
            step = 2 if "XASPHERE" in text else 1
            for surface in system.surfaces.surfaces[2:4]:
                surface.geometry.coefficients = [
                    v / N ** (step * i) for i, v in enumerate(a, start=1)
                ]
        return system

    return read


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_surface_agrees_with_mirror(kind, load, tmp_path):
    sensor = sensor_of(kind)
    stated = write_zmx(tmp_path / "s.zmx", sensor)[0].deviation_um
    geometry = load(tmp_path / "s.zmx").surfaces.surfaces[2].geometry
    x = np.linspace(0, sensor.mirror.rim_radius_mm, 301)
    off = 1e3 * np.abs(np.asarray(geometry.sag(0 * x, x)) - sensor.mirror.sag(x))
    assert off.max() <= 3 * max(
        stated, EXACT_UM
    )  # heights, whereas the file states distances along the normal
    assert stated < 0.005
    assert float(geometry.radius) > 0


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_chief_rays_leave_the_mirror_at_the_field_angles(kind, load, tmp_path, beside):
    """Trace from the imager through the lens: its own field points, up to 135 deg and more."""
    sensor = sensor_of(kind)
    write_zmx(tmp_path / "s.zmx", sensor)
    system = load(tmp_path / "s.zmx")
    heights = np.array([float(f.y) for f in system.fields.fields])
    omega = []
    for height in heights:
        ray = system.trace_generic(
            Hx=0, Hy=height / np.abs(heights).max(), Px=0, Py=0, wavelength=0.55
        )
        omega.append(np.degrees(np.arctan2(float(ray.M[0]), -float(ray.N[0]))))
    tolerance = (
        1e-6 if kind in SURFACES_OF_LENS_FILES else fit_asphere(sensor.mirror).ray_deg + 1e-5
    )
    assert tolerance < 1e-3
    off = np.abs(np.sort(omega) - field_angles(sensor)).max()
    kinds = "as exact surfaces" if kind in SURFACES_OF_LENS_FILES else "approximated by aspheres"
    beside(
        "Optiland",
        f"field angles of chief rays in exported .zmx files, mirrors {kinds}",
        off,
        tolerance,
        "deg",
    )


def test_reflected_pencil_has_vergence_of_eq_15(load, tmp_path):
    """The lens directs it to its focal plane; two rays close to the chief ray meet at the
    tangential object."""
    sensor = sensor_of("sphere")
    write_zmx(tmp_path / "s.zmx", sensor)
    system = load(tmp_path / "s.zmx")
    heights = np.array([float(f.y) for f in system.fields.fields])
    for height in heights:
        edges = []
        for pupil in (0.01, -0.01):
            ray = system.trace_generic(
                Hx=0, Hy=height / np.abs(heights).max(), Px=0, Py=pupil, wavelength=0.55
            )
            at_mirror = [float(np.asarray(getattr(system.surfaces, axis))[2, 0]) for axis in "yz"]
            edges.append((np.array(at_mirror), np.array([float(ray.M[0]), float(ray.N[0])])))
        (a, u), (b, v) = edges
        meeting = np.cross(b - a, v) / np.cross(u, v)  # along the outgoing ray from the mirror
        rays = sensor.meridian.trace(np.abs([(a[0] + b[0]) / 2]))
        q = sensor.lens.focus_distance_mm / np.cos(rays.theta[0]) - np.hypot(rays.x, rays.w)[0]
        vergence = 1 / q - 2 / (rays.radius_t()[0] * np.cos(rays.gamma[0]))
        assert 1 / meeting == pytest.approx(vergence, abs=2e-5)


@pytest.mark.parametrize("kind", sorted(k for k in FOLDED if k != "telecentric"))
def test_chief_rays_leave_both_mirrors_of_a_folded_sensor_at_the_field_angles(kind, load, tmp_path):
    sensor = FOLDED[kind]
    write_zmx(tmp_path / "s.zmx", sensor)
    system = load(tmp_path / "s.zmx")
    heights = np.array([float(f.y) for f in system.fields.fields])
    omega = []
    for height in heights:
        ray = system.trace_generic(
            Hx=0, Hy=height / np.abs(heights).max(), Px=0, Py=0, wavelength=0.55
        )
        omega.append(np.degrees(np.arctan2(np.abs(float(ray.M[0])), float(ray.N[0]))))
    np.testing.assert_allclose(sorted(omega), field_angles(sensor), atol=1e-6)
