"""The paper's torus, with a sixteenth of the triangles."""

from __future__ import annotations

from functools import cache

import numpy as np

import pyibr as ibr
from pyibr.capture.models import torus_mesh


@cache
def torus() -> ibr.Mesh:
    corners = torus_mesh().vertices.reshape(384, 768, 3)[::4, ::4]
    rows, columns = corners.shape[:2]
    y, x = np.mgrid[:rows, :columns]
    numbers = [((y + dy) % rows * columns + (x + dx) % columns).ravel() for dy, dx in ((0, 0), (0, 1), (1, 1), (1, 0))]
    a, b, c, d = numbers
    return ibr.Mesh(corners.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
