"""COLMAP's database: cameras, the rig, and which pictures were taken together; COLMAP adds features and matches.

Tables as COLMAP 4 makes them (``src/colmap/scene/database_sqlite.cc``); those that it does not find it adds.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ...files import replacing
from .rig import RigView, sensor_from_rig

MODELS = {"PINHOLE": 1, "EQUIRECTANGULAR": 17}
CAMERA = 0
"""A sensor of this kind."""
SCHEMA = """
CREATE TABLE cameras (camera_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, model INTEGER NOT NULL,
    width INTEGER NOT NULL, height INTEGER NOT NULL, params BLOB, prior_focal_length INTEGER NOT NULL);
CREATE TABLE rigs (rig_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, ref_sensor_id INTEGER NOT NULL,
    ref_sensor_type INTEGER NOT NULL);
CREATE UNIQUE INDEX rig_ref_sensor_assignment ON rigs(ref_sensor_id, ref_sensor_type);
CREATE TABLE rig_sensors (rig_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL, sensor_type INTEGER NOT NULL,
    sensor_from_rig BLOB, FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX rig_sensor_assignment ON rig_sensors(sensor_id, sensor_type);
CREATE TABLE frames (frame_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, rig_id INTEGER NOT NULL,
    FOREIGN KEY(rig_id) REFERENCES rigs(rig_id) ON DELETE CASCADE);
CREATE TABLE frame_data (frame_id INTEGER NOT NULL, data_id INTEGER NOT NULL, sensor_id INTEGER NOT NULL,
    sensor_type INTEGER NOT NULL, FOREIGN KEY(frame_id) REFERENCES frames(frame_id) ON DELETE CASCADE);
CREATE UNIQUE INDEX frame_sensor_assignment ON frame_data(data_id, sensor_type);
CREATE TABLE images (image_id INTEGER PRIMARY KEY AUTOINCREMENT NOT NULL, name TEXT NOT NULL UNIQUE,
    camera_id INTEGER NOT NULL, CONSTRAINT image_id_check CHECK(image_id >= 0 and image_id < 2147483647),
    FOREIGN KEY(camera_id) REFERENCES cameras(camera_id));
CREATE UNIQUE INDEX index_name ON images(name);
PRAGMA user_version = 4020100;
"""


def write_database(path: Path, rig: Sequence[RigView], names: Sequence[str]) -> None:
    """Write the database of pictures, each under a name in a folder for each view."""
    with replacing(path) as temporary, closing(sqlite3.connect(temporary)) as base, base:
        base.executescript(SCHEMA)
        for number, view in enumerate(rig, start=1):
            row = number, MODELS[view.model], *view.screen.size, np.array(view.parameters).tobytes()
            base.execute("INSERT INTO cameras VALUES (?, ?, ?, ?, ?, 1)", row)
        base.execute("INSERT INTO rigs VALUES (1, 1, ?)", (CAMERA,))
        for number, view in enumerate(rig[1:], start=2):
            turn, shift = sensor_from_rig(view, rig[0])
            pose = np.concatenate([quaternion(turn), shift]).tobytes()
            base.execute("INSERT INTO rig_sensors VALUES (1, ?, ?, ?)", (number, CAMERA, pose))
        for frame, name in enumerate(names, start=1):
            base.execute("INSERT INTO frames VALUES (?, 1)", (frame,))
            for number, view in enumerate(rig, start=1):
                image = (frame - 1) * len(rig) + number
                base.execute("INSERT INTO images VALUES (?, ?, ?)", (image, f"{view.name}/{name}", number))
                base.execute("INSERT INTO frame_data VALUES (?, ?, ?, ?)", (frame, image, number, CAMERA))


def quaternion(turn: np.ndarray) -> np.ndarray:
    """(w, x, y, z) of a rotation (3, 3)."""
    w_last: np.ndarray = Rotation.from_matrix(turn).as_quat()
    return np.roll(w_last, 1)
