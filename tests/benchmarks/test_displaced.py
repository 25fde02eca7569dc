"""The comparison of displaced surfaces with meshes: times at equal error."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchmarks.cases import QUICK
from benchmarks.displaced import CUTS, EXACT, OURS, cases, mesh_name
from benchmarks.displaced_section import equal_error

MESHES = [(0.01, 10.0), (0.1, 1.0)]  # errors, milliseconds


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (10**-1.5, f"{math.sqrt(10):.2f} (1.58)"),  # half way between the meshes, in logarithms
        (0.1, "1.00 (0.50)"),
        (0.001, "over 10.0 (over 5.00)"),
        (0.5, "under 1.00 (under 0.50)"),
    ],
)
def test_time_of_a_mesh_with_the_same_error(error: float, said: str):
    assert equal_error(MESHES, error, 2.0) == said


def test_finer_meshes_and_exact_searches_are_closer_to_the_truth():
    pytest.importorskip("open3d")
    work = next(iter(cases(replace(QUICK, displaced={(400, 300): 1}, displaced_truth=40)))).prepare()
    records = list(work.read())
    errors = {r.subject: float(r.values[0]) for r in records if r.quantity == "depth error"}
    meshes = [errors[mesh_name(cut)] for cut in CUTS]
    assert set(errors) == {*OURS, *map(mesh_name, CUTS)}
    assert np.all(np.diff(meshes[:4]) < 0)
    assert errors[EXACT] < min(errors["relief, approximate"], meshes[2])
    assert errors["slices, by the view"] < min(errors["64 slices"], meshes[2])
    same = {r.subject: r.values[0] for r in records if r.quantity == "silhouette (IoU)"}
    assert min(same.values()) > 0.9 and same[EXACT] > 0.99
