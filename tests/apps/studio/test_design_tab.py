"""Server of the Design tab: responses against the evaluation, conversion of mirrors, files,
worker processes."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace

import cv2
import numpy as np
import pytest
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio._design_files import sensor_report
from omnimirror.apps.studio._design_sensors import spline_like
from omnimirror.apps.studio._http_messages import framed, unframed
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.design_messages import ApiError
from omnimirror.design.requirement_files import parse_requirements
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors import MIRRORS
from omnimirror.optics.mirrors.mirror import MirrorForm, MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors, format_sensor, parse_sensor, tables_of
from tests.test_extensions import Quartic

LOCAL = "http://127.0.0.1"
REQUIREMENTS = {
    "field": {"omega_max_deg": 130.0, "object_distance_mm": [600.0, 1e12]},
    "limit": [
        {"quantity": "total_blur_px", "at_most": 9.0},
        {"quantity": "resolution_px_per_deg", "at_least": 3.0},
    ],
}


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


def design_request(sensor: om.Sensor, **changes) -> dict:
    defaults = {
        "slot": 0,
        "number": 1,
        "tables": tables_of(sensor),
        "follows_mapping": False,
        "object_distance_mm": None,
    }
    return {
        **defaults,
        "include_section": False,
        "include_squares": False,
        "requirements": None,
        **changes,
    }


def unpack_message(data: bytes) -> tuple[dict, dict[str, dict[str, np.ndarray]]]:
    """Return the header of a binary message, and its blocks by name and column."""
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])
    offset, blocks = 4 + length, {}
    for block in header["blocks"]:
        columns = {}
        for column in block["columns"]:
            columns[column] = np.frombuffer(data, "<f4", block["rows"], offset)
            offset += 4 * block["rows"]
        blocks[block["name"]] = columns
    assert offset == len(data)
    return header, blocks


def evaluate_designs(
    client, *requests: dict
) -> list[tuple[dict, dict[str, dict[str, np.ndarray]]]]:
    answers = []
    with client.websocket_connect("ws://127.0.0.1/api/design/ask") as socket:
        for request in requests:
            socket.send_json(request)
            answers.append(unpack_message(socket.receive_bytes()))
    return answers


def post(client, route: str, **body):
    return client.post(f"/api/design/{route}", json=body)


# -- responses
# ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", bundled_sensors())
def test_curves_match_evaluation(name, client):
    sensor = om.load_sensor(name)
    request = design_request(
        sensor, object_distance_mm=900.0, include_section=True, include_squares=True
    )
    (header, blocks), *_ = evaluate_designs(client, request)
    assert header["error"] is None
    curves = blocks["curves"]
    expected = om.evaluate(sensor, np.linspace(*sensor.field_deg, 361), object_distance_mm=900.0)
    for column, values in curves.items():
        np.testing.assert_allclose(
            values, getattr(expected, column), rtol=2e-6, atol=2e-5, err_msg=column
        )
    assert header["summary"]["rim_radius_px"] == pytest.approx(sensor.rim_radius_px)
    mirror = blocks["mirror"]
    is_inside = np.isfinite(mirror["z_mm"])
    x = np.minimum(np.abs(mirror["x_mm"][is_inside].astype(float)), sensor.mirror.rim_radius_mm)
    np.testing.assert_allclose(mirror["z_mm"][is_inside], sensor.mirror.sag(x), atol=1e-4)


def test_section_rays_satisfy_reflection_law(client):
    """Incident at Omega, reflected to the lens: both directions make the same angle with the mirror
    normal."""
    sensor = om.load_sensor("paper-spherical")
    (_, blocks), *_ = evaluate_designs(client, design_request(sensor, include_section=True))
    rays = {float(name[4:]): block for name, block in blocks.items() if name.startswith("ray ")}
    assert sorted(rays) == list(range(0, 136, 15))
    for omega, ray in rays.items():
        (x, lens_x), (z, lens_z) = ray["x_mm"].astype(float), ray["z_mm"].astype(float)
        slope = float(sensor.mirror.slope(x))
        normal = np.array([slope, -1.0]) / np.hypot(slope, 1.0)
        to_object = np.array([np.sin(np.radians(omega)), -np.cos(np.radians(omega))])
        to_lens = np.array([lens_x - x, lens_z - z])
        assert to_object @ normal == pytest.approx(
            to_lens @ normal / np.linalg.norm(to_lens), abs=1e-5
        )


def test_error_contains_entry(client):
    sensor = om.load_sensor("paper-spherical")
    tables = tables_of(sensor)
    entries = [
        ("lens", "f_number", 0.0),
        ("mirror", "rim_radius_mm", 51.0),  # outside the sphere
        ("lens", "focus_distance_mm", 5.0),  # shorter than the focal length
        ("mount", "mirror_distance_mm", -1.0),
    ]
    for section, name, value in entries:
        invalid = {**tables, section: {**tables[section], name: value}}
        (header, blocks), *_ = evaluate_designs(client, design_request(sensor, tables=invalid))
        assert header["error"]["path"] == [section, name]
        assert name in header["error"]["message"]
        assert blocks == {}


def test_newest_waiting_request_is_answered(client):
    sensor = om.load_sensor("exact-equidistant")
    with client.websocket_connect("ws://127.0.0.1/api/design/ask") as socket:
        for number in range(1, 41):
            socket.send_json(design_request(sensor, number=number, slot=0))
        numbers = [0]
        while numbers[-1] < 40:
            numbers.append(unpack_message(socket.receive_bytes())[0]["number"])
    assert numbers == sorted(numbers)
    assert len(numbers) < 35


def test_lens_position_follows_mapping(client):
    sensor = om.load_sensor("exact-equidistant")
    wider = replace(sensor, mirror=replace(sensor.mirror, omega_max_deg=120.0))
    (header, blocks), *_ = evaluate_designs(client, design_request(wider, follows_mapping=True))
    assert header["summary"]["mirror_distance_mm"] == pytest.approx(wider.mirror.design_distance)
    rate = blocks["curves"]["dh_domega_px_per_deg"]
    np.testing.assert_allclose(rate, rate[0], rtol=1e-6)


def test_requirements_are_evaluated_at_worst_angle_and_distance(client):
    sensor = om.load_sensor("paper-spherical")
    (header, _), *_ = evaluate_designs(client, design_request(sensor, requirements=REQUIREMENTS))
    rows = {row["name"]: row for row in header["rows"]}
    omega = np.linspace(0, 130, 4001)
    worst = max(
        np.hypot([e.blur_t_px, e.blur_s_px], e.airy_px).max()
        for e in (om.evaluate(sensor, omega, object_distance_mm=d) for d in (600.0, np.inf))
    )
    blur = rows["total_blur_px"]
    assert blur["value"] == pytest.approx(worst, rel=1e-4)
    assert blur["is_met"] == (worst <= 9.0)
    assert blur["margin"] == pytest.approx(9.0 - worst, abs=1e-3)
    assert not rows["resolution_px_per_deg"]["is_met"]
    assert rows["resolution_px_per_deg"]["omega_deg"] == pytest.approx(130.0)
    assert rows["omega_max_deg"]["is_met"]
    (header, _), *_ = evaluate_designs(
        client, design_request(sensor, requirements={"field": {"omega_max_deg": 500}})
    )
    assert header["rows"] == []
    assert "omega_max_deg" in header["requirements_error"]


def test_values_beyond_float32_become_infinite():
    header = ApiError(path=(), message="")
    _, data = unframed(framed(header, np.array([-1e300, 1e39, 0.5])), ApiError)
    assert np.frombuffer(data, "<f4").tolist() == [-np.inf, np.inf, 0.5]


# -- conversion of parts
# -------------------------------------------------------------------------------


@pytest.fixture
def quartic():
    om.register_mirror(Quartic)
    yield
    MIRRORS.withdraw(Quartic.KIND)


def changed_values(parameter: dict, value):
    """Return valid values next to a value of a parameter."""
    if parameter["choices"]:
        return [choice for choice in parameter["choices"] if choice != value]
    if parameter["is_list"]:
        return [
            [*value[:-2], number, value[-1]]
            for number in changed_values({"is_list": False, "choices": ()}, value[-2])
        ]
    return [value * 1.0001 if value else 1e-4, value * 0.9999]


@pytest.mark.parametrize("kind", [*MIRRORS, Quartic.KIND])
def test_mirror_type_is_never_substituted(kind, client, quartic):
    """The requested type has the rim of the previous mirror and persists when a parameter is
    changed and the design is evaluated."""
    sensor = om.load_sensor("paper-spherical")
    response = post(
        client,
        "change",
        tables=tables_of(sensor),
        target="mirror",
        to=kind,
        object_distance_mm=None,
    ).json()
    new = parse_sensor(format_sensor(parse_sensor(toml(response["tables"]))))
    assert response["tables"]["mirror"]["kind"] == kind
    assert new.mirror.rim_radius_mm == pytest.approx(sensor.mirror.rim_radius_mm)
    field_deg = {"rectifying": 75.0, "ground-plane": 75.0}.get(kind, sensor.field_deg[1])
    assert new.field_deg[1] == pytest.approx(field_deg, abs=0.06)
    assert np.degrees(new.meridian.theta_max) == pytest.approx(
        np.degrees(sensor.meridian.theta_max), abs=0.02
    )
    parts = {part["kind"]: part for part in client.get("/api/design").json()["mirrors"]}
    valid = set()
    for parameter in parts[kind]["parameters"]:
        name = parameter["name"]
        if (value := response["tables"]["mirror"].get(name)) is None:
            continue
        for new_value in changed_values(parameter, value):
            tables = {
                **response["tables"],
                "mirror": {**response["tables"]["mirror"], name: new_value},
            }
            (header, blocks), *_ = evaluate_designs(
                client,
                design_request(sensor, tables=tables, follows_mapping=response["follows_mapping"]),
            )
            if header["error"] is not None:  # a range that depends on other parameters
                assert header["error"]["path"][:1] == ["mirror"], (name, header["error"])
                continue
            assert np.isfinite(blocks["curves"]["h_px"]).all()
            text = post(client, "file", tables=tables, kind="sensor", object_distance_mm=None).text
            mirror = tomllib.loads(text)["mirror"]
            assert mirror["kind"] == kind
            assert (
                mirror[name] == pytest.approx(new_value) if name in mirror else new_value == value
            )
            valid.add(name)
    assert valid, "no parameter can be changed"


def mirror_kinds(client) -> list[str]:
    return [part["kind"] for part in client.get("/api/design").json()["mirrors"]]


def test_mirror_registered_later_is_offered(client, request):
    assert Quartic.KIND not in mirror_kinds(client)
    request.getfixturevalue("quartic")
    assert Quartic.KIND in mirror_kinds(client)


def test_design_and_requirement_file_do_not_choose_a_mirror_type(client):
    """Without a mirror in the requirements, the file contains that of the Design tab, and a search
    is rejected."""
    requirements = {"field": REQUIREMENTS["field"]}
    for name, mirror in {
        "paper-spherical": {"family": "sphere"},
        "paper-hyperboloidal": {"family": "hyperboloid"},
        "exact-equidistant": {"mapping": "equidistant"},
        "paper-equidistant": {"family": "polynomial:3"},
    }.items():
        sensor = om.load_sensor(name)
        text = post(
            client, "requirements", requirements=requirements, tables=tables_of(sensor)
        ).text
        radius = {"rim_radius_mm": sensor.mirror.rim_radius_mm}
        assert tomllib.loads(text)["mirror"] == mirror | radius
    spline = replace(sensor, mirror=spline_like(sensor))
    response = post(client, "requirements", requirements=requirements, tables=tables_of(spline))
    assert "got a slope-spline mirror" in response.json()["detail"]
    with client.websocket_connect("ws://127.0.0.1/api/design/work") as socket:
        socket.send_json(task(kind="design", requirements=requirements))
        last = socket.receive_json()
    assert (last["state"], last["sensor"]) == ("failed", None)
    assert "must specify a mapping or a family" in last["message"]


@pytest.mark.parametrize("name", ["paper-spherical", "paraboloid-telecentric", "exact-equidistant"])
def test_changing_lens_keeps_image_size(name, client):
    sensor = om.load_sensor(name)
    to = "perspective" if sensor.lens.TELECENTRIC else "orthographic"
    response = post(
        client, "change", tables=tables_of(sensor), target="lens", to=to, object_distance_mm=None
    ).json()
    new = parse_sensor(toml(response["tables"]))
    assert response["tables"]["lens"]["kind"] == to
    assert new.rim_radius_px == pytest.approx(sensor.rim_radius_px, rel=0.05)


def test_lens_is_tabulated_and_surface_lens_requires_file(client):
    sensor, omega = om.load_sensor("paper-spherical"), [30.0, 90.0, 130.0]
    body = {"tables": tables_of(sensor), "target": "lens", "object_distance_mm": None}
    tabulated = parse_sensor(toml(post(client, "change", to="table", **body).json()["tables"]))
    assert tabulated.lens.KIND == "table"
    focus = tabulated.lens.focus_distance_mm
    assert om.evaluate(tabulated, omega).h_px == pytest.approx(
        om.evaluate(sensor, omega, focus_mm=focus).h_px, abs=0.01
    )
    response = post(client, "change", to="surfaces", **body)
    assert "requires a .zmx file" in response.json()["detail"]


def test_best_focus_matches_library(client):
    sensor = om.load_sensor("paper-spherical")
    body = {"target": "focus", "to": "worst_blur_px", "object_distance_mm": 300.0}
    result = post(client, "change", tables=tables_of(sensor), **body).json()
    best = om.best_focus(sensor, "worst_blur_px", object_distance_mm=300.0).focus_mm
    assert result["tables"]["lens"]["focus_distance_mm"] == pytest.approx(best, abs=1e-3)
    response = post(
        client,
        "change",
        tables=tables_of(sensor),
        target="mirror",
        to="spoon",
        object_distance_mm=None,
    )
    assert response.status_code == 400
    assert "spoon" in response.json()["detail"]


def toml(tables: dict) -> str:
    import tomli_w

    return tomli_w.dumps(tables)


# -- files
# ---------------------------------------------------------------------------------------------


def test_sensor_file_round_trip(client):
    sensor = om.load_sensor("folded-spherical")
    text = post(
        client, "file", tables=tables_of(sensor), kind="sensor", object_distance_mm=None
    ).content
    assert parse_sensor(text.decode()) == sensor
    response = client.post("/api/design/open", params={"name": "mine.toml"}, content=text).json()
    assert parse_sensor(toml(response["sensor"]["tables"])) == sensor


def test_requirement_file_round_trip(client):
    sections = {
        "mirror": {"mapping": "equidistant", "rim_radius_mm": 40.0},
        "lens": {"theta_max_deg": [10, 14]},
    }
    text = toml({**REQUIREMENTS, **sections})
    text = text.replace("1000000000000.0", "inf")
    response = client.post("/api/design/open", params={"name": "wanted.toml"}, content=text).json()
    assert response["sensor"] is None
    sensor = om.load_sensor("paper-spherical")
    copy = post(
        client, "requirements", requirements=response["requirements"], tables=tables_of(sensor)
    ).text
    expected, result = parse_requirements(text), parse_requirements(copy)
    assert (result.field, result.mirror, result.lens, result.limits) == (
        expected.field,
        expected.mirror,
        expected.lens,
        expected.limits,
    )


def test_evaluation_table_matches_command_line(client, tmp_path):
    sensor = om.load_sensor("paper-spherical")
    table = post(client, "file", tables=tables_of(sensor), kind="table", object_distance_mm=800.0)
    om.evaluate(sensor, np.linspace(*sensor.field_deg, 361), object_distance_mm=800.0).to_csv(
        tmp_path / "t.csv"
    )
    assert table.content == (tmp_path / "t.csv").read_bytes()
    assert 'filename="paper-spherical-evaluation.csv"' in table.headers["content-disposition"]


FILE_REFERENCES = (
    b'[mirror]\nkind = "sampled"\nprofile_csv = "/etc/passwd"\n[lens]\n[imager]\n',
    b'[field]\nomega_max_deg = 90\n[mirror]\nmapping = "tabulated-mapping"\nmapping_csv = "/etc/passwd"\n',
)


@pytest.mark.parametrize(
    "text", [b"\xff\xfe", b"[mirror", b"x = 1", b"[field]\nomega = 3", *FILE_REFERENCES]
)
def test_invalid_files_are_rejected(text, client):
    answer = client.post("/api/design/open", params={"name": "bad.toml"}, content=text)
    assert answer.status_code == 400
    assert "bad.toml" in answer.json()["detail"]
    assert "root:" not in answer.text


def test_no_request_makes_server_read_a_file(client):
    sensor = om.load_sensor("paper-spherical")
    tables = {**tables_of(sensor), "mirror": {"kind": "sampled", "profile_csv": "/etc/passwd"}}
    (header, _), *_ = evaluate_designs(client, design_request(sensor, tables=tables))
    assert "must not name a file" in header["error"]["message"]
    mirror = {"mapping": "tabulated-mapping", "mapping_csv": "/etc/passwd", "rim_radius_mm": 40.0}
    (header, _), *_ = evaluate_designs(
        client, design_request(sensor, requirements={**REQUIREMENTS, "mirror": mirror})
    )
    assert "must not name a file" in header["requirements_error"]


@pytest.mark.parametrize("entry", [None, [], {}, "x", -1, [[1]], 1e300])
def test_invalid_tables_are_rejected(entry, client):
    sensor = om.load_sensor("folded-spherical")
    invalid = [
        {**tables_of(sensor), section: entry}
        for section in ("name", "mirror", "lens", "mount", "secondary")
    ]
    invalid += [{**tables_of(sensor), "mirror": {**tables_of(sensor)["mirror"], "kind": entry}}]
    invalid += [
        {**tables_of(sensor), "mirror": {**tables_of(sensor)["mirror"], "rim_radius_mm": entry}}
    ]
    answers = evaluate_designs(
        client, *(design_request(sensor, tables=tables, follows_mapping=True) for tables in invalid)
    )
    assert all(header["error"] or header["summary"] for header, _ in answers)
    assert sum(header["error"] is not None for header, _ in answers) >= 5
    requirements = [
        {**REQUIREMENTS, "limit": [entry]},
        {**REQUIREMENTS, "field": entry},
        {**REQUIREMENTS, "mirror": entry},
    ]
    answers = evaluate_designs(
        client,
        *(design_request(om.load_sensor("paper-spherical"), requirements=w) for w in requirements),
    )
    assert all(header["requirements_error"] for header, _ in answers)


def test_invalid_request_closes_connection(client):
    for route in ("ask", "work"):
        with client.websocket_connect(f"ws://127.0.0.1/api/design/{route}") as socket:
            socket.send_text("{}")
            message = socket.receive()
            assert message["type"] == "websocket.close"
            assert message["reason"].endswith(" must be given")


@pytest.mark.full
def test_preview_is_reduced_simulated_image(client):
    sensor = om.load_sensor("paper-spherical")
    data = post(client, "image", tables=tables_of(sensor), width_px=128, samples=1).content
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])
    image = cv2.imdecode(np.frombuffer(data, np.uint8, header["image_bytes"], 4 + length), 1)[
        ..., ::-1
    ]
    assert image.shape == (128, 128, 3)
    full = om.render_image(replace(sensor, imager=Imager(512, 512, 10.4)), om.Room(), samples=1)
    small = cv2.resize(full, (128, 128), interpolation=cv2.INTER_AREA).astype(float)
    assert np.abs(cv2.blur(image.astype(float), (5, 5)) - cv2.blur(small, (5, 5))).mean() < 4


# -- tasks
# -----------------------------------------------------------------------------------------------


def task(**changes) -> dict:
    sensor = om.load_sensor("paper-spherical")
    defaults = {
        "kind": "optimise",
        "tables": tables_of(sensor),
        "requirements": None,
        "merit": "worst_blur_deg",
    }
    return {
        **defaults,
        "terms": 3,
        "starts": 1,
        "shape": "polynomial",
        "object_distance_mm": None,
        **changes,
    }


@pytest.mark.full
def test_optimisation_reports_progress(client):
    with client.websocket_connect("ws://127.0.0.1/api/design/work") as socket:
        socket.send_json(task(object_distance_mm=400.0))
        messages = [socket.receive_json()]
        while messages[-1]["state"] == "running":
            messages.append(socket.receive_json())
    assert len(messages) > 2
    last = messages[-1]
    assert last["state"] == "done"
    sensor = parse_sensor(toml(last["sensor"]["tables"]))
    e = om.evaluate(sensor, np.linspace(0, sensor.field_deg[1], 2001), object_distance_mm=400.0)
    assert np.maximum(np.abs(e.blur_t_deg), np.abs(e.blur_s_deg)).max() == pytest.approx(
        last["value"], rel=1e-3
    )


def test_reason_against_optimisation_is_reported_in_advance(client):
    sensor = om.load_sensor("folded-spherical")
    ((header, _),) = evaluate_designs(client, design_request(sensor))
    assert "has two" in header["summary"]["not_optimised"]
    with client.websocket_connect("ws://127.0.0.1/api/design/work") as socket:
        socket.send_json(task(tables=tables_of(sensor)))
        message = socket.receive_json()
    assert (message["state"], message["message"]) == ("failed", header["summary"]["not_optimised"])


@pytest.mark.full
def test_optimisation_under_telecentric_lens_keeps_image_size(client):
    sensor = om.load_sensor("paraboloid-telecentric")
    ((header, _),) = evaluate_designs(client, design_request(sensor))
    assert header["summary"]["not_optimised"] is None
    with client.websocket_connect("ws://127.0.0.1/api/design/work") as socket:
        socket.send_json(task(tables=tables_of(sensor), terms=4))
        message = socket.receive_json()
        while message["state"] == "running":
            message = socket.receive_json()
    result = parse_sensor(toml(message["sensor"]["tables"]))
    assert result.lens.KIND == "orthographic"
    assert result.lens.working_f_number == pytest.approx(sensor.lens.working_f_number)
    assert result.imager == sensor.imager
    assert result.rim_radius_px == pytest.approx(sensor.rim_radius_px)
    assert result.field_deg[1] == pytest.approx(sensor.field_deg[1])
    after, before = (
        np.maximum(np.abs(e.blur_t_deg), np.abs(e.blur_s_deg)).max()
        for e in (om.evaluate(s, np.linspace(1, s.field_deg[1], 999)) for s in (result, sensor))
    )
    assert after < before
    assert after == pytest.approx(message["value"], rel=0.02)


@pytest.mark.parametrize(
    "name", ["paraboloid-telecentric", "paper-hyperboloidal", "folded-hyperboloidal"]
)
def test_requirement_file_contains_lens_of_sensor(name, client):
    sensor = om.load_sensor(name)
    lens = parse_requirements(
        post(client, "requirements", requirements=REQUIREMENTS, tables=tables_of(sensor)).text
    ).lens
    assert lens.kind == sensor.lens.KIND
    if name == "paraboloid-telecentric":
        assert lens.f_number == pytest.approx(sensor.lens.working_f_number)
        assert lens.focal_length_mm is None
        return
    assert lens.f_number == sensor.lens.f_number
    assert lens.focal_length_mm == sensor.lens.focal_length_mm
    theta = np.arctan(sensor.rim_radius_px * sensor.imager.pitch_mm / sensor.lens.image_distance)
    assert lens.theta_max_deg == pytest.approx(np.degrees(theta), abs=1e-5)


def misaligned() -> om.Sensor:
    pose = MirrorPose(decentre_x_mm=1.7, decentre_y_mm=-0.9, displacement_mm=1.0, tilt_x_deg=0.8)
    return replace(om.load_sensor("paper-spherical"), mirror_pose=pose)


def test_remark_reports_form_error(client):
    sensor = om.load_sensor("paper-spherical")
    formed = replace(sensor, mirror_form=MirrorForm((5,), (0.5,)))
    (header, blocks), (_, same) = evaluate_designs(
        client, design_request(formed), design_request(sensor)
    )
    assert header["error"] is None
    assert header["note"].startswith("The file contains a form error of the mirror")
    assert header["summary"]["not_optimised"].endswith(
        "this one has a form error or a tilted imager."
    )
    np.testing.assert_array_equal(blocks["curves"]["h_px"], same["curves"]["h_px"])


def test_misaligned_sensor_is_plotted_aligned_with_remark(client):
    sensor = misaligned()
    response = client.post(
        "/api/design/open", params={"name": "m.toml"}, content=format_sensor(sensor)
    ).json()
    assert parse_sensor(toml(response["sensor"]["tables"])) == sensor
    (header, blocks), (aligned_header, aligned_blocks) = evaluate_designs(
        client, design_request(sensor), design_request(sensor.aligned())
    )
    assert header["error"] is None
    assert "decentred by 1.7 and -0.9 mm, tilted by 0.8 and 0°" in header["note"]
    assert aligned_header["note"] is None
    np.testing.assert_array_equal(blocks["curves"]["h_px"], aligned_blocks["curves"]["h_px"])
    assert "aligned" in header["summary"]["not_optimised"]
    change = {"target": "focus", "to": "worst_floored_area_deg2", "object_distance_mm": None}
    focused = post(client, "change", tables=tables_of(sensor), **change)
    assert parse_sensor(toml(focused.json()["tables"])).mirror_pose == sensor.mirror_pose
    response = post(client, "file", tables=tables_of(sensor), kind="table", object_distance_mm=None)
    assert response.status_code == 400
    assert "the evaluation requires an aligned mirror" in response.json()["detail"]
    with pytest.raises(om.OmnimirrorError, match="the report requires an aligned mirror"):
        sensor_report(sensor, lambda step, fraction: None)


def test_rendered_image_includes_misalignment(client):
    sizes = {"width_px": 64, "samples": 1}
    images = [
        post(client, "image", tables=tables_of(sensor), **sizes).content
        for sensor in (misaligned(), misaligned().aligned())
    ]
    assert images[0] != images[1]


def test_sensor_is_designed_from_requirements(client):
    requirements = {
        **REQUIREMENTS,
        "mirror": {"mapping": "equidistant", "rim_radius_mm": 40.0},
        "lens": {"theta_max_deg": 12.0},
    }
    requirements["limit"] = [{"quantity": "resolution_px_per_deg", "at_least": 3.0}]
    with client.websocket_connect("ws://127.0.0.1/api/design/work") as socket:
        socket.send_json(task(kind="design", requirements=requirements))
        message = socket.receive_json()
        while message["state"] == "running":
            message = socket.receive_json()
    assert message["message"] == "All requirements are met."
    assert message["sensor"]["tables"]["mirror"]["kind"] == "equidistant"
    assert tomllib.loads(toml(message["sensor"]["tables"]))["mirror"]["omega_max_deg"] == 130.0
