"""Plain values of sensor files against the pydantic models, and imports of the first sensor."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

import omnimirror as om
from omnimirror.base.table_models import table_model
from omnimirror.base.toml_validation import plain_values
from omnimirror.optics.image_sensor import Imager, ImagerPose
from omnimirror.optics.lenses import LENSES
from omnimirror.optics.mirrors import MIRRORS
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import SENSOR_FOLDER
from omnimirror.optics.thermal import Thermal

PARTS = [*MIRRORS.values(), *LENSES.values(), Imager, ImagerPose, MirrorPose, Thermal]
VALUES = st.one_of(
    st.floats(),
    st.floats(0.01, 100.0),
    st.integers(-5, 2000),
    st.booleans(),
    st.text(max_size=3),
    st.none(),
    st.lists(st.one_of(st.floats(), st.integers(-5, 5), st.text(max_size=2)), max_size=4),
    st.sampled_from(["right", "left", "up", "x"]),
)


def as_tuples(values: dict) -> dict:
    return {k: tuple(v) if isinstance(v, list) else v for k, v in values.items()}


@pytest.mark.parametrize("cls", PARTS, ids=lambda cls: cls.__name__)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_plain_values_equal_those_of_model(cls, data):
    names = [*cls.PARAMETERS, "unknown"]
    words = [word for p in cls.PARAMETERS.values() for word in p.choices] or ["x"]
    table = data.draw(
        st.dictionaries(
            st.sampled_from(names), VALUES | st.sampled_from(words), max_size=len(names)
        )
    )
    values = plain_values(cls, table)
    try:
        expected = as_tuples(table_model(cls).model_validate(table).model_dump())
    except ValidationError:
        assert values is None
    else:
        assert values is None or values == expected
        assert values is None or [*map(type, values.values())] == [*map(type, expected.values())]


def test_bundled_parts_are_plain():
    count = 0
    for name in om.bundled_sensors():
        data = tomllib.loads((SENSOR_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))
        for section, registry in (("mirror", MIRRORS), ("lens", LENSES)):
            table = {k: v for k, v in data[section].items() if k != "kind"}
            cls = registry[data[section]["kind"]]
            expected = as_tuples(table_model(cls).model_validate(table).model_dump())
            assert plain_values(cls, table) == expected
            count += 1
    assert count >= 16


@pytest.mark.parametrize(
    "program",
    [
        "import omnimirror as om; [om.load_sensor(name).field_deg for name in om.bundled_sensors()]",
        "from omnimirror.apps.cli import main; main(['sensors'])",
    ],
    ids=["sensors", "command"],
)
def test_bundled_sensors_do_not_import_large_packages(program):
    """Loading a sensor takes less than 0.3 s without the import of these packages."""
    packages = ("scipy", "pydantic", "matplotlib", "cv2", "PIL")
    check = f"import atexit, sys; atexit.register(lambda: print('\\n', [p for p in {packages} if p in sys.modules]))"
    run = subprocess.run(
        [sys.executable, "-c", f"{check}\n{program}"], capture_output=True, text=True, check=True
    )
    assert run.stdout.splitlines()[-1].strip() == "[]"
