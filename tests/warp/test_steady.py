"""New views of a noisy camera at rest change less over time than its images, in depth and colour, holes included."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks import scenes
from benchmarks.cases import QUICK
from benchmarks.warp import steady
from tests.data import shared

PLAN = replace(QUICK, rgbd_steady={(640, 480): 10})


@pytest.mark.thorough
def test_views_are_as_steady_as_their_input():
    """The target is turned by 34 degrees and moved by 0.7 m, so far that noise in depth changes colours much."""
    shared("rgbd_livingroom1")
    (case,) = (c for c in steady.cases(PLAN, scenes.LIVINGROOM) if c.parameters["motion"] == "50 to 0")
    records = list(case.prepare().read())
    bars = {record.quantity: record.values[0] for record in records if record.subject == steady.INPUT}
    changes = {
        (r.subject, r.parameters["fill"], r.parameters["where"], r.quantity): r.values[0]
        for r in records
        if r.subject != steady.INPUT
    }
    assert len(bars) == 2 and len(changes) == 3 * 3 * 2 * 2
    for (subject, *_, quantity), change in changes.items():
        assert subject != steady.STEADY or change <= bars[quantity]
    # Cleaning each frame together with the previous one removes more noise than cleaning each frame alone.
    for fill in steady.FILLS:
        single, both = (changes[subject, fill, steady.SEEN, steady.DEPTH] for subject in (steady.SINGLE, steady.STEADY))
        assert both < 0.6 * single
