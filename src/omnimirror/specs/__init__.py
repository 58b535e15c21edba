"""The files that say what a sensor or a camera is: TOML to a checked model to a Sensor or a camera model, and back."""

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
    "EntryError",
    "NoFile",
    "Places",
    "StandTable",
    "Table",
    "bundled_sensors",
    "check_entries",
    "did_you_mean",
    "format_sensor",
    "housing_of",
    "housing_tables",
    "load_sensor",
    "parse_sensor",
    "save_sensor",
    "sensor_of",
    "table_model",
    "tables_of",
    "validated",
]
