"""Tabulated lens: against the ideal lens without aberrations, and against the lens of the table."""

import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.optics.lenses import SurfaceLens, TabulatedLens
from omnimirror.optics.lenses._tabulated_lens import COLUMNS, _opening_of_barrel
from omnimirror.optics.sensor_files import format_sensor
from tests.optics.lenses import prescriptions

ANGLES = np.linspace(0, 20, 41)
OMEGA = np.linspace(0, 130, 27)


def faultless(sensor, pupil=0.0):
    """Return the sensor with its lens as a table, and with a fixed entrance pupil as the ideal
    lens."""
    lens = replace(sensor.lens, entrance_pupil_mm=pupil)
    height = lens.principal_distance * np.tan(np.radians(ANGLES))
    table = TabulatedLens(
        lens.focal_length_mm,
        lens.f_number,
        lens.focus_distance_mm,
        tuple(ANGLES),
        tuple(height),
        tuple(np.full(len(ANGLES), pupil)),
    )
    return replace(sensor, lens=lens), replace(sensor, lens=table)


@pytest.mark.parametrize("pupil", [0.0, 6.0])
def test_ideal_table_equals_thin_lens(pupil):
    plain, table = faultless(om.load_sensor("paper-spherical"), pupil)
    for focus in (None, 190.0):
        tabulated, thin = (om.evaluate(s, OMEGA, focus_mm=focus) for s in (table, plain))
        for name in (
            "h_px",
            "dh_domega_px_per_deg",
            "viewpoint_z_mm",
            "distance_t_mm",
            "blur_t_px",
            "blur_s_px",
        ):
            assert getattr(tabulated, name) == pytest.approx(
                getattr(thin, name), rel=1e-7, abs=1e-7
            ), name
    assert om.best_focus(table).focus_mm == pytest.approx(om.best_focus(plain).focus_mm, rel=1e-6)
    pixels = np.array([[700.0, 600.0], [511.5, 200.0], [90.0, 400.0]])
    pupils = np.array([[0.3, 0.4], [-0.9, 0.1], [0.0, 0.8]])
    tabulated, thin = (s.aperture_rays(pixels, pupils) for s in (table, plain))
    assert np.abs(tabulated.directions - thin.directions).max() < 1e-8
    assert (
        np.abs(
            table.project(tabulated.origins + 90 * tabulated.directions).pixels
            - plain.project(tabulated.origins + 90 * tabulated.directions).pixels
        ).max()
        < 1e-6
    )
    spot = [om.spots(s, [60.0]).rms_px() for s in (table, plain)]
    assert np.abs(np.array(spot[0]) - np.array(spot[1])).max() < 1e-6


@pytest.fixture(scope="module")
def both(tmp_path_factory):
    """Lens defined by its surfaces, and by the table computed from them."""
    path = tmp_path_factory.mktemp("lens") / "triplet.zmx"
    path.write_text(prescriptions.zmx())
    lens = SurfaceLens.from_file(path, focus_distance_mm=212.0)
    t = np.tan(np.radians(ANGLES))
    pupil, height = lens.pupil.position(t), np.abs(lens.field.height(t)[0])
    table = TabulatedLens(
        lens.focal_length_mm,
        lens.f_number,
        212.0,
        tuple(ANGLES),
        tuple(height),
        tuple(pupil),
        principal_point_mm=lens.principal_point_mm,
    )
    imager = om.load_sensor("paper-spherical").imager
    mirror = om.load_sensor("paper-spherical").mirror
    return [om.Sensor(mirror, each, imager, mirror_distance_mm=182.0) for each in (lens, table)]


def test_table_chief_rays_match_source_lens(both):
    surfaces, table = (om.evaluate(s, OMEGA) for s in both)
    assert np.abs(surfaces.h_px - table.h_px).max() < 2e-4
    assert np.abs(surfaces.viewpoint_z_mm - table.viewpoint_z_mm).max() < 1e-4


def test_image_side_field_curvature_matches_object_side(both):
    """Defocus in mm behind the lens, found by moving the imager to the sharpest focus of narrow
    real bundles."""
    surfaces, table = both
    lens = surfaces.lens
    t = np.tan(np.radians(ANGLES))
    n, to_imager = prescriptions.indices(), prescriptions.imager_place(prescriptions.indices())
    positions, step = lens.pupil.position(t), 1e-4
    curvature = {0: [], 1: []}
    behind = []
    for tangent, z in zip(t, positions, strict=True):

        def image(dx, dy, extra, tangent=tangent, z=z):
            """Return images of rays from one point in focus through points near the pupil centre."""
            s0 = 212.0 - z
            direction = np.array([-(tangent * s0) + dx, dy, s0])
            start = np.array([tangent * s0, 0.0, -212.0])
            return -prescriptions.through(start, direction, n, to_imager + extra)[1]

        centre, extended = image(0, 0, 0.0), image(0, 0, 1.0)
        behind.append(np.degrees(np.arctan(extended[0] - centre[0])))
        for axis in (0, 1):
            moves = step * np.eye(2)[axis]
            at = [image(*moves, extra)[axis] - image(0, 0, extra)[axis] for extra in (0.0, 1.0)]
            curvature[axis].append(at[0] / (at[0] - at[1]))
    curved = replace(
        table.lens,
        chief_ray_deg=tuple(behind),
        field_curvature_t_mm=tuple(curvature[0]),
        field_curvature_s_mm=tuple(curvature[1]),
    )
    evaluation, expected = (om.evaluate(s, OMEGA) for s in (replace(table, lens=curved), surfaces))
    # except for a pupil size that increases with the angle, which the table does not contain
    magnification = lens.field.at(np.tan(np.radians(expected.theta_deg)))
    assert evaluation.blur_t_px * magnification.width_t == pytest.approx(
        expected.blur_t_px, abs=0.01, rel=2e-3
    )
    assert evaluation.blur_s_px * magnification.width_s == pytest.approx(
        expected.blur_s_px, abs=0.01, rel=2e-3
    )
    # and another focus: the imager moves along the chief rays
    curved_at_focus = replace(curved, table_focus_mm=212.0).focused_at(150.0)
    pairs = (table, curved_at_focus), (surfaces, lens.focused_at(150.0))
    near = [om.evaluate(replace(s, lens=each), OMEGA).h_px for s, each in pairs]
    assert np.abs(near[0] - near[1]).max() < 0.01


def test_lens_blur_and_illumination_included():
    _, table = faultless(om.load_sensor("paper-spherical"))
    attenuated = replace(
        table.lens,
        own_blur_t_mm=tuple(np.full(len(ANGLES), 0.0104)),
        own_blur_s_mm=tuple(np.zeros(len(ANGLES))),
        relative_illumination=tuple(1 - ANGLES / 40),
    )
    clear, blurred = om.evaluate(table, OMEGA), om.evaluate(replace(table, lens=attenuated), OMEGA)
    floor = 1 + clear.airy_px**2
    expected = (
        np.sqrt((clear.blur_t_px**2 + floor + 4) * (clear.blur_s_px**2 + floor)) / clear.area_px2
    )
    assert blurred.floored_area_deg2 == pytest.approx(expected, rel=1e-9)
    light = [
        om.illumination(replace(table, lens=lens), [60.0]).relative[0]
        for lens in (table.lens, attenuated)
    ]
    theta = clear.theta_deg[np.searchsorted(OMEGA, 60.0)]
    assert light[1] / light[0] == pytest.approx(
        (1 - theta / 40) / np.cos(np.radians(theta)) ** 4, rel=0.02
    )


def test_best_focus_includes_lens_blur():
    """Minimum area merit by exhaustive search."""
    _, table = faultless(om.load_sensor("paper-spherical"))
    lens_blur = tuple(0.02 * (ANGLES / 20) ** 2)
    sensor = replace(
        table, lens=replace(table.lens, own_blur_t_mm=lens_blur, own_blur_s_mm=lens_blur)
    )
    best = om.best_focus(sensor)
    merits = [
        om.evaluate(sensor, np.linspace(0, 135, 1001)[:-1], focus_mm=f).floored_area_deg2.max()
        for f in best.focus_mm * np.array([0.97, 0.99, 1.01, 1.03])
    ]
    assert best.value <= min(merits) * (1 + 1e-6)


def test_lens_table_file(tmp_path):
    plain, table = faultless(om.load_sensor("paper-spherical"))
    rows = zip(ANGLES, table.lens.image_height_mm, table.lens.entrance_pupil_mm, strict=True)
    lines = ["# a lens", "field_deg, image_height_mm, entrance_pupil_mm"]
    lines += [",".join(repr(float(v)) for v in row) for row in rows]
    (tmp_path / "lens.csv").write_text("\n".join(lines))
    text = format_sensor(plain)
    head, tail = text.split("[lens]\n")
    tail = tail[tail.index("[imager]") :]
    lens = '[lens]\nkind = "table"\nfile = "lens.csv"\nfocal_length_mm = 11.6\nf_number = 4.0\n'
    lens += "focus_distance_mm = 212.0\n\n"
    (tmp_path / "mine.toml").write_text(head + lens + tail)
    sensor = om.load_sensor(tmp_path / "mine.toml")
    assert sensor.lens == replace(table.lens, focus_distance_mm=212.0)
    assert om.parse_sensor(format_sensor(sensor)) == sensor


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("field_deg,hight\n0,0\n", "unknown column 'hight'; use field_deg"),
        ("field_deg,image_height_mm,entrance_pupil_mm\n0,0,x\n", "must contain 3 numbers"),
        ("", "is empty"),
        (
            "field_deg,image_height_mm,entrance_pupil_mm\n0,0,0\n5,1,0\n10,2,0\n",
            "at least 4 values",
        ),
        (
            "field_deg,image_height_mm,entrance_pupil_mm\n1,0,0\n5,1,0\n10,2,0\n15,3,0\n",
            "must increase from 0",
        ),
        (
            "field_deg,image_height_mm,entrance_pupil_mm\n0,0,0\n5,1,0\n10,2,0\n15,1,0\n",
            "stop increasing at",
        ),
        (
            "field_deg,image_height_mm,entrance_pupil_mm\n0,0,0\n5,1,0\n10,2,0\n15,3,400\n",
            "outside the|focus_distance",
        ),
    ],
)
def test_invalid_lens_tables_rejected(text, message, tmp_path):
    (tmp_path / "lens.csv").write_text(text)
    table = {
        "file": "lens.csv",
        "focal_length_mm": 11.6,
        "f_number": 4.0,
        "focus_distance_mm": 212.0,
    }
    with pytest.raises(OmnimirrorError, match=message):
        TabulatedLens(**TabulatedLens.from_spec(table, tmp_path))


BOUNDS = {
    "focal_length_mm": (1e-2, 1e5), "principal_point_mm": (-1e4, 1e4), "table_focus_mm": (1e-3, 1e7),
    "barrel_diameter_mm": (1e-3, 1e4), "barrel_mm": (-1e4, 1e4), "window_mm": (0.0, 1e3), "window_index": (1.0, 5.0),
    "field_deg": (0.0, 89.0), "image_height_mm": (0.0, 1e4), "entrance_pupil_mm": (-1e4, 1e4),
    "relative_illumination": (0.0, 2.0), "chief_ray_deg": (-89.0, 89.0), "field_curvature_t_mm": (-100.0, 100.0),
    "field_curvature_s_mm": (-100.0, 100.0), "own_blur_t_mm": (0.0, 10.0), "own_blur_s_mm": (0.0, 10.0),
    "lateral_colour_short_mm": (-10.0, 10.0), "lateral_colour_long_mm": (-10.0, 10.0),
}  # fmt: skip


@pytest.mark.parametrize("name", BOUNDS)
def test_table_entries_out_of_bounds_rejected(name):
    low, high = BOUNDS[name]
    lens = faultless(om.load_sensor("paper-spherical"))[1].lens
    is_column = name in COLUMNS
    for value in (low - 1e-4, high + 0.1):
        entries = (value,) * len(ANGLES) if is_column else value
        with pytest.raises(
            OmnimirrorError, match=re.escape(f"must be between {low:g} and {high:g}")
        ):
            replace(lens, **{name: entries})
    parameter = TabulatedLens.PARAMETERS[name]
    assert (parameter.low, parameter.high) == (low, high)


def test_entries_have_the_documented_defaults():
    """No barrel, no pane, a flat field, no blur and cos^4; the barrel's front and the principal point
    at the reference point; glass N-BK7 at the d line."""
    lens = TabulatedLens(11.6, 4.0, 212.0, (0.0, 5.0, 10.0, 20.0), (0.0, 1.0, 2.0, 4.0), (0.0,) * 4)
    assert (lens.barrel_diameter_mm, lens.barrel_mm, lens.principal_point_mm) == (None, 0.0, 0.0)
    assert (lens.window_mm, lens.window_index, lens.table_focus_mm) == (0.0, 1.5168, 212.0)
    assert all(getattr(lens, name) is None for name in list(COLUMNS)[3:])
    nodes = lens.field.nodes
    tangent = np.tan(np.radians(lens.field_deg))
    np.testing.assert_allclose(nodes.tangent, tangent)
    np.testing.assert_allclose(nodes.height, lens.image_height_mm)
    np.testing.assert_allclose(nodes.illumination, np.cos(np.radians(lens.field_deg)) ** 4)
    for ones in ("width_t", "width_s", "stop_t", "stop_s", "unvignetted_fraction"):
        assert getattr(nodes, ones).tolist() == [1.0] * 4
    for zeros in ("shift_t", "own_t", "own_s", "short", "long", "stop_shift"):
        assert getattr(nodes, zeros).tolist() == [0.0] * 4
    np.testing.assert_allclose(nodes.vergence_t, 1 / 212.0)
    np.testing.assert_allclose(nodes.vergence_s, 1 / 212.0)


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"field_deg": (0.0, 5.0, 5.0, 20.0)}, "field_deg must increase from 0; sort the rows"),
        ({"field_deg": (0.0, 10.0, 5.0, 20.0)}, "field_deg must increase from 0; sort the rows"),
        ({"field_deg": (0.5, 5.0, 10.0, 20.0)}, "field_deg must increase from 0; sort the rows"),
        (
            {"image_height_mm": (0.5, 1.0, 2.0, 4.0)},
            "image_height_mm must be 0 on the axis; got 0.5",
        ),
        (
            {"entrance_pupil_mm": (0.0,) * 3},
            "entrance_pupil_mm must have as many values as field_deg, 4; got 3",
        ),
        (
            {"own_blur_s_mm": (0.0,) * 5},
            "own_blur_s_mm must have as many values as field_deg, 4; got 5",
        ),
        (
            {"entrance_pupil_mm": (0.0, 0.0, 0.0, 212.0)},
            "focus_distance_mm must be greater than 212 mm, the position of the entrance pupil; got 212",
        ),
        (
            {"entrance_pupil_mm": (0.0, 250.0, 0.0, 0.0)},
            "focus_distance_mm must be greater than 250 mm, the position of the entrance pupil; got 212",
        ),
    ],
)
def test_inconsistent_columns_rejected(columns, message):
    table = {
        "field_deg": (0.0, 5.0, 10.0, 20.0),
        "image_height_mm": (0.0, 1.0, 2.0, 4.0),
        "entrance_pupil_mm": (0.0,) * 4,
    }
    with pytest.raises(OmnimirrorError, match=f"^{message}$"):
        TabulatedLens(11.6, 4.0, 212.0, **table | columns)


def test_pupil_may_end_just_below_the_focus():
    lens = TabulatedLens(
        11.6, 4.0, 212.0, (0.0, 5.0, 10.0, 20.0), (0.0, 1.0, 2.0, 4.0), (6.0, 6.0, 6.0, 8.0),
        principal_point_mm=2.0,
    )  # fmt: skip
    assert lens.pupil_from_principal == 4.0


def test_mirror_beyond_table_rejected():
    _, table = faultless(om.load_sensor("paper-spherical"))
    short = replace(
        table.lens,
        field_deg=table.lens.field_deg[:19],
        image_height_mm=table.lens.image_height_mm[:19],
        entrance_pupil_mm=table.lens.entrance_pupil_mm[:19],
    )
    with pytest.raises(OmnimirrorError, match=r"it ends at 9 deg; .* add rows"):
        om.evaluate(replace(table, lens=short), OMEGA)


def test_thin_lens_functions_reject_tables():
    _, table = faultless(om.load_sensor("paper-spherical"))
    for function in (lambda: om.SensorModel(table), lambda: om.blur_bound(table)):
        with pytest.raises(OmnimirrorError, match="requires a perspective or orthographic lens"):
            function()


def test_design_like_sensor_keeps_real_lens():
    ideal, table = faultless(om.load_sensor("paper-spherical"), pupil=6.0)
    requirements = om.requirements_like(table, family="sphere")
    assert requirements.lens.optics == table.lens
    design = om.design_sensor(requirements).sensor
    assert design.field_deg[1] == pytest.approx(table.field_deg[1], abs=1e-6)
    assert design.mirror.radius_mm == pytest.approx(table.mirror.radius_mm, rel=1e-4)
    assert design.mirror_distance_mm == pytest.approx(ideal.mirror_distance_mm, rel=1e-4)


# -- barrel vignetting
# --------------------------------------------------------------------------------------------


BARREL, BARREL_DISTANCE = 5.4, 12.0  # diameter in mm, before the pupil
ROWS = 31  # rows of the table, up to 15 deg


def barrelled(sensor, **more):
    _, full = faultless(sensor, pupil=6.0)
    columns = ("field_deg", "image_height_mm", "entrance_pupil_mm")
    table = replace(
        full,
        lens=replace(full.lens, **{name: getattr(full.lens, name)[:ROWS] for name in columns}),
    )
    barrel = {"barrel_diameter_mm": BARREL, "barrel_mm": 6.0 + BARREL_DISTANCE, **more}
    return table, replace(table, lens=replace(table.lens, **barrel))


def passing(lens, tangent, side=1201):
    """Return pupil points (n, 2), in pupil radii, whose rays to a focused point pass the barrel,
    and the total number."""
    u = np.linspace(-1, 1, side)
    disc = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    disc = disc[np.hypot(*disc.T) <= 1]
    distance = lens.focus_distance_mm - 6.0
    point = np.array([tangent * distance, 0.0])
    start = disc * lens.aperture_radius
    at_barrel = start + (point - start) * BARREL_DISTANCE / distance
    return disc[np.hypot(*at_barrel.T) <= BARREL / 2], len(disc)


def test_barrel_vignetting_matches_rays():
    without_barrel, vignetted = barrelled(om.load_sensor("paper-spherical"))
    angles = np.array([20.0, 60.0, 90.0, 120.0, 134.0])
    theta = np.tan(np.radians(om.evaluate(without_barrel, angles).theta_deg))
    plain, dimmed = (om.evaluate(s, angles) for s in (without_barrel, vignetted))
    light = np.array([om.illumination(s, angles).relative for s in (without_barrel, vignetted)])
    shares = []
    for k, tangent in enumerate(theta):
        unvignetted, count = passing(vignetted.lens, tangent)
        shares.append(len(unvignetted) / count)
        widths = np.ptp(unvignetted, axis=0) / 2
        assert dimmed.blur_t_px[k] / plain.blur_t_px[k] == pytest.approx(widths[0], abs=0.02)
        assert dimmed.blur_s_px[k] / plain.blur_s_px[k] == pytest.approx(widths[1], abs=0.02)
    assert light[1] / light[0] == pytest.approx(shares, abs=0.01)
    assert om.illumination(vignetted, angles).filled == pytest.approx(shares, abs=0.01)
    assert om.spots(vignetted, angles).filled == pytest.approx(
        shares, abs=0.04
    )  # sampled by 469 rays
    assert shares[0] == 1.0
    assert shares[-1] < 0.6  # a significant effect
    narrow, wide = (
        om.spots(s, [130.0], focus_mm=190.0).extent_px()[0].item()
        for s in (vignetted, without_barrel)
    )
    out_of_focus = [
        om.evaluate(s, [130.0], focus_mm=190.0).blur_t_px[0] for s in (vignetted, without_barrel)
    ]
    assert narrow / wide == pytest.approx(out_of_focus[0] / out_of_focus[1], abs=0.02)
    assert narrow / wide < 0.9


@pytest.mark.parametrize("diameter", [3.2, 4.4, 8.0])
def test_opening_of_barrel_matches_sampled_pupil(diameter):
    """Pupil points whose rays to a focused point pass the barrel's front: all of them, all but a
    segment, a lens narrower than the pupil, and a whole barrel inside the pupil."""
    lens = barrelled(om.load_sensor("paper-spherical"))[1].lens
    columns = ("field_deg", "image_height_mm", "entrance_pupil_mm")
    short = {name: getattr(lens, name)[:4] for name in columns}
    lens = replace(lens, **short, barrel_diameter_mm=diameter)
    pupil = np.array([6.0, 6.0, 6.0, 6.0, 6.0, 80.0, 80.0, 80.0, 150.0, 150.0])
    tangent = np.array([0.0, 0.03, 0.06, 0.12, 0.2, 0.001, 0.005, 0.02, 0.001, 0.01])
    focus, to_barrel = lens.focus_distance_mm - pupil, lens.barrel_mm - pupil
    u = np.linspace(-1, 1, 1001)
    x, y = (a.ravel() for a in np.meshgrid(u, u))
    disc = np.hypot(x, y) <= 1
    x, y = x[disc], y[disc]
    radius = lens.aperture_radius
    open_angles, expected = [], []
    for k, (t, s, a) in enumerate(zip(tangent, focus, to_barrel, strict=True)):
        share = a / s  # of the way to the point in focus at (t s, 0)
        at = x * radius * (1 - share) + t * s * share, y * radius * (1 - share)
        is_unvignetted = np.hypot(*at) <= diameter / 2
        if not is_unvignetted.any():
            continue
        open_angles.append(k)
        low, high = x[is_unvignetted].min(), x[is_unvignetted].max()
        expected.append(
            [
                (high - low) / 2,
                np.ptp(y[is_unvignetted]) / 2,
                (high + low) / 2,
                is_unvignetted.mean(),
            ]
        )
    assert len(open_angles) >= 8
    arguments = (values[open_angles] for values in (tangent, pupil, 1 / focus))
    np.testing.assert_allclose(
        np.stack(_opening_of_barrel(lens, *arguments), axis=1), expected, rtol=0, atol=5e-3
    )


@pytest.mark.parametrize("pane", [0.0, 6.0])
def test_clearance_at_the_barrel(pane):
    """(R^2 - r^2) / (2 R) at its front, about R - r next to the edge; the rays are displaced by the
    refraction at a pane behind it. A lens without a barrel has none."""
    without_barrel, vignetted = barrelled(
        om.load_sensor("paper-spherical"), window_mm=pane, window_index=GLASS
    )
    points = np.array([[0.0, 0.0, 6.0], [1.0, -2.0, 6.0], [0.5, 0.5, 10.0]])
    slopes = np.array([[0.0, 0.0], [0.1, 0.05], [-0.2, 0.1]])
    directions = np.column_stack([slopes, np.ones(3)])
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    u = np.hypot(*slopes.T)
    inside = np.tan(np.arcsin(np.sin(np.arctan(u)) / GLASS))
    displaced = pane * np.where(u > 0, 1 - inside / np.where(u > 0, u, 1.0), 1 - 1 / GLASS)
    at = points[:, :2] + (6.0 + BARREL_DISTANCE - points[:, 2] + displaced)[:, None] * slopes
    expected = ((BARREL / 2) ** 2 - (at**2).sum(1)) / BARREL
    clearances = vignetted.lens.clearances(points, directions)
    assert list(clearances) == ["barrel"]
    np.testing.assert_allclose(clearances["barrel"], expected, rtol=1e-12)
    assert expected[0] == BARREL / 4
    assert without_barrel.lens.clearances(points, directions) == {}


@pytest.mark.parametrize("barrel_mm", [212.0, 212.5, 1000.0])
def test_barrel_beyond_the_focus_rejected(barrel_mm):
    """All rays to a point in focus meet there: no barrel is behind it."""
    with pytest.raises(
        OmnimirrorError,
        match=f"got 5.4 at barrel_mm = {barrel_mm:g}; use a wider barrel, or one in front of the",
    ):
        barrelled(om.load_sensor("paper-spherical"), barrel_mm=barrel_mm)


def test_barrel_at_the_pupil_may_have_its_size():
    _, vignetted = barrelled(
        om.load_sensor("paper-spherical"), barrel_mm=6.0, barrel_diameter_mm=2.9
    )
    assert 2 * vignetted.lens.aperture_radius == 2.9
    assert vignetted.lens.field.nodes.unvignetted_fraction.tolist() == [1.0] * ROWS
    with pytest.raises(OmnimirrorError, match="must not vignette the bundle on the axis"):
        replace(vignetted.lens, barrel_diameter_mm=2.8999)


def test_barrel_vignetting_in_images():
    from omnimirror.simulation.radiometry import Radiometry
    from tests.simulation.test_rendering_wavelengths import Stripes

    without_barrel, vignetted = (
        replace(s, imager=replace(s.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
        for s in barrelled(om.load_sensor("paper-spherical"))
    )
    images = [
        om.expose(s, Stripes(), samples=2, radiometry=Radiometry(vignetting=1.0))[32, :, 0]
        for s in (without_barrel, vignetted)
    ]
    edge = slice(2, 5)
    assert images[1][edge].sum() < 0.75 * images[0][edge].sum()
    assert images[1][32] == pytest.approx(images[0][32], rel=1e-3)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"barrel_diameter_mm": 2.0}, "must not vignette the bundle on the axis"),
        ({"barrel_mm": 60.0}, r"it blocks all light at [\d.]+ deg; remove these rows or use"),
        ({"barrel_mm": 300.0}, "must not vignette the bundle on the axis"),
    ],
)
def test_blocking_barrels_rejected(entries, message):
    with pytest.raises(OmnimirrorError, match=message):
        barrelled(om.load_sensor("paper-spherical"), **entries)


# -- window between lens and mirror
# -------------------------------------------------------------------------------


PANE, GLASS, PANE_DISTANCE = 6.0, 1.5168, 40.0  # mm, index, mm before the pupil


def behind_pane(points, slopes):
    """Return origins in the pupil plane of rays (n, 2) behind the window, by Snell's law at both
    faces."""
    u = np.hypot(*slopes.T)
    inside = np.tan(np.arcsin(np.sin(np.arctan(u)) / GLASS))
    direction = slopes / np.where(u > 0, u, 1.0)[:, None]
    entry = points + PANE_DISTANCE * slopes
    exit_point = entry + PANE * inside[:, None] * direction
    return exit_point - (PANE_DISTANCE + PANE) * slopes


def outside_ball(start, slopes, pupil_z, radius):
    """Return directions (n, 3) of rays reflected by a ball with its vertex at 0, z from the lens
    outwards."""
    p = np.column_stack([start, np.full(len(start), pupil_z)])
    d = np.column_stack([slopes, np.ones(len(slopes))])
    d /= np.linalg.norm(d, axis=1)[:, None]
    to = p - [0.0, 0.0, radius]
    along = (to * d).sum(1)
    hit = p + (-along - np.sqrt(along**2 - (to**2).sum(1) + radius**2))[:, None] * d
    normal = (hit - [0.0, 0.0, radius]) / radius
    return d - 2 * (d * normal).sum(1)[:, None] * normal


def test_pane_matches_refracted_rays():
    sensor = om.load_sensor("paper-spherical")
    narrow = replace(sensor, lens=replace(sensor.lens, f_number=40.0))
    ideal, without_barrel = faultless(narrow, pupil=6.0)
    paned = replace(
        without_barrel, lens=replace(without_barrel.lens, window_mm=PANE, window_index=GLASS)
    )
    lens, radius, z = ideal.lens, sensor.mirror.radius_mm, 6.0 - sensor.mirror_distance_mm
    tangents = np.tan(np.radians([2.0, 5.0, 8.0, 11.0]))
    for tangent in tangents:
        y = lens.aperture_radius * np.array([[0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]])
        point = np.array([tangent * lens.from_pupil, 0.0])
        slopes = (point - y) / lens.from_pupil
        out = outside_ball(behind_pane(y, slopes), slopes, z, radius)
        omega = np.degrees(np.arctan2(out[:, 0], -out[:, 2]))
        with_pane, without = (om.evaluate(s, [omega[0]]) for s in (paned, without_barrel))
        height = lens.principal_distance * tangent / sensor.imager.pitch_mm
        assert with_pane.h_px[0] == pytest.approx(height, abs=1e-4)
        assert abs(without.h_px[0] - height) > 0.05
        across = np.degrees(np.arccos(out[3] @ out[4]))
        assert abs(with_pane.blur_t_deg[0]) == pytest.approx(abs(omega[1] - omega[2]), abs=2e-4)
        assert abs(with_pane.blur_s_deg[0]) == pytest.approx(across, abs=2e-4)
    spot, bundle = om.spots(paned, [90.0]).extent_px(), om.evaluate(paned, [90.0])
    assert spot[0].item() == pytest.approx(abs(bundle.blur_t_px[0]), abs=0.01)
    assert spot[1].item() == pytest.approx(abs(bundle.blur_s_px[0]), abs=0.01)


@pytest.mark.parametrize("names", [("short",), ("long",), ("short", "long"), ()])
def test_lateral_colour_at_three_lines(names):
    """F, d and C; in between a parabola in 1/wavelength^2."""
    angles, heights = (0.0, 5.0, 10.0, 20.0), (0.0, 1.0, 2.0, 4.1)
    shifts = {"short": (0.0, 0.004, 0.01, 0.03), "long": (0.0, -0.006, -0.02, -0.05)}
    lens = TabulatedLens(
        11.6,
        4.0,
        212.0,
        angles,
        heights,
        (0.0, 0.0, 0.0, 0.0),
        **{f"lateral_colour_{name}_mm": shifts[name] for name in names},
    )
    zeros = (0.0, 0.0, 0.0, 0.0)
    short, long = (shifts[name] if name in names else zeros for name in ("short", "long"))
    for nm, shift in ((486.1327, short), (587.5618, zeros), (656.2725, long)):
        lens_at_line = lens.at_wavelength(nm)
        np.testing.assert_allclose(lens_at_line.image_height_mm, np.add(heights, shift), atol=1e-9)
        assert lens_at_line.lateral_colour_short_mm is None or not names
    x = 1 / np.array([486.1327, 587.5618, 656.2725]) ** 2
    parabola = np.polyfit(1e6 * x, [short[3], 0.0, long[3]], 2)
    assert lens.at_wavelength(540.0).image_height_mm[3] == pytest.approx(
        4.1 + np.polyval(parabola, 1e6 / 540.0**2), abs=1e-9
    )
