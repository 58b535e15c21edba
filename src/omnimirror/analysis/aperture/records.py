"""Tabular results with CSV and JSON output."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

from ...base.files import write_json, write_text


class Recorded(ABC):
    """Result that consists of uniform records."""

    @abstractmethod
    def records(self) -> list[dict[str, float]]:
        """Return the records, with quantity names as keys."""

    def to_csv(self, path: str | Path) -> None:
        """Write one CSV line per record, with ten significant digits."""
        records = self.records()
        lines = [",".join(records[0]), *(",".join(f"{v:.10g}" for v in record.values()) for record in records)]
        write_text(path, "\n".join(lines) + "\n")

    def to_json(self, path: str | Path) -> None:
        """Write a JSON list of objects; unknown values are null."""
        write_json(path, self.records())
