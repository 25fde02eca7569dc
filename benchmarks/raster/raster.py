"""Times triangle meshes against Mesa's llvmpipe, in turns: the same triangles, from NumPy arrays to NumPy arrays."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import Any

import numpy as np

import pyibr as ibr
from benchmarks import llvmpipe
from benchmarks.cases import Plan
from benchmarks.launches import kernel_times
from benchmarks.results import Record, Skip
from benchmarks.runner import Case, Work
from benchmarks.scenes import scanned
from pyibr.capture import models

OURS, PEER, UNREAD = "pyibr", "llvmpipe", "llvmpipe, picture not read back"
BARS = {("dragon", 1024): 2.0, ("donut", 512): 1.0}
"""Largest ratio of our time to llvmpipe's."""


def cases(plan: Plan) -> Iterator[Case]:
    """Yield the cases: a scanned dragon, and a donut of 20,000 triangles."""
    for (name, n), repeats in plan.raster.items():
        yield Case({"mesh": name, "size": n}, functools.partial(_prepare, name, n, repeats, plan.dragon_mesh))


def _prepare(name: str, n: int, repeats: int, scan: str) -> Work | Skip:
    if isinstance(gl := llvmpipe.context(), str):
        return Skip(PEER, gl)
    mesh = models.donut(100) if name == "donut" else scanned(scan)
    if isinstance(mesh, Skip):
        return mesh
    low, high = (np.asarray(corner, np.float64) for corner in mesh.bounds)
    middle, extent = 0.5 * (low + high), float(np.linalg.norm(high - low))
    camera = ibr.Camera.look_at(middle + extent * np.array([0.5, 0.35, 1.0]), middle, (0, 1, 0), (n, n), fov_y=42)
    tints = 0.5 + 0.5 * mesh.smooth_normals
    shown = ibr.Mesh(mesh.vertices, mesh.faces, colors=tints)
    peer = llvmpipe.triangles(camera, shown, tints, 0.3 * extent, 3 * extent)

    def read() -> Iterator[Record]:
        parameters = {"mesh": name, "size": n}
        with kernel_times() as times:
            frame = ibr.render(shown, camera)
        yield Record(OURS, "kernels", "ms", parameters, [sum(map(sum, times.values()))])
        color, depth = peer.picture()
        both = frame.valid & np.isfinite(depth)
        off = np.abs(frame.color.astype(int) - color)[both].max(axis=1)
        differs = float((frame.valid ^ np.isfinite(depth)).mean())
        yield Record(OURS, "pixels that only one covers", "share", parameters, [differs])
        yield Record(OURS, "pixels of equal colour", "share", parameters, [float((off <= 1).mean())])
        yield Record(OURS, "triangles", "count", parameters, [len(mesh.faces)])

    subjects: dict[str, Any] = {
        OURS: functools.partial(ibr.render, shown, camera),
        PEER: peer.picture,
        UNREAD: peer.draw,
    }
    return Work(subjects, repeats, read)
