"""The benchmark of pages: how it evaluates rounds of drawing, and its section of the report."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.app import pages
from benchmarks.app.pages_section import pages_section
from benchmarks.cases import FULL
from benchmarks.results import Result
from tests.benchmarks.test_report import ENVIRONMENT

COARSE = [[10.0, "jpeg", 320, 240], [10.05, "jpeg", 320, 240]]
FINE = [[10.15, "jpeg", 640, 480], [10.22, "jpeg", 640, 480], [10.5, "png", 640, 480], [10.6, "png", 640, 480]]
ROUNDS = [
    {"last": 10.2, "pictures": COARSE + FINE},
    {"last": 20.0, "pictures": [[19.9, "jpeg", 640, 480], [20.25, "png", 640, 480]]},
]


def records(client: str = pages.RECEIVES):
    parameters = {"client": client, "width": 640, "height": 480}
    made = list(pages._records("depth image", parameters, ROUNDS, FULL))
    return {record.quantity: record for record in made}


def test_rounds_tell_gaps_widths_and_how_long_rests_take() -> None:
    found = records()
    assert found["between pictures"].values == pytest.approx([50, 100])  # one picture in the second round
    assert found["width"].values == [0.5, 0.5, 1.0, 1.0]
    assert found["until full"].values == pytest.approx([300, 250])
    assert found["pictures after the last camera"].values == [1]
    assert list(pages._records("depth image", {}, [{"last": 1.0, "pictures": []}], FULL)) == []


def test_the_section_judges_each_by_its_bar(tmp_path: Path) -> None:
    result = Result("pages", ENVIRONMENT)
    for client in pages.RESTS:
        result.records += records(client).values()
        waits = pages.Record("depth image", "requests that wait", "count", next(iter(result.records)).parameters, [1])
        result.records.append(pages.Record(**{**vars(waits), "parameters": {**waits.parameters, "client": client}}))
    (head, table) = pages_section(result, tmp_path)
    assert "640 x 480" in head
    received, drawn = table.splitlines()[2:]
    # Two pictures in 150 ms are 13.3 per second; 275 ms is the median of 250 and 300 ms.
    assert "| 13.3 | at least 30 | **not met** |" in received
    assert "| 13.3 | at least 12 | met |" in drawn
    assert "275" in received and "at most 400 | met" in received and "at most 800 | met" in drawn
    assert pages_section(Result("pages", ENVIRONMENT), tmp_path) == []
