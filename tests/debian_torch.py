"""PyTorch for the tests: installed, or from Debian's package `python3-torch`, which needs no gigabytes of CUDA."""

from __future__ import annotations

import atexit
import shutil
import sys
import sysconfig
import tempfile
import warnings
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import pytest

_PACKAGES = Path("/usr/lib/python3/dist-packages")
_NEEDED = "torch", "torchgen", "functorch", "mpmath", "sympy"


@cache
def _found() -> Any:
    if find_spec("torch") is None:
        suffix = sysconfig.get_config_var("EXT_SUFFIX")
        if not (_PACKAGES / f"torch/_C{suffix}").exists():
            return None
        alone = Path(tempfile.mkdtemp(prefix="torch-"))  # the folder's other packages stay out of reach
        atexit.register(shutil.rmtree, alone)
        for name in _NEEDED:
            if (_PACKAGES / name).exists():
                (alone / name).symlink_to(_PACKAGES / name)
        sys.path.append(str(alone))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Debian's is made for an older NumPy, which DLPack does not need
        import torch

        torch.zeros(1)[:0]  # which warns, too

    return torch


def torch() -> Any:
    """Return the package, or skip the test."""
    found = _found()
    if found is None:
        pytest.skip("PyTorch is not installed (apt-get install python3-torch)")
    return found
