"""Scans on a grid: each point is in its cell, and invalid files are refused."""

from __future__ import annotations

import gzip

import numpy as np
import pytest

import pyibr as ibr
from pyibr.capture.scans import scan_view
from pyibr.io import read_range_grid

HEAD = """ply
format ascii 1.0
obj_info num_cols 3
obj_info num_rows 2
element vertex 4
property float x
property float y
property float z
element range_grid 6
property list uchar int vertex_indices
end_header
"""
BODY = """0 1 5
1 1 5
0 0 5.5
2 0 6
1 0
1 1
0
1 2
0
1 3
"""


def test_points_lie_in_their_cells(tmp_path):
    (tmp_path / "scan.ply").write_text(HEAD + BODY)
    (tmp_path / "scan.ply.gz").write_bytes(gzip.compress((HEAD + BODY).encode()))
    points = read_range_grid(tmp_path / "scan.ply")
    assert points.shape == (2, 3, 3) and points.dtype == np.float32
    nothing = [np.nan] * 3
    expected = [[[0, 1, 5], [1, 1, 5], nothing], [[0, 0, 5.5], nothing, [2, 0, 6]]]
    np.testing.assert_array_equal(points, np.array(expected, np.float32))
    np.testing.assert_array_equal(points, read_range_grid(tmp_path / "scan.ply.gz"))


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (HEAD + BODY[:-4], "9 lines"),
        (HEAD.replace("obj_info num_cols 3\n", "") + BODY, "num_cols"),
        (HEAD.replace("ascii", "binary_little_endian") + BODY, "ASCII PLY"),
        (HEAD.replace("element range_grid 6", "element range_grid 5") + BODY, "a cell for each"),
        (HEAD + BODY.replace("1 3", "1 4"), "vertex 4, of only 4"),
        ("solid", "ASCII PLY"),
        (HEAD + BODY.replace("5.5", "five"), "five"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, text, reason):
    path = tmp_path / "scan.ply"
    path.write_text(text)
    with pytest.raises(ibr.FileFormatError, match=rf"scan\.ply: .*{reason}"):
        read_range_grid(path)


def grid(rows: int = 30, columns: int = 40) -> np.ndarray:
    y, x = np.mgrid[:rows, :columns].astype(np.float32)
    return np.stack([x / 10, -y / 10, 0.2 * np.sin(x / 6)], axis=-1)


def test_a_scan_as_a_depth_image():
    points = grid()
    points[12:15, 20:24] = np.nan  # a hole
    points[:4, :5] = np.nan  # a corner is missing
    pose = np.eye(4)
    pose[:3, 3] = 4, 5, 6
    view = scan_view(points, pose)
    assert view.camera.projection == "orthographic"
    world = view.points
    np.testing.assert_allclose(world[:, 2] - 6, 0.2 * np.sin((world[:, 0] - 4) * 10 / 6), atol=0.2 / 6**2 / 4)
    assert 8 <= np.isnan(view.depth).sum() <= 30
    middle = view.camera.project(np.array([[4 + 2.15, 5 - 1.3, 6.0]]))[0].round().astype(int).ravel()
    assert np.isnan(view.depth[middle[1], middle[0]]) and np.isposinf(view.depth[0]).all()


EDGE_ON = np.stack(np.meshgrid(np.arange(9), 0, np.arange(3), indexing="ij"), -1)[:, 0].swapaxes(0, 1).astype(float)


@pytest.mark.parametrize(
    "points", [np.zeros((3, 3), np.float32), np.full((3, 3, 3), np.nan, np.float32), EDGE_ON], ids=["2D", "NaN", "edge"]
)
def test_what_is_no_scan(points):
    with pytest.raises(ibr.ArgumentError, match=r"^points: "):
        scan_view(points)
