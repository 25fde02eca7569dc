"""Outcome of a device's test."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import cast


@dataclass(frozen=True)
class Speed:
    """Speed from measurements of a fraction of a second: a hint, not a benchmark."""

    copy: float
    """GB/s, the sum of bytes read and bytes written."""
    mad: float
    """Gflop/s of 16-wide float32 multiply-adds."""


@dataclass(frozen=True)
class Outcome:
    """Outcome of one device's test."""

    works: bool
    reason: str = ""
    speed: Speed | None = None

    def to_json(self) -> str:
        """Return the outcome as one line of text."""
        return json.dumps(asdict(self))

    @staticmethod
    def from_json(text: str) -> Outcome | None:
        """Invert `to_json`; None if the text is damaged or from another version."""
        try:
            raw = cast("dict[str, object]", json.loads(text))
            speed = cast("dict[str, float] | None", raw["speed"])
            return Outcome(
                works=raw["works"] is True,
                reason=str(raw["reason"]),
                speed=None if speed is None else Speed(**speed),
            )
        except (ValueError, TypeError, KeyError):
            return None
