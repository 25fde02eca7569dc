"""Results of a benchmark, as JSON: a list of records, each with the raw values of one quantity."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

SCHEMA = 1
UNITS = ("ms", "samples", "bytes", "share", "count", "spacings", "scene units", "dB")

Parameter = str | int | float


@dataclass(frozen=True)
class Record:
    """Raw values of one quantity of one subject in one case.

    Attributes
    ----------
    subject : str
        Subject of the measurement, e.g. "cv2.warpFrame".
    quantity : str
        Measured quantity, e.g. "end to end".
    unit : str
        One of `UNITS`.
    parameters : dict
        Parameters of the case, e.g. {"size": 512, "region": "A"}.
    values : list of float
        In the order of measurement.
    """

    subject: str
    quantity: str
    unit: str
    parameters: dict[str, Parameter]
    values: list[float]

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise ValueError(f"unit: expected one of {UNITS}, got {self.unit!r}")
        if not self.values:
            raise ValueError(f"values: expected at least one of {self.subject}, got none")
        if not all(isinstance(value, (int, float)) for value in self.values):
            raise ValueError(f"values: expected numbers of {self.subject}, got {self.values!r}")


@dataclass(frozen=True)
class Skip:
    """A subject that was left out, and why."""

    subject: str
    reason: str


@dataclass
class Result:
    """All records of one benchmark."""

    benchmark: str
    environment: dict[str, Any]
    records: list[Record] = field(default_factory=list["Record"])
    skipped: list[Skip] = field(default_factory=list["Skip"])
    schema: int = SCHEMA

    def select(self, **wanted: Parameter) -> Iterator[Record]:
        """Yield the records whose subject, quantity, unit and parameters have all the values in ``wanted``."""
        for record in self.records:
            values = {**record.parameters, **{k: getattr(record, k) for k in ("subject", "quantity", "unit")}}
            if all(values.get(key) == value for key, value in wanted.items()):
                yield record

    def save(self, path: Path) -> None:
        """Write the result as JSON."""
        path.parent.mkdir(parents=True, exist_ok=True)
        head = {k: v for k, v in asdict(self).items() if k not in ("records", "skipped")}
        lines = {"records": _lines(self.records), "skipped": _lines(self.skipped)}
        body = json.dumps(head, indent=1)[:-2] + "".join(f',\n "{key}": {text}' for key, text in lines.items())
        path.write_text(body + "\n}\n")

    @classmethod
    def load(cls, path: Path) -> Result:
        """Read a file that `save` wrote; raises ValueError, which names the file, for any other file."""
        try:
            data = json.loads(path.read_text())
            if data["schema"] != SCHEMA:
                raise ValueError(f"schema: expected {SCHEMA}, got {data['schema']!r}")
            records = [Record(**record) for record in data["records"]]
            skipped = [Skip(**skip) for skip in data["skipped"]]
            return cls(data["benchmark"], data["environment"], records, skipped)
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path}: not a result of these benchmarks: {error}") from error


def _lines(items: Iterable[Record | Skip]) -> str:
    """JSON list with one item per line, for readable differences."""
    return "[" + ",".join("\n  " + json.dumps(asdict(item)) for item in items) + "\n ]"
