"""Batch processing of files: expansion of inputs, names of outputs, and parallel execution."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..base import interrupts
from ..base.arguments import file_name
from ..base.block_runner import run_blocks, workers_in_threads
from ..base.errors import MediaError, OmnimirrorError
from ..base.files import is_same_file
from ..base.native import usable_cores
from ..base.results import Columns, Result, table_of

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".hdr", ".exr")
"""Suffixes of the images in a folder that are processed."""
READABLE_IMAGE_SUFFIXES = (*IMAGE_SUFFIXES, ".gif", ".pgm", ".ppm", ".pnm", ".jp2")
"""Suffixes of readable images, including formats that are not written."""
WRITABLE_VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".ts")
VIDEO_SUFFIXES = (*WRITABLE_VIDEO_SUFFIXES, ".avi", ".mpg", ".mpeg")
"""Suffixes of videos."""


@dataclass(frozen=True)
class Job:
    """Task for one file: a block that runs in a thread."""

    name: str
    """Name for messages."""
    run: Callable[[], object]
    """Function that performs the task, or raises."""
    number: int = 0


@dataclass
class BatchResult(Result):
    """Results of several jobs; each job is in exactly one of the lists."""

    done: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    """Error messages by the names of the jobs."""
    not_started: list[str] = field(default_factory=list)
    """Jobs that were not started because of an interruption."""
    stopped_by: int = 0
    """Exit code of the interruption, as from :func:`omnimirror.base.interrupts.exit_code`."""

    def _table(self) -> Columns:
        groups = (("done", self.done), ("failed", self.failed), ("not started", self.not_started))
        return table_of(
            {"name": name, "status": status, "error": self.failed.get(name)}
            for status, names in groups
            for name in names
        )

    @property
    def exit_code(self) -> int:
        """Exit code: 0 if all jobs are done, 130 after Ctrl-C, 143 after SIGTERM, otherwise 1."""
        return self.stopped_by if self.not_started else 1 if self.failed else 0


def expand_inputs(
    patterns: Iterable[str | Path], suffixes: Sequence[str] = IMAGE_SUFFIXES
) -> list[Path]:
    """Expand names, folders and patterns such as ``*.jpg`` to files, each once, in order.

    A folder expands to its files with one of ``suffixes``.

    Raises
    ------
    MediaError
        If a name or pattern matches no file.
    """
    paths: dict[Path, None] = {}
    for pattern in patterns:
        path = file_name("source", pattern)
        if path.is_dir():
            matches = sorted(child for child in path.iterdir() if child.suffix.lower() in suffixes)
            if not matches:
                raise MediaError(
                    f"the folder {path} must contain files with a suffix of {', '.join(suffixes)}; got none"
                )
        elif path.exists() or not glob.has_magic(str(pattern)):
            matches = [path]
        else:
            matches = [
                match for match in map(Path, sorted(glob.glob(str(pattern)))) if match.is_file()
            ]
        if not matches or not all(match.exists() for match in matches):
            raise MediaError(f"source must be an existing file or match one; got {pattern}")
        paths.update(dict.fromkeys(matches))
    return list(paths)


def output_for(source: str | Path, folder: str | Path, suffix: str | None = None) -> Path:
    """Return the output path of a file in a folder: the same name, optionally with another suffix.

    >>> output_for("raw/a.jpg", "out", ".png").as_posix()
    'out/a.png'

    Raises
    ------
    MediaError
        If the output would be the file itself.
    """
    source = Path(source)
    output = Path(folder) / (source.name if suffix is None else source.stem + suffix)
    if is_same_file(output, source):
        raise MediaError(
            f"output must differ from the input; got {output} for both; specify another folder"
        )
    return output


def outputs_for(
    sources: Sequence[Path], folder: str | Path, suffix: str | None = None
) -> list[Path]:
    """Return the output paths of several files in a folder, all different.

    Raises
    ------
    MediaError
        If two outputs would have the same path, or an output would overwrite an input.
    """
    inputs_of: dict[Path, Path] = {}
    for source in sources:
        output = output_for(source, folder, suffix)
        if output in inputs_of:
            raise MediaError(
                f"outputs must be different files; got {output} for {inputs_of[output]} and {source}"
            )
        inputs_of[output] = source
    return list(inputs_of)


def run_parallel(
    jobs: Sequence[Job],
    workers: int | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> BatchResult:
    """Run jobs in parallel threads; the failure of one does not affect the others.

    Threads are sufficient, since reading, dewarping and writing release the global interpreter
    lock. After Ctrl-C or SIGTERM no further job is started, and running jobs are completed.

    Parameters
    ----------
    jobs
    workers
        Number of threads; by default the number of available cores.
    on_progress
        Called in the thread of the caller with the number of finished or failed jobs and the total.
    """
    results = BatchResult()
    count = max(1, min(workers or usable_cores(), len(jobs)))
    numbered = [replace(job, number=number) for number, job in enumerate(jobs)]
    outcomes: dict[int, BaseException | None] = {}
    with interrupts.deferred(), workers_in_threads(count) as threads:
        for outcome in run_blocks(numbered, threads):
            outcomes[outcome.block.number] = outcome.error
            if on_progress is not None:
                on_progress(len(outcomes), len(jobs))
        results.stopped_by = interrupts.exit_code()
    for job in numbered:
        if job.number not in outcomes:
            results.not_started.append(job.name)
        elif (error := outcomes[job.number]) is not None:
            results.failed[job.name] = error_message(error)
        else:
            results.done.append(job.name)
    return results


def error_message(error: BaseException) -> str:
    """Return an error message, also for unexpected errors, which must not discard other results."""
    if isinstance(error, OmnimirrorError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'the operating system'}: {error.strerror or error}"
    first = next(iter(str(error).splitlines()), "")
    return f"unexpected {type(error).__name__}: {first}"
