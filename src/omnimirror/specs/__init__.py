"""The files that say what a sensor or a camera is: TOML to a checked model to a Sensor or a camera model, and back."""

from .camera_file import AnyCamera, format_camera, is_ocam_text, load_camera, parse_camera, save_camera
from .sensor_file import (
    HOUSING_PARTS,
    bundled_sensors,
    format_sensor,
    housing_of,
    housing_tables,
    load_sensor,
    parse_sensor,
    save_sensor,
    sensor_of,
    tables_of,
)
from .tables import (
    EntryError,
    NoFile,
    Places,
    StandTable,
    Table,
    check_entries,
    did_you_mean,
    table_model,
    validated,
)

__all__ = [
    "HOUSING_PARTS",
    "AnyCamera",
    "EntryError",
    "NoFile",
    "Places",
    "StandTable",
    "Table",
    "bundled_sensors",
    "check_entries",
    "did_you_mean",
    "format_camera",
    "format_sensor",
    "housing_of",
    "housing_tables",
    "is_ocam_text",
    "load_camera",
    "load_sensor",
    "parse_camera",
    "parse_sensor",
    "save_camera",
    "save_sensor",
    "sensor_of",
    "table_model",
    "tables_of",
    "validated",
]
