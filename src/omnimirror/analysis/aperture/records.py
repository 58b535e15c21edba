"""Results that are tables: written as CSV or JSON."""

from __future__ import annotations

from abc import ABC, abstractmethod
from pathlib import Path

from ...base.files import write_json, write_text


class Recorded(ABC):
    """A result that can be told as records of the same names."""

    @abstractmethod
    def records(self) -> list[dict[str, float]]:
        """The records, by the names of the vocabulary."""

    def to_csv(self, path: str | Path) -> None:
        """Write a line per record, ten significant digits each."""
        records = self.records()
        lines = [",".join(records[0]), *(",".join(f"{v:.10g}" for v in record.values()) for record in records)]
        write_text(path, "\n".join(lines) + "\n")

    def to_json(self, path: str | Path) -> None:
        """Write a list of objects; what is not known is null."""
        write_json(path, self.records())
