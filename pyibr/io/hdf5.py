"""HDF5 files of one array, such as Hypersim's."""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyibr.core.errors import FileFormatError
from pyibr.core.files import check_unpacked, reading
from pyibr.core.optional import h5py


def read_array(path: str | PathLike[str]) -> NDArray[Any]:
    """Return the array named dataset, or the only one."""
    library = h5py()
    with reading(path, "HDF5") as source, library.File(source, "r") as file:
        names = list(file)
        name = "dataset" if "dataset" in names else names[0] if len(names) == 1 else ""
        if not name or not isinstance(file[name], library.Dataset):
            raise FileFormatError(f"{path}: no array 'dataset' among {', '.join(names) or 'none'}")
        check_unpacked(int(file[name].size) * int(file[name].dtype.itemsize))
        return np.array(file[name])


read_color = read_depth = read_array
