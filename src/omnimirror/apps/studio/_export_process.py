"""Export process: files of a design, individually or as an archive.

Run as ``python -m omnimirror.apps.studio._export_process``, it reads one task from standard input,
writes one progress message per line, and after an empty line the bytes of the file.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from zipfile import ZIP_DEFLATED, ZipFile

from ... import __version__
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.logs import combine_steps
from ...manufacturing.exporter import DRAWING_SUFFIXES, FORMATS, ExportedFile, export
from ...manufacturing.tolerancing.tolerance_file import (
    TolerancePlan,
    parse_tolerances,
    tolerance_template,
)
from ...manufacturing.tolerancing.tolerances import Tolerance, Tolerances
from ...manufacturing.workshop import Workshop
from ...optics.sensor import Sensor
from ...optics.sensor_files import format_sensor
from ._design_files import File, evaluation_table, requirement_file, sensor_report, stem_of
from ._design_sensors import sensor_from_tables
from ._export_form import DOCUMENTS, LABELS, SECTIONS, InvalidEntry, workshop_of
from .design_messages import ExportStatus, ExportTask, distance_of

TRIALS = 10_000
"""Number of trials of the tolerance report, the default of ``omnimirror tolerance``."""
MIN_FRACTION_STEP = 0.01  # smaller progress is not reported
OnProgress = Callable[[str, float], None]


@dataclass(frozen=True)
class ExportResult:
    """Exported file, and remarks on its content."""

    file: File
    remarks: tuple[str, ...]


def export_files(task: ExportTask, on_progress: OnProgress) -> ExportResult:
    """Export the requested files; several files and requested archives become a ZIP archive.

    Raises
    ------
    OmnimirrorError
        If the sensor, a format, or an entry of the workshop data is invalid, a package is missing,
        or the sensor has no such file.
    """
    for name in task.formats:
        if name not in FORMATS and name not in DOCUMENTS:
            raise InvalidParameter(
                f"formats must be from {', '.join((*FORMATS, *DOCUMENTS))}; got {name!r}"
            )
    sensor = sensor_from_tables(task.tables)
    tolerances = {} if task.tolerances is None else _sizes(task)
    workshop = workshop_of(task.workshop, tolerances)
    formats = [name for name in task.formats if name in FORMATS]
    documents = [name for name in DOCUMENTS if name in task.formats]
    count = len(formats) + len(documents)
    files: list[File] = []
    descriptions: list[str] = []
    remarks: list[str] = []
    if formats:
        share = len(formats) / count
        with TemporaryDirectory() as folder:
            report = _part_of_progress(on_progress, 0.0, share)
            with combine_steps(report, "omnimirror.manufacturing") as progress:
                written = export(
                    sensor, Path(folder), formats=formats, workshop=workshop, on_progress=progress
                )
            files += [File(f.path.name, "", f.path.read_bytes()) for f in written]
        descriptions += [_description(f) for f in written]
        remarks += _remarks(sensor, workshop, written)
    for number, name in enumerate(documents, len(formats)):
        report = _part_of_progress(on_progress, number / count, 1 / count)
        report(f"Writing the {DOCUMENTS[name].partition(' (')[0].lower()}", 0.0)
        files.append(_document(name, sensor, task, report))
        descriptions.append(DOCUMENTS[name].partition(" (")[0].lower())
    if len(files) == 1 and not task.is_archive:
        return ExportResult(files[0], tuple(remarks))
    readme = _readme(sensor, files, descriptions, remarks)
    return ExportResult(_archive(stem_of(sensor), [readme, *files]), tuple(remarks))


def _part_of_progress(on_progress: OnProgress, start: float, share: float) -> OnProgress:
    return lambda message, fraction: on_progress(message, start + share * fraction)


def _sizes(task: ExportTask) -> dict[str, float]:
    assert task.tolerances is not None
    return {error.name: error.tolerance for error in task.tolerances.errors}


def _document(name: str, sensor: Sensor, task: ExportTask, on_progress: OnProgress) -> File:
    if name == "tolerances":
        return _tolerance_report(sensor, task, on_progress)
    if name == "report":
        return sensor_report(sensor, on_progress)
    if name == "evaluation":
        return evaluation_table(sensor, distance_of(task.object_distance_mm))
    if name == "sensor":
        return File(f"{stem_of(sensor)}.toml", "", format_sensor(sensor).encode())
    if task.requirements is None:
        raise InvalidParameter("the design has no requirements; add one or deselect the file")
    text = requirement_file(task.requirements, sensor)
    return File(f"{stem_of(sensor)}-requirements.toml", "", text.encode())


def _tolerance_report(sensor: Sensor, task: ExportTask, on_progress: OnProgress) -> File:
    from ...manufacturing.tolerancing.tolerance_analysis import tolerance
    from ..reports.tolerances import tolerances_html

    report = tolerance(
        sensor,
        tolerance_plan(sensor, task),
        trials=TRIALS,
        on_progress=lambda done, trials: on_progress("Simulating sensors", done / trials),
    )
    return File(f"{stem_of(sensor)}-tolerances.html", "", tolerances_html(report).encode())


def tolerance_plan(sensor: Sensor, task: ExportTask) -> TolerancePlan:
    """Return the tolerances of a task, or those of ``omnimirror tolerance init``."""
    if task.tolerances is None:
        return parse_tolerances(tolerance_template(sensor), sensor)
    errors = {name: Tolerance(size) for name, size in _sizes(task).items()}
    requested = task.tolerances
    return TolerancePlan(
        Tolerances(sensor, errors), {requested.merit: requested.limit}, refocus=requested.refocus
    )


def _description(file: ExportedFile) -> str:
    if file.deviation_um is None:
        return file.description
    deviation = f"deviation {file.deviation_um:.2g} um" if file.deviation_um else "exact"
    return f"{file.description}; {deviation}"


def _remarks(sensor: Sensor, workshop: Workshop, written: list[ExportedFile]) -> list[str]:
    """Return missing entries and conflicts of drawings, and inaccurate lens files."""
    from ...manufacturing.tolerancing.drawing_conflicts import tolerance_conflicts

    remarks = []
    if any(file.path.suffix.lower() in DRAWING_SUFFIXES for file in written):
        parts = ("mirror",) if sensor.secondary is None else ("mirror", "secondary")
        if missing := workshop.missing(parts):
            labels = ", ".join(_label(name) for name in missing)
            remarks.append(f"Missing entries of the drawing: {labels}.")
        remarks += [
            f"Inconsistent tolerances: {text}." for text in tolerance_conflicts(sensor, workshop)
        ]
    remarks += [
        f"{file.path.name} is not accurate: its rays deviate by up to {file.ray_deg:.2g} deg from "
        "those of the mirror; use the OpticStudio grid sag."
        for file in written
        if not file.follows
    ]
    return remarks


def _label(name: str) -> str:
    """Return the label of an entry such as ``mirror.coating``."""
    section, _, entry = name.rpartition(".")
    text = LABELS.get(entry, entry.replace("_", " "))
    text = text[0].lower() + text[1:]
    return f"{SECTIONS[section].lower()}: {text}" if section == "secondary" else text


def _readme(sensor: Sensor, files: list[File], descriptions: list[str], remarks: list[str]) -> File:
    width = max(len(file.name) for file in files)
    lines = [
        sensor.name,
        "",
        f"Exported by omnimirror {__version__}.",
        "",
        "Files",
        "",
        *(f"  {file.name:{width}}  {text}" for file, text in zip(files, descriptions, strict=True)),
        "",
        "Deviation: maximum distance of the surface in the file from the mirror.",
        *(["", "Remarks", "", *(f"  {remark}" for remark in remarks)] if remarks else []),
    ]
    return File("README.txt", "text/plain", ("\n".join(lines) + "\n").encode())


def _archive(stem: str, files: list[File]) -> File:
    buffer = BytesIO()
    with ZipFile(buffer, "w", ZIP_DEFLATED) as archive:
        for file in files:
            archive.writestr(f"{stem}/{file.name}", file.data)
    return File(f"{stem}.zip", "application/zip", buffer.getvalue())


def perform(task: ExportTask, on_status: Callable[[ExportStatus], None]) -> bytes:
    """Run a task, report its progress, and return the file; empty after an error."""
    last = -1.0

    def on_progress(message: str, fraction: float) -> None:
        nonlocal last
        if fraction == 0.0 or fraction - last >= MIN_FRACTION_STEP:
            last = fraction
            on_status(_status("running", message, fraction))

    try:
        result = export_files(task, on_progress)
    except OmnimirrorError as e:
        entry = e.entry if isinstance(e, InvalidEntry) else None
        on_status(_status("failed", str(e), entry=entry))
        return b""
    message = f"{result.file.name} is complete."
    on_status(_status("done", message, 1.0, name=result.file.name, remarks=result.remarks))
    return result.file.data


def _status(
    state: str,
    message: str,
    fraction: float | None = None,
    *,
    entry: tuple[str, str] | None = None,
    name: str | None = None,
    remarks: tuple[str, ...] = (),
) -> ExportStatus:
    return ExportStatus(
        state=state,  # type: ignore[arg-type]  # pydantic checks the state
        message=message,
        fraction=fraction,
        entry=entry,
        name=name,
        remarks=remarks,
    )


def main() -> None:
    """Run the task from standard input."""
    task = ExportTask.model_validate_json(sys.stdin.buffer.readline())
    data = perform(task, lambda status: print(status.model_dump_json(), flush=True))
    print(flush=True)
    sys.stdout.buffer.write(data)
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    main()
