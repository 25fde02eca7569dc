"""Range grids: scans in PLY files whose points lie on a grid of rows and columns, as in Stanford's repository."""

from __future__ import annotations

from os import PathLike

import numpy as np
from numpy.typing import NDArray

from pyibr.core.files import read_bytes, reading


def read_range_grid(path: str | PathLike[str]) -> NDArray[np.float32]:
    """Read a scan: an ASCII PLY file with an element ``range_grid``, also packed by gzip.

    Parameters
    ----------
    path : path
        A file that ends in .ply, or .ply.gz.

    Returns
    -------
    (rows, columns, 3) float32
        Points in the scanner's frame, in the file's unit; NaN where the scanner measured nothing.

    Raises
    ------
    FileFormatError
        If the file is missing, truncated, or no range grid.

    Examples
    --------
    >>> from pathlib import Path
    >>> from pyibr.io import read_range_grid
    >>> header = "ply\\nformat ascii 1.0\\nobj_info num_cols 2\\nobj_info num_rows 1\\nelement vertex 1\\n"
    >>> header += "property float x\\nproperty float y\\nproperty float z\\nelement range_grid 2\\n"
    >>> header += "property list uchar int vertex_indices\\nend_header\\n"
    >>> _ = Path("scan.ply").write_text(header + "1 2 3\\n1 0\\n0\\n")
    >>> read_range_grid("scan.ply").tolist()
    [[[1.0, 2.0, 3.0], [nan, nan, nan]]]
    """
    with reading(path, "range grid") as source:
        data = read_bytes(source).replace(b"\r\n", b"\n")
        head, separator, body = data.partition(b"end_header\n")
        lines = head.decode("ascii").splitlines()
        words = [line.split() for line in lines]
        if not separator or words[:1] != [["ply"]] or ["format", "ascii", "1.0"] not in words:
            raise ValueError("expected an ASCII PLY file")
        named = {tuple(line[:2]): line[2:] for line in words if len(line) >= 3}
        try:
            columns, rows = (int(named["obj_info", name][0]) for name in ("num_cols", "num_rows"))
            count, cells = (int(named["element", name][0]) for name in ("vertex", "range_grid"))
        except KeyError as error:
            raise ValueError(f"no {' '.join(error.args[0])} in the header") from None
        properties = words[words.index(["element", "vertex", str(count)]) + 1 :]
        if [line[-1] for line in properties[:3]] != ["x", "y", "z"] or cells != rows * columns:
            raise ValueError("expected vertices that start with x y z, and a cell for each row and column")
        text = body.decode("ascii").splitlines()
        if len(text) < count + cells:
            raise ValueError(f"expected {count} vertices and {cells} cells, got {len(text)} lines")
        points = np.array([line.split()[:3] for line in text[:count]], np.float32).reshape(count, 3)
        grid = np.full((cells, 3), np.nan, np.float32)
        # A cell is "0", or "1" and the index of its vertex.
        number = np.array([int(line[2:]) if line[:2] == "1 " else -1 for line in text[count : count + cells]])
        if number.max(initial=-1) >= count:
            raise ValueError(f"a cell with vertex {number.max()}, of only {count} vertices")
        grid[number >= 0] = points[number[number >= 0]]
        return grid.reshape(rows, columns, 3)
