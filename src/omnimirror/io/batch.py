"""Many files at once: which they are, what they become, and the work done side by side."""

from __future__ import annotations

import glob
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from ..base.arguments import file_name
from ..base.errors import MediaError, OmnimirrorError
from ..base.files import is_same_file
from ..base.native import usable_cores
from . import interrupts

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".webp", ".bmp", ".hdr", ".exr")
"""What is taken from a folder, by suffix."""
READABLE = (*PICTURES, ".gif", ".pgm", ".ppm", ".pnm", ".jp2")
"""The same, where pictures are only looked at: of these, none is written."""
VIDEOS_WRITTEN = (".mp4", ".m4v", ".mov", ".mkv", ".webm", ".ts")
VIDEOS = (*VIDEOS_WRITTEN, ".avi", ".mpg", ".mpeg")
"""What is taken for a video, by suffix."""


class Job(NamedTuple):
    """One file's work."""

    name: str
    """For messages."""
    run: Callable[[], object]
    """Does it, or raises."""


@dataclass
class Results:
    """What became of many jobs; every one is in exactly one of the lists."""

    done: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)
    """What went wrong, in one sentence, by the name of the job."""
    not_begun: list[str] = field(default_factory=list)
    """What was left undone when someone asked to stop."""
    stopped_by: int = 0
    """The exit code of who asked, as :func:`omnimirror.io.interrupts.exit_code` gives it."""

    @property
    def exit_code(self) -> int:
        """0 if everything was done, 130 after Ctrl-C, 143 after SIGTERM, 1 otherwise."""
        return self.stopped_by if self.not_begun else 1 if self.failed else 0


def expand_inputs(patterns: Iterable[str | Path], suffixes: Sequence[str] = PICTURES) -> list[Path]:
    """The files that names, folders and patterns such as ``*.jpg`` stand for, each once, in order.

    A folder stands for the files in it with one of ``suffixes``.

    Raises
    ------
    MediaError
        For what stands for no file.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        path = file_name("source", pattern)
        if path.is_dir():
            matches = sorted(child for child in path.iterdir() if child.suffix.lower() in suffixes)
            if not matches:
                raise MediaError(f"there is no picture in the folder {path}; looked for {', '.join(suffixes)}")
        elif path.exists() or not glob.has_magic(str(pattern)):
            matches = [path]
        else:
            matches = [match for match in map(Path, sorted(glob.glob(str(pattern)))) if match.is_file()]
        if not matches or not all(match.exists() for match in matches):
            raise MediaError(f"there is no file {pattern}")
        found.update(dict.fromkeys(matches))
    return list(found)


def output_for(source: str | Path, folder: str | Path, suffix: str | None = None) -> Path:
    """What a file becomes in a folder: the same name, perhaps with another suffix.

    >>> output_for("raw/a.jpg", "out", ".png").as_posix()
    'out/a.png'

    Raises
    ------
    MediaError
        If that is the file itself.
    """
    source = Path(source)
    output = Path(folder) / (source.name if suffix is None else source.stem + suffix)
    if is_same_file(output, source):
        raise MediaError(f"{source} would be written over by its own result; give another folder")
    return output


def outputs_for(sources: Sequence[Path], folder: str | Path, suffix: str | None = None) -> list[Path]:
    """What files become in a folder, each under a name of its own.

    Raises
    ------
    MediaError
        If two of them would become the same file, or one would be written over by its own result.
    """
    taken: dict[Path, Path] = {}
    for source in sources:
        output = output_for(source, folder, suffix)
        if output in taken:
            raise MediaError(f"{taken[output]} and {source} would both become {output}")
        taken[output] = source
    return list(taken)


def run_parallel(
    jobs: Sequence[Job], workers: int | None = None, progress: Callable[[int, int], None] | None = None
) -> Results:
    """Do many jobs side by side in threads; one that fails leaves the others alone.

    Reading, straightening and writing pictures all let go of Python's lock, so that threads are enough.
    On Ctrl-C or SIGTERM no further job is begun, and those under way are finished.

    Parameters
    ----------
    jobs
    workers
        Threads; as many as this process may use cores where not given.
    progress
        Told how many are done or failed, and of how many, in the caller's thread.
    """
    results = Results()
    count = max(1, min(workers or usable_cores(), len(jobs) or 1))

    def begin(job: Job) -> bool:
        if interrupts.is_pending():
            return False
        job.run()
        return True

    with interrupts.deferred(), ThreadPoolExecutor(count, thread_name_prefix="batch") as pool:
        futures = {pool.submit(begin, job): job for job in jobs}
        waiting = set(futures)
        while waiting:
            done, waiting = wait(waiting, interrupts.POLL_S, FIRST_COMPLETED)
            if progress is not None and done:
                progress(len(jobs) - len(waiting), len(jobs))
        results.stopped_by = interrupts.exit_code()
    for future, job in futures.items():
        _sort(future, job, results)
    return results


def _sort(future: Future[bool], job: Job, results: Results) -> None:
    error = future.exception()
    if error is not None:
        results.failed[job.name] = _sentence(error)
    elif future.result():
        results.done.append(job.name)
    else:
        results.not_begun.append(job.name)


def _sentence(error: BaseException) -> str:
    """One sentence, also of an error that nobody foresaw: the others' results must not go down with it."""
    if isinstance(error, OmnimirrorError):
        return str(error)
    if isinstance(error, OSError):
        return f"{error.filename or 'the operating system'}: {error.strerror or error}"
    first = next(iter(str(error).splitlines()), "")
    return f"an unforeseen {type(error).__name__}: {first}"
