"""Pictures drawn by Intel's runtime equal PoCL's."""

from __future__ import annotations

import os

import numpy as np
import pytest

import pyibr as ibr
from pyibr.opencl.device import VARIABLE
from tests.opencl.everything import calls

pytestmark = pytest.mark.skipif(
    os.environ.get(VARIABLE) != "intel", reason="make test-intel draws by both runtimes (PYIBR_DEVICE=intel)"
)


@pytest.mark.parametrize("name", ["sweep", "connected", "blended", "registered", "cleaned", "depth image", "relief"])
def test_intels_pictures_are_pocls(name: str):
    """The bits are the same for the releases in `make test-devices`; other releases may round differently."""
    found = []
    for device in ("intel", "portable computing language"):
        with ibr.use_device(device):
            found.append(calls()[name]())
    for one, other in zip(*found, strict=True):
        assert one.shape == other.shape
        level = 1 if one.dtype == np.uint8 else 0
        assert np.isclose(one.astype(float), other, rtol=1e-5, atol=level, equal_nan=True).mean() >= 0.999
