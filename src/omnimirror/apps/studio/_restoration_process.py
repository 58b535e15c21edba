"""Restoration process.

Run as ``python -m omnimirror.apps.studio._restoration_process``, it reads a line of JSON, a line
with the length of the image, and the image; it writes one progress message per line, and after an
empty line the restored image as PNG.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from pydantic import BaseModel

from ...base.errors import OmnimirrorError
from ...base.logs import forward_steps
from ...io.image_metadata import exposure_of
from ...optics.sensor_files import parse_sensor
from ._uploads import eight_bits, encoded, safe_name, uploaded
from .look_messages import ImageTaskStatus, RestoreRequest

STEPS = 4
"""Steps of a restoration: reading the image, and those of :class:`Restorer`, of similar duration."""


class RestorationTask(BaseModel):
    """Restoration request with its fitted sensor as file, and whether the orientation is ignored."""

    request: RestoreRequest
    sensor_file: str
    stored_orientation: bool = False


def restore_image(task: RestorationTask, data: bytes) -> tuple[bytes, str]:
    """Restore an uploaded image, and report the removed blur and the effect of EXIF data.

    Raises
    ------
    OmnimirrorError
        If the image is unreadable or belongs to another sensor.
    """
    from ...dewarp.restoration.deblurring import Restorer  # the server imports this module

    pixels, metadata = uploaded(
        data, safe_name(task.request.name), stored_orientation=task.stored_orientation
    )
    distance = task.request.object_distance_mm
    restorer = Restorer.of_exposure(
        parse_sensor(task.sensor_file),
        exposure_of(metadata.exif),
        np.inf if distance is None else distance,
    )
    restored, report = restorer.restore_and_describe(eight_bits(pixels))
    return encoded(restored, ".png"), report


def perform(
    task: RestorationTask, data: bytes, on_status: Callable[[ImageTaskStatus], None]
) -> bytes:
    """Restore an image, report the progress, and return the file; empty after an error."""
    step = 0

    def on_step(message: str) -> None:
        nonlocal step
        on_status(ImageTaskStatus(state="running", message=message, fraction=step / STEPS))
        step += 1

    on_step("Reading the image")
    try:
        with forward_steps(on_step, "omnimirror.dewarp.restoration"):
            png, report = restore_image(task, data)
    except OmnimirrorError as e:
        on_status(ImageTaskStatus(state="failed", message=str(e)))
    except MemoryError:
        message = f"{task.request.name} requires more memory than the server has"
        on_status(ImageTaskStatus(state="failed", message=message))
    else:
        on_status(ImageTaskStatus(state="done", message=report, fraction=1.0))
        return png
    return b""


def main() -> None:
    """Run the task of standard input."""
    requests = sys.stdin.buffer
    task = RestorationTask.model_validate_json(requests.readline())
    data = requests.read(int(requests.readline()))
    png = perform(task, data, lambda status: print(status.model_dump_json(), flush=True))
    print(flush=True)
    sys.stdout.buffer.write(png)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
