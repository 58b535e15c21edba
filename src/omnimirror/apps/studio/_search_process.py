"""Search process: mirror optimisation and design from requirements.

Run as ``python -m omnimirror.apps.studio._search_process``, it reads one task from standard input and
writes one progress message per line.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.logs import forward_steps
from ...design.designer import SearchOptions, design_sensor
from ...design.optimiser import Progress
from ...design.requirement_files import requirements_like
from ...design.requirements import Requirements
from ...optics.housing import Housing
from ...optics.image_sensor import Imager
from ...optics.sensor import Sensor
from ._design_requirements import relaxation_options, requirements_for
from ._design_sensors import (
    aligned_sensor,
    sensor_from_tables,
    tables_from_sensor,
    why_not_optimised,
)
from .design_messages import RelaxationOption, SearchTask, TaskStatus, distance_of

OnProgress = Callable[[TaskStatus], None]


def perform(task: SearchTask, on_progress: OnProgress) -> None:
    """Run a task and report its progress; the last message contains the sensor or an error."""
    try:
        sensor = sensor_from_tables(task.tables)
        (_optimise if task.kind == "optimise" else _design)(task, sensor, on_progress)
    except OmnimirrorError as e:
        on_progress(_status("failed", str(e)))


def optimisable(sensor: Sensor, task: SearchTask) -> Requirements:
    """Derive requirements from the sensor for the object distance, merit and shape of a task.

    They cover its whole field, with an imager of the size of the rim image, because the task
    optimises the mirror only.

    Raises
    ------
    InvalidParameter
        If the sensor has two mirrors or a misaligned mirror.
    """
    if (reason := why_not_optimised(sensor)) is not None:
        raise InvalidParameter(reason)
    bare = replace(sensor, housing=Housing())
    like = requirements_like(bare, optimise=task.merit, shape=f"{task.shape}:{task.terms}")
    distance = distance_of(task.object_distance_mm)
    requested = like.changed(omega_min_deg=0.0, object_distance_mm=distance)
    limits = (
        requirements_for(task.requirements, sensor).limits
        if task.requirements and task.keeps_limits
        else ()
    )
    name = f"optimised-{task.merit.replace('_', '-')}"
    return replace(requested, imager=_filled(sensor), limits=limits, name=name)


def _filled(sensor: Sensor) -> Imager:
    """Return an imager filled by the rim image; it determines the magnification of a telecentric
    lens."""
    radius = sensor.rim_radius_px
    side = int(np.ceil(2 * radius))
    return Imager(side, side, sensor.imager.pixel_pitch_um, (radius - 0.5, radius - 0.5))


def _optimise(task: SearchTask, sensor: Sensor, on_progress: OnProgress) -> None:
    steps = 0

    def on_run(progress: Progress) -> None:
        nonlocal steps
        steps += 1
        description = f"start {progress.run + 1} of {progress.runs}, step {steps}"
        on_progress(_status("running", description, progress.run / progress.runs, progress.value))

    solution = design_sensor(
        optimisable(sensor, task), search=SearchOptions(starts=task.starts, on_iteration=on_run)
    )
    if solution.optimum is None:
        missed = ", ".join(solution.verdict.missed)
        raise InvalidParameter(
            f"{solution.notes[0]}; missed: {missed}" if missed else solution.notes[0]
        )
    optimum = replace(solution.sensor, imager=sensor.imager, housing=sensor.housing)
    on_progress(_status("done", optimum.notes, 1.0, solution.optimum.value, optimum))


def _design(task: SearchTask, sensor: Sensor, on_progress: OnProgress) -> None:
    if task.requirements is None:
        raise InvalidParameter("requirements must be given for a design from requirements")
    if "mirror" not in task.requirements:
        raise InvalidParameter(
            "the requirements must specify a mapping or a family for a design from "
            "requirements; add [mirror] to the requirement file"
        )
    requested = requirements_for(task.requirements, aligned_sensor(sensor))
    with forward_steps(lambda step: on_progress(_status("running", step)), "omnimirror.design"):
        solution = design_sensor(
            requested,
            on_design=lambda design: on_progress(
                _status(
                    "running", "relaxations", sensor=design.sensor if not design.is_met else None
                )
            ),
        )
    missed = [row.label for row in solution.rows if not row.is_met]
    message = (
        f"Requirements not met: {', '.join(missed)}." if missed else "All requirements are met."
    )
    relaxations = relaxation_options(task.requirements, requested, solution.conflict)
    on_progress(_status("done", message, 1.0, None, solution.sensor, relaxations))


def _status(
    state: str,
    message: str,
    fraction: float | None = None,
    value: float | None = None,
    sensor: Sensor | None = None,
    relaxations: tuple[RelaxationOption, ...] = (),
) -> TaskStatus:
    return TaskStatus(
        state=state,  # type: ignore[arg-type]  # pydantic checks the state
        message=message,
        fraction=fraction,
        value=value,
        sensor=tables_from_sensor(sensor) if sensor is not None else None,
        relaxations=relaxations,
    )


def main() -> None:
    """Run the task from standard input."""
    task = SearchTask.model_validate_json(sys.stdin.buffer.readline())
    perform(task, lambda news: print(news.model_dump_json(), flush=True))


if __name__ == "__main__":
    main()
