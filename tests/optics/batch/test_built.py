"""Batch evaluation of designs with a real lens behind a dome: against rays traced here through
every surface, separate evaluations, and the compiled evaluator against NumPy."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.optics.batch.evaluate import BATCH_COLUMNS, Designs, evaluate_designs
from omnimirror.optics.batch.families import family
from omnimirror.optics.housing import Dome, FlatWindow, Housing, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import SurfaceLens, TabulatedLens
from omnimirror.optics.materials import MATERIALS
from tests.everyday import few
from tests.optics.lenses.prescriptions import F_NUMBER, imager_place, indices, through, zmx

M = 43.9
IMAGER = Imager(1024, 1024, 5.2)
TUBE = Tube(104.0, 4.0, material="polycarbonate", medium="water")
DOME = Dome(360.0, 6.0, centre_mm=-80.0, inner_shift_mm=2.0, material="acrylic")
WALLS = {
    "bare": None,
    "tube in water": TUBE,
    "dome": DOME,
    "usual tube": Tube(),
    "usual dome": Dome(medium_index=1.2),
}
ANGLES = np.linspace(0, 20, 6)
TABLE = {
    "image_height_mm": tuple(
        11.9 * np.tan(np.radians(ANGLES)) * (1 - 0.2 * np.radians(ANGLES) ** 2)
    ),
    "entrance_pupil_mm": tuple(4.0 + 0.001 * ANGLES**2),
    "field_curvature_t_mm": tuple(-3e-4 * ANGLES**2),
    "own_blur_t_mm": tuple(0.002 + 1e-5 * ANGLES**2),
}


@pytest.fixture(scope="module")
def triplet(tmp_path_factory):
    file = tmp_path_factory.mktemp("lens") / "triplet.zmx"
    file.write_text(zmx())
    return SurfaceLens.from_file(file, focus_distance_mm=212.0, f_number=F_NUMBER)


@pytest.fixture(scope="module")
def table():
    return TabulatedLens(11.6, 4.0, 212.0, tuple(ANGLES), **TABLE)


def designs_with(count: int, shell=None, rim=M, **options) -> Designs:
    """Return random polynomials about the paper's sphere."""
    rng = np.random.default_rng(7)
    shape = family("even-polynomial", 4)
    u = shape.slope_places()
    slopes = u / np.sqrt(1.138**2 - u**2) * (1 + 0.02 * rng.standard_normal((count, u.size)))
    m = rng.uniform(175.0, 190.0, count)
    return Designs(
        shape,
        slopes @ shape.from_slopes().T,
        m,
        rim,
        11.6,
        4.0,
        5.2,
        housing=Housing(shell=shell),
        **options,
    )


# -- reference: one ray in the meridian, from the stop outwards
# ---------------------------------------------


PUPIL_DEPTH = 2.669
"""Initial distance of the entrance pupil behind the first vertex, mm."""


def stop_radius():
    """Return the stop radius, from a ray of the axial object point through the edge of the
    aperture: f/8."""
    slope = 11.6 / F_NUMBER / 2 / (212.0 + pupil_depth())
    return abs(through([0.0, 0.0, -212.0], [slope, 0.0, 1.0], indices(), 1.0)[0][0])


def pupil_depth():
    """Return the distance of the entrance pupil behind the first vertex: intersection of rays
    through the stop centre."""
    n, slope = indices(), 1e-4
    y = brentq(lambda y: through([y, 0, 0], [slope, 0, 1], n, 1.0)[0][0], -0.1, 0.1)
    return -y / slope


def from_stop(tangent, at_stop, to_imager):
    """Return a ray with a viewing angle through a point of the stop: height at the first vertex,
    and on the imager.

    The lens is directed along +z towards the mirror in the sensor frame: an incident ray has the
    slope -tangent."""
    n = indices()
    near = tangent * PUPIL_DEPTH + 1.2 * at_stop
    ends = near - 0.6, near + 0.6
    y = brentq(
        lambda y: through([y, 0, 0], [-tangent, 0, 1], n, to_imager)[0][0] - at_stop,
        *ends,
        xtol=1e-14,
    )
    return y, -through([y, 0, 0], [-tangent, 0, 1], n, to_imager)[1][0]


class Truth:
    """Sensor of implicit surfaces, in the meridian."""

    def __init__(self, sensor):
        self.mirror, self.m = sensor.mirror, sensor.mirror_distance_mm
        self.shell = sensor.obstructions.housing.shell

    def out(self, y, tangent):
        """Return the mirror point and the angle from -z of the ray that leaves the first vertex of
        the lens at y."""
        ray = lambda s: np.array([y + s * tangent, -self.m + s])  # noqa: E731
        end = (self.mirror.rim_radius_mm - 1e-8 - y) / tangent
        s = brentq(
            lambda s: ray(s)[1] - float(self.mirror.sag(abs(ray(s)[0]))),
            self.m - 1,
            end,
            xtol=1e-13,
        )
        p, d = ray(s), np.array([tangent, 1.0]) / np.hypot(tangent, 1)
        h = min(1e-5, (self.mirror.rim_radius_mm - p[0]) / 2)
        slope = (float(self.mirror.sag(p[0] + h)) - float(self.mirror.sag(p[0] - h))) / (2 * h)
        normal = np.array([slope, -1.0]) / np.hypot(slope, 1)
        p, d = p, d - 2 * (d @ normal) * normal
        mirror_x = p[0]
        if self.shell is not None:
            p, d = self._outside(p, d)
        return mirror_x, np.arctan2(d[0], -d[1])

    def _outside(self, p, d):
        shell = self.shell
        wall = MATERIALS[shell.material].index_d if shell.material else shell.refractive_index
        around = MATERIALS[shell.medium].index_d if shell.medium else shell.medium_index
        before, outer = 1.0, shell.diameter_mm / 2
        inner_shift = getattr(shell, "inner_shift_mm", 0.0)

        def intersection(p, d, centre, radius):
            return (
                p
                + brentq(lambda s: np.hypot(*(p + s * d - centre)) - radius, 0, 999, xtol=1e-13) * d
            )

        for radius, shift, behind in (
            (outer - shell.wall_mm, inner_shift, wall),
            (outer, 0.0, around),
        ):
            if isinstance(shell, Tube):
                p = p + (radius - p[0]) / d[0] * d
                normal = np.array([1.0, 0.0])
            else:
                centre = np.array([0.0, shell.centre_mm + shift])
                p = intersection(p, d, centre, radius)
                normal = (p - centre) / radius
            across = before / behind * (d - (d @ normal) * normal)
            d, before = across + np.sqrt(1 - across @ across) * normal, behind
        return p, d


@pytest.mark.parametrize("wall", few(["bare", "tube in water", "dome"], "tube in water"))
def test_all_surfaces_traced(triplet, wall):
    """Field angle, image height and tangential blur of mirror points, by rays through lens, mirror
    and wall."""
    designs = designs_with(2, WALLS[wall], lens=triplet)
    u = np.array([0.45, 0.7, 0.95])
    batch = evaluate_designs(designs, u)
    n, edge = indices(), stop_radius()
    for i in range(2):
        sensor = designs.sensor(i, IMAGER, batch.focus_mm[i])
        truth, to_imager = Truth(sensor), imager_place(n, batch.focus_mm[i])
        for j, x in enumerate(u * M):
            omega, height, blur = chief_and_blur(truth, x, to_imager, edge)
            assert batch.omega_deg[i, j] == pytest.approx(np.degrees(omega), abs=1e-6)
            assert batch.h_px[i, j] == pytest.approx(height / 5.2e-3, abs=1e-3)
            assert abs(batch.blur_t_px[i, j]) == pytest.approx(blur / 5.2e-3, abs=0.01, rel=0.01)


def chief_and_blur(truth, x, to_imager, edge):
    """Return field angle, image height (mm) and tangential blur (mm) of a mirror point, for a given
    stop radius."""

    def out(t, at_stop):
        return truth.out(from_stop(t, at_stop, to_imager)[0], t)

    to_pupil = truth.m + float(truth.mirror.sag(x)) + PUPIL_DEPTH
    t = brentq(lambda t: out(t, 0.0)[0] - x, 0.98 * x / to_pupil, 1.02 * x / to_pupil, xtol=1e-14)
    omega, images = out(t, 0.0)[1], []
    for at_stop in (
        -0.02 * edge,
        0.02 * edge,
    ):  # rays of the same distant point, close to the chief ray
        chief = brentq(
            lambda t, at_stop=at_stop: out(t, at_stop)[1] - omega, t - 1e-3, t + 1e-3, xtol=1e-15
        )
        images.append(from_stop(chief, at_stop, to_imager)[1])
    wide, narrow = (
        from_stop(t, part * edge, to_imager)[0] - from_stop(t, -part * edge, to_imager)[0]
        for part in (1, 0.02)
    )
    return omega, from_stop(t, 0.0, to_imager)[1], abs(images[1] - images[0]) * wide / narrow


# -- against separate evaluations
# -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wall", "kind"),
    few(
        product(WALLS, ["triplet", "table", "ideal", "telecentric"]),
        *product(["tube in water"], ["triplet", "table"]),
        *product(["usual dome"], ["ideal", "telecentric"]),
    ),
)
def test_columns_match_evaluation(request, kind, wall):
    """Real lenses by their tables: heights to rounding, blur to a few 0.001 px; all others to
    rounding."""
    real = kind in ("triplet", "table")
    options = {"lens": request.getfixturevalue(kind)} if real else {}
    options |= {"magnification": 0.06} if kind == "telecentric" else {}
    designs = designs_with(3, WALLS[wall], object_distance_mm=600.0, **options)
    batch = evaluate_designs(designs)
    assert batch.valid.all()
    for i in range(3):
        sensor = designs.sensor(i, IMAGER, batch.focus_mm[i])
        x = np.linspace(0, 1, 100) * M
        is_visible = x >= sensor.meridian.x_min
        assert (np.isnan(batch.omega_deg[i]) == ~is_visible).all()
        single = om.evaluate(sensor, x_mm=x[is_visible], object_distance_mm=600.0)
        for column in BATCH_COLUMNS:
            expected, values = getattr(single, column), getattr(batch, column)[i][is_visible]
            loose = real and column in ("blur_t_px", "blur_s_px", "floored_area_deg2")
            allowed = (
                {"rtol": 2e-3, "atol": 2e-3}
                if loose
                else {"rtol": 1e-10, "atol": 1e-11 * np.abs(expected).max()}
            )
            np.testing.assert_allclose(
                values, expected, **allowed, err_msg=f"{column} of {sensor.name} {i}"
            )
        best = om.best_focus(sensor, omega_deg=single.omega_deg, object_distance_mm=600.0)
        assert batch.worst_floored_area_deg2[i] <= best.value * (1 + (5e-3 if real else 1e-9))


def test_window_field_in_batch():
    shell = FlatWindow(wall_mm=6.0, material="acrylic", medium="water")
    shape = family("even-polynomial", 1)
    designs = Designs(shape, [[0.2]], 180.0, 28.0, 11.6, 4.0, 5.2, housing=Housing(shell=shell))
    batch = evaluate_designs(designs)
    single = om.evaluate(designs.sensor(0, IMAGER, batch.focus_mm[0]), x_mm=np.linspace(0, 28, 100))
    np.testing.assert_allclose(batch.blur_t_px[0], single.blur_t_px, atol=1e-9)
    steep = Designs(shape, [[0.8]], 180.0, 28.0, 11.6, 4.0, 5.2, housing=Housing(shell=shell))
    assert not evaluate_designs(steep).valid[0]


# -- compiled against NumPy
# --------------------------------------------------------------------------------


@pytest.mark.skipif(not backend.is_compiled, reason="not built")
@pytest.mark.parametrize("kind", ["triplet", "table", "ideal", "telecentric"])
@pytest.mark.parametrize("wall", WALLS)
def test_compiled_evaluator_matches_numpy(request, kind, wall):
    options = {"lens": request.getfixturevalue(kind)} if kind in ("triplet", "table") else {}
    options |= {"magnification": 0.06} if kind == "telecentric" else {}
    designs = designs_with(40, WALLS[wall], min_omega_deg=10.0, **options)
    a, b = (evaluate_designs(designs, 60, native=native) for native in (True, False))
    assert (a.valid == b.valid).all()
    np.testing.assert_allclose(a.focus_mm, b.focus_mm, rtol=1e-9)
    for column in BATCH_COLUMNS:
        values, expected = getattr(a, column), getattr(b, column)
        scale = np.nanmax(np.abs(expected))
        np.testing.assert_allclose(values, expected, rtol=1e-9, atol=1e-10 * scale, err_msg=column)


# -- invalid designs
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("native", [False, None])
def test_invalid_designs_beyond_field_or_wall(triplet, native):
    near = designs_with(1, lens=triplet)
    near = Designs(near.family, near.coefficients, 60.0, M, 11.6, 4.0, 5.2, lens=triplet)
    assert not evaluate_designs(near, native=native).valid[0]
    assert not evaluate_designs(designs_with(1, Tube(80.0, 4.0)), native=native).valid[0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shell": Tube(tilt_x_deg=1.0)}, "the tube must be aligned"),
        ({"mode": "paper"}, "mode = 'paper'"),
        ({"magnification": 0.1}, "a lens given by its field requires"),
    ],
)
def test_unsupported_batch_options_rejected(table, options, message):
    options = options if "shell" in options else options | {"lens": table}
    with pytest.raises(InvalidParameter, match=message):
        designs_with(1, **options)
