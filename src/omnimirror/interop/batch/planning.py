"""Plan of a batch job: sensors, names and blocks of all outputs, compared with the manifest."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

from ... import __version__
from ...base.block_runner import WHOLE, part_of
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.results import Columns, Result, table_of
from .arrays import ARRAYS, prepare_group
from .blocks import BatchBlock, PlannedItem, PlannedOutput, processor_of, training_samples
from .inputs import BatchInput, list_inputs, stem_of
from .job import AssignedSensor, BatchJob, digest_of
from .manifest import DONE, FAILED, PLAN_NAME, BatchManifest, ManifestRow

NAME_DIGITS = 10
"""Digits of a digest in a name."""


@dataclass(frozen=True, eq=False)
class BatchPlan(Result):
    """Plan of a job.

    Attributes
    ----------
    job
        Job.
    items
        Inputs with sensor and outputs, in the order of the inputs.
    unassigned
        Inputs without an applicable sensor.
    manifest
        Manifest of existing outputs.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> from omnimirror.interop.batch.job import parse_job
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/raw/a.png", np.zeros((1024, 1024), np.uint8))
    ...     job = parse_job(
    ...         "[inputs]\\nfiles = ['raw']\\n[[sensor]]\\nfile = 'paper-spherical'\\n"
    ...         "[view.north]\\n[output]\\nurl = 'out'",
    ...         folder=om.base.files.Path(folder),
    ...     )
    ...     plan_of(job).pending
    1
    """

    job: BatchJob
    items: Sequence[PlannedItem]
    unassigned: Sequence[BatchInput]
    manifest: BatchManifest = field(repr=False)

    @property
    def total(self) -> int:
        """Number of outputs, one per input and view."""
        return sum(len(item.outputs) for item in self.items) + len(self.unassigned)

    @cached_property
    def counts(self) -> Counter[str]:
        """Number of outputs by status; pending ones under the empty string."""
        return Counter(
            self.manifest.status(output.key, output.name)
            for item in self.items
            for output in item.outputs
        )

    @property
    def pending(self) -> int:
        """Number of outputs that a run computes."""
        return self.total - self.counts[DONE] - self.counts[FAILED] - len(self.unassigned)

    def stale_rows(self) -> list[ManifestRow]:
        """Return the rows of outputs that a changed sensor, view, input or version replaces."""
        current = {(output.key, output.name) for item in self.items for output in item.outputs}
        replaced = {
            (item.source.name, output.view) for item in self.items for output in item.outputs
        }
        return [
            row
            for row in self.manifest.rows.values()
            if row.status == DONE
            and (row.key, row.output) not in current
            and (row.input, row.view) in replaced
        ]

    def blocks(
        self, part: tuple[int, int] = WHOLE, retry_failed: bool = False
    ) -> tuple[list[BatchBlock], int, int]:
        """Return the blocks with pending outputs of a part, and its number of outputs in total
        and of completed ones.
        """
        groups = self._groups()
        if self.job.output.kind == "files":
            # the division depends on all items, independent of the state of the manifest
            units = [[item] for item in self.items]
            own = [unit[0] for unit in part_of(units, part)]
            total = sum(len(item.outputs) for item in own)
            pending = [each for item in own if (each := self._pending(item, retry_failed))]
            count = sum(len(item.outputs) for item in pending)
            return list(self._file_blocks(pending)), total, total - count
        selected = part_of(groups, part)
        blocks, total, done = [], 0, 0
        for number, (name, start, items) in enumerate(selected):
            size = sum(len(item.outputs) for item in items)
            total += size
            if any(self._pending(item, retry_failed) for item in items):
                blocks.append(self._block(number, name, items, start))
            else:
                done += size
        return blocks, total, done

    def _pending(self, item: PlannedItem, retry_failed: bool) -> PlannedItem | None:
        complete = (DONE,) if retry_failed else (DONE, FAILED)
        outputs = tuple(
            o for o in item.outputs if self.manifest.status(o.key, o.name) not in complete
        )
        return replace(item, outputs=outputs) if outputs else None

    def _file_blocks(self, items: Sequence[PlannedItem]) -> Iterator[BatchBlock]:
        """Yield blocks of files, each with one sensor, so that workers keep few maps."""
        ordered = sorted(items, key=lambda item: item.sensor_digest)
        size, number = self.job.execution.per_block, 0
        for group in _runs(ordered):
            for first in range(0, len(group), size):
                part = group[first : first + size]
                yield self._block(number, part[0].outputs[0].name, part, 0)
                number += 1

    def _groups(self) -> list[tuple[str, int, list[PlannedItem]]]:
        """Return name, first index and items of each shard, chunk or video."""
        groups: dict[tuple[str, int], list[PlannedItem]] = {}
        for item in self.items:
            output = item.outputs[0].name
            groups.setdefault((output, 0), []).append(item)
        if self.job.output.kind != "zarr":
            return [(name, 0, items) for (name, _), items in groups.items()]
        chunks: dict[tuple[str, int], list[PlannedItem]] = {}
        length = self.job.output.chunk
        for item in self.items:
            group = item.outputs[0].name.rpartition("/")[0]
            chunks.setdefault((group, int(item.label) // length * length), []).append(item)
        return [(f"{group}/{start}", start, items) for (group, start), items in chunks.items()]

    def _block(
        self, number: int, name: str, items: Sequence[PlannedItem], start: int
    ) -> BatchBlock:
        used = {item.sensor_digest for item in items}
        sensors = {each.digest: each.text for each in self.job.sensors if each.digest in used}
        return BatchBlock(number, name, replace(self.job, sensors=()), sensors, tuple(items), start)

    def write(self) -> None:
        """Store the keys of the outputs for ``batch status``, which lists no inputs."""
        keys = [output.key for item in self.items for output in item.outputs]
        keys += [unassigned_key(each) for each in self.unassigned]
        record = {"total": self.total, "keys": sorted(map(short_key, keys))}
        self.manifest.store.write(PLAN_NAME, json.dumps(record).encode())

    def prepare(self) -> None:
        """Create the arrays of Zarr outputs, which blocks write to."""
        if self.job.output.kind == "zarr":
            for name, (count, sizes) in array_groups(self).items():
                prepare_group(self.job, name, count, sizes)

    def sensor_counts(self) -> list[dict[str, Any]]:
        """Return the number of inputs by sensor and camera, as rows of a table."""
        groups = Counter((item.sensor, item.source.camera) for item in self.items)
        return [
            {"sensor": sensor, "camera": camera, "inputs": count}
            for (sensor, camera), count in sorted(groups.items())
        ]

    def _table(self) -> Columns:
        return table_of(self.sensor_counts())


def unassigned_key(source: BatchInput) -> str:
    """Return the key in the manifest of an input without an applicable sensor."""
    return f"unassigned {source.name}"


def short_key(key: str) -> str:
    """Return a key in 12 hexadecimal digits, as stored in the plan.

    >>> len(short_key("unassigned a.png"))
    12
    """
    return hashlib.blake2b(key.encode(), digest_size=6).hexdigest()


def plan_of(job: BatchJob) -> BatchPlan:
    """List the inputs of a job and compare its outputs with the manifest.

    Raises
    ------
    OmnimirrorError
        If inputs cannot be listed, two outputs have the same name, or the manifest is damaged.
    """
    manifest = BatchManifest(job.store())
    outputs = {
        manifest.store.url(row.output) for row in manifest.rows.values() if row.status == DONE
    }
    inputs = _frames(job) if job.render is not None else list_inputs(job)
    assigned: list[tuple[BatchInput, AssignedSensor]] = []
    unassigned: list[BatchInput] = []
    for each in inputs:
        if not each.member and each.url in outputs:  # in the folder of the inputs
            continue
        sensor = job.sensor_of(each.camera, each.time)
        if sensor is None:
            unassigned.append(each)
        else:
            assigned.append((each, sensor))
    return BatchPlan(job, _named(job, assigned), unassigned, manifest)


def _frames(job: BatchJob) -> list[BatchInput]:
    """Return the frames of a rendering job."""
    assert job.render is not None
    sequence = training_samples(job, job.sensors[0].text).sequence
    stamp = digest_of([sequence.path.tracks, sequence.path.interpolation, list(sequence.times_s)])
    return [
        BatchInput(job.render.scene, f"{number:06d}", stamp=stamp)
        for number in range(len(sequence.times_s))
    ]


def _named(
    job: BatchJob, assigned: Sequence[tuple[BatchInput, AssignedSensor]]
) -> list[PlannedItem]:
    """Return the items with keys and names of their outputs."""
    digests, identity = job.view_digests, job.inputs.identity
    sensor_digests = {id(sensor): sensor.digest for sensor in job.sensors}
    keyed = []
    for source, sensor in assigned:
        own = sensor_digests[id(sensor)]
        base = source.identity(identity)
        keys = {
            view: digest_of([base, own, digest, __version__]) for view, digest in digests.items()
        }
        keyed.append(_Keyed(source, sensor.name, own, keys))
    if job.output.kind == "files" or job.inputs.videos:
        items = _file_items(job, keyed)
    elif job.output.kind == "zarr":
        items = _array_items(job, keyed)
    else:
        items = _shard_items(job, keyed)
    return items


@dataclass(frozen=True, slots=True)
class _Keyed:
    source: BatchInput
    sensor: str
    sensor_digest: str
    keys: Mapping[str, str]

    def item(self, job: BatchJob, names: Mapping[str, str], label: str) -> PlannedItem:
        digests = job.view_digests
        outputs = tuple(
            PlannedOutput(view, digests[view], key, names[view]) for view, key in self.keys.items()
        )
        return PlannedItem(self.source, self.sensor, self.sensor_digest, outputs, label)


def _file_items(job: BatchJob, keyed: Sequence[_Keyed]) -> list[PlannedItem]:
    """Name a file per input and view after the template."""
    output = job.output
    items: list[PlannedItem] = []
    owners: dict[str, tuple[str, str]] = {}
    for each in keyed:
        folder, stem = stem_of(each.source)
        moment = each.source.time
        values = {
            "folder": folder,
            "stem": stem,
            "camera": folder_name(each.source.camera),
            "sensor": each.sensor,
            "time": ""
            if moment is None
            else f"{datetime.fromtimestamp(moment, UTC):%Y%m%dT%H%M%S}",
        }
        names = {}
        for view, key in each.keys.items():
            stem_name = output.name.format(**values, view=view, digest=key[:NAME_DIGITS])
            names[view] = stem_name + output.format
            if not stem_name.rpartition("/")[2]:
                raise InvalidParameter(
                    f"output.name must not be empty; got {names[view]!r} for {each.source.name}; "
                    "add {digest} to output.name"
                )
            owner = owners.setdefault(names[view], (each.source.name, view))
            if owner != (each.source.name, view):
                missing = "digest" if owner[0] != each.source.name else "view"
                raise InvalidParameter(
                    f"outputs must have different names; got {names[view]} for view {owner[1]} of "
                    f"{owner[0]} and view {view} of {each.source.name}; add {{{missing}}} to output.name"
                )
        items.append(each.item(job, names, ""))
    return items


def _shard_items(job: BatchJob, keyed: Sequence[_Keyed]) -> list[PlannedItem]:
    """Name shards or videos of consecutive inputs with one sensor after all keys in them."""
    size, items = job.output.per_shard, []
    suffix = ".tar" if job.output.kind == "webdataset" else job.output.format
    by_sensor: dict[tuple[str, str], list[_Keyed]] = {}
    for each in keyed:
        by_sensor.setdefault((each.sensor, each.sensor_digest), []).append(each)
    for (sensor, _), members in by_sensor.items():
        for number, first in enumerate(range(0, len(members), size)):
            group = members[first : first + size]
            digest = digest_of([list(each.keys.values()) for each in group])[:NAME_DIGITS]
            stem = f"{sensor}-{number:06d}"
            labels = [_label(each.source) for each in group]
            counts = Counter(labels)
            for each, label in zip(group, labels, strict=True):
                if suffix == ".tar":
                    names = dict.fromkeys(each.keys, f"{stem}-{digest}{suffix}")
                else:
                    names = {view: f"{stem}-{view}-{digest}{suffix}" for view in each.keys}
                if counts[label] > 1:  # a.jpg and a.png would be one sample
                    label += f"-{next(iter(each.keys.values()))[:NAME_DIGITS]}"
                items.append(each.item(job, names, label))
    return items


def _label(source: BatchInput) -> str:
    """Return the key of a sample in a shard, which ends at its first point."""
    folder, name = stem_of(source)
    return f"{folder}{name}".replace(".", "_")


def folder_name(camera: str) -> str:
    """Return a camera id as the name of a folder.

    >>> folder_name("roof/2"), folder_name("..")
    ('roof_2', '__')
    """
    name = camera.replace("/", "_")
    return "_" * len(name) if name in (".", "..") else name


def _array_items(job: BatchJob, keyed: Sequence[_Keyed]) -> list[PlannedItem]:
    """Return the items with an index in the arrays of their camera, in the order of time."""
    cameras = {each.source.camera for each in keyed}
    counts: Counter[str] = Counter()
    items = []
    unknown = float("inf")
    ordered = sorted(keyed, key=lambda e: unknown if e.source.time is None else e.source.time)
    for each in ordered:
        camera = each.source.camera
        group = (
            f"{ARRAYS}/{folder_name(camera) or 'unknown'}/" if len(cameras) > 1 else f"{ARRAYS}/"
        )
        index = counts[camera]
        counts[camera] += 1
        names = {view: f"{group}{view}[{index}]" for view in each.keys}
        items.append(each.item(job, names, str(index)))
    return items


def array_groups(plan: BatchPlan) -> dict[str, tuple[int, dict[str, tuple[int, int]]]]:
    """Return the number of images and the sizes of the views of each group of arrays.

    Raises
    ------
    InvalidParameter
        If the views of a camera have different sizes for its sensors.
    """
    texts = {each.digest: each.text for each in plan.job.sensors}
    groups: dict[str, tuple[int, dict[str, tuple[int, int]]]] = {}
    sizes_of: dict[str, dict[str, tuple[int, int]]] = {}
    for item in plan.items:
        if item.sensor_digest not in sizes_of:
            processor = processor_of(plan.job, texts[item.sensor_digest])
            sizes_of[item.sensor_digest] = {
                o.view: processor.view_size(o.view) for o in item.outputs
            }
        name = item.outputs[0].name.rpartition("/")[0]
        count, sizes = groups.get(name, (0, sizes_of[item.sensor_digest]))
        if sizes != sizes_of[item.sensor_digest]:
            raise InvalidParameter(
                f"the views of {item.source.camera or 'all inputs'} must have one size for all "
                "sensors; add size to the views"
            )
        groups[name] = count + 1, sizes
    return groups


def _runs(items: Sequence[PlannedItem]) -> Iterator[list[PlannedItem]]:
    """Yield runs of items with the same sensor."""
    group: list[PlannedItem] = []
    for item in items:
        if group and group[0].sensor_digest != item.sensor_digest:
            yield group
            group = []
        group.append(item)
    if group:
        yield group


def sensor_table(job: BatchJob) -> list[dict[str, Any]]:
    """Return the sensors of a job with their rules as rows of a table."""
    return [
        {
            "sensor": each.name,
            "camera": each.rule.camera,
            "since": each.rule.since and str(each.rule.since),
            "until": each.rule.until and str(each.rule.until),
            "digest": each.digest[:NAME_DIGITS],
        }
        for each in job.sensors
    ]
