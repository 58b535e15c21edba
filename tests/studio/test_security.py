"""Attacks on the server, each over loopback: what it must not open, hold or answer."""

from __future__ import annotations

import os

import pytest
import tomli_w
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.mirrors import MIRRORS, SECONDARIES
from omnimirror.specs import tables_of
from omnimirror.studio.app import create_app
from omnimirror.studio.bench.messages import Task
from omnimirror.studio.bench.work import perform

LOCAL = "http://127.0.0.1"
SECRET = "1.25, 2.5"
SPHERE = tables_of(om.load_sensor("paper-spherical"))
FIELD = {"field": {"omega_max_deg": 90.0}, "lens": {"theta_max_deg": 12.0}}
FILES = {kind: cls.FILE.entry for kind, cls in SECONDARIES.items() if cls.FILE is not None}


@pytest.fixture
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


# -- files that an upload names --------------------------------------------------------------------------


def spies(path: str) -> list[dict]:
    """Tables of sensors and of requirements that name a file, wherever a table may."""
    mirrors = [{"kind": kind, entry: path, "theta_max_deg": 12.0} for kind, entry in FILES.items()]
    folded = tables_of(om.load_sensor("folded-spherical"))
    second = {k: v for k, v in folded["secondary"].items() if k != "radius_mm"}
    return [
        *({**SPHERE, "mirror": mirror} for mirror in mirrors),
        *({**folded, "secondary": {**second, **mirror}} for mirror in mirrors),
        {**FIELD, "mirror": {"mapping_csv": path, "rim_radius_mm": 40.0}},
        {**FIELD, "mirror": {"mapping": "tabulated-mapping", "mapping_csv": path, "rim_radius_mm": 40.0}},
    ]


def answers(client: TestClient, tables: dict) -> list[str]:
    """What the server says to tables, by every way there is to hand them up."""
    wanted = tables if "field" in tables else {}
    on, distance = {"tables": SPHERE if wanted else tables}, {"object_distance_mm": None}
    questions = {
        "requirements": {**on, "wanted": wanted},
        "file": {**on, **distance, "kind": "sensor"},
        "picture": {**on, "width_px": 32, "samples": 1},
        "change": {**on, **distance, "what": "mirror", "to": "cone"},
    }
    said = [client.post(way, content=tomli_w.dumps(tables)).text for way in ("/api/sensors", "/api/bench/open")]
    asked = ("requirements",) if wanted else questions
    said += [client.post(f"/api/bench/{way}", json=questions[way]).text for way in asked]
    with client.websocket_connect("ws://127.0.0.1/api/bench/ask") as socket:
        plain = {"slot": 0, "number": 1, "follows": False, "section": False, "squares": False}
        socket.send_json({**plain, **on, **distance, "wanted": wanted or None})
        said.append(str(socket.receive()))
    search = {"what": "design", "merit": "blur", "family": "slope-spline", "terms": 1, "starts": 1}
    perform(Task(**search, **on, **distance, wanted=wanted or None), lambda news: said.append(news.sentence))
    return said


def test_what_may_name_a_file_is_tried():
    assert {"sampled", "tabulated-mapping"} <= set(FILES)
    assert set(MIRRORS) <= set(SECONDARIES)


@pytest.mark.parametrize("number", range(len(spies(""))))
def test_the_server_opens_no_file_that_an_upload_names(number, client, tmp_path):
    """It says the same of a file with columns, one that is none, one that is not there, a folder, and a pipe."""
    (tmp_path / "columns").write_text(f"{SECRET}\n" * 9)
    (tmp_path / "words").write_text("secret words")
    os.mkfifo(tmp_path / "pipe")  # whoever opens it waits for ever
    places = [str(tmp_path / name) for name in ("columns", "words", "absent", ".", "pipe")]
    said = [answers(client, spies(place)[number]) for place in places]
    same = [[text.replace(place, "PLACE") for text in texts] for place, texts in zip(places, said, strict=True)]
    assert same.count(same[0]) == len(same)
    assert "names another file" in "".join(same[0])
    assert not any("1.25" in text for text in same[0])


def test_the_command_line_still_follows_files_beside_its_own(tmp_path):
    """A profile in a file of its own, read from the folder of the sensor file."""
    profile = [f"{x},{x * x / 100}" for x in range(30)]
    (tmp_path / "profile.csv").write_text("\n".join(profile))
    (tmp_path / "s.toml").write_text(
        tomli_w.dumps({**SPHERE, "mirror": {"kind": "sampled", "profile_csv": "profile.csv"}})
    )
    assert om.load_sensor(tmp_path / "s.toml").mirror.x_mm[-1] == 29.0
