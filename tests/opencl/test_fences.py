"""Kernels in wide lanes between pages that nobody may read: one step too far ends the process."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

FENCED = """
import ctypes, mmap, warnings
import numpy as np
import pyopencl as cl
from pyibr.opencl import memory

libc = ctypes.CDLL(None, use_errno=True)

def fenced(session, size):
    whole = -(-max(size, 1) // mmap.PAGESIZE) * mmap.PAGESIZE
    pages = mmap.mmap(-1, whole + mmap.PAGESIZE)
    held = np.frombuffer(pages, np.uint8)
    assert libc.mprotect(ctypes.c_void_p(held.ctypes.data + whole), mmap.PAGESIZE, 0) == 0
    start = (whole - max(size, 1)) // 64 * 64  # runtimes want that alignment
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.USE_HOST_PTR
    buffer = cl.Buffer(session.context, flags, hostbuf=held[start : start + max(size, 1)])
    return memory.Block(buffer, size, pages, start)

memory._take = fenced
memory._give_back = lambda session, block: None

import pyibr as ibr
warnings.simplefilter("ignore")  # that some targets see nothing
from pyibr.capture import models
from pyibr.capture import object_views

for projection in ("perspective", "orthographic"):
    for size in (16, 33, 64, 128):
        views = object_views(models.donut(20), size, projection)
        camera = ibr.Camera.look_at((1, 2, 5), (0, 0, 0), (0, 1, 0), (size, size), fov_y=45)
        light = ibr.Light(direction=(-1, -1, -1), shadow_size=64)
        solid, mesh = ibr.DepthObject(views, slices=16), models.donut(20)
        things = [ibr.DepthMesh(views[4]), ibr.DepthMeshObject(views), solid, mesh]
        ibr.DepthMesh(views[4]).simplify(0.01)
        for thing in things:
            ibr.render(thing, camera, light)

from tests import scenes

for projection in ("perspective", "orthographic"):
    for size in ((7, 13), (61, 37), (2, 2), (17, 2), (1, 1), (1, 9)):
        view = scenes.smooth(size, projection)
        for target_size in ((61, 37), size, (1, 60), (60, 1)):
            for pose in scenes.special_cameras(view, target_size):
                for way in ({}, {"edges": "connect", "classes": True}, {"method": "search"}, {"fill": "background"}):
                    ibr.warp(view, pose.camera, **way)
print("through")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="pages are protected by Linux' mprotect")
def test_no_kernel_reads_beyond_its_arrays():
    pytest.importorskip("open3d")
    variables = os.environ | {"PYTHONPATH": os.pathsep.join(p for p in sys.path if p)}
    done = subprocess.run([sys.executable, "-c", FENCED], env=variables, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and "through" in done.stdout, done.stderr[-2000:]
