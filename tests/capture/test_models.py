from __future__ import annotations

import numpy as np
import pytest

from pyibr.capture import models
from pyibr.core.errors import ArgumentError


def test_the_donut_is_closed_and_its_normals_point_outwards():
    mesh = models.donut(25, radius=2.0, tube=0.5)
    assert len(mesh.faces) == 1250
    ring = np.hypot(mesh.vertices[:, 0], mesh.vertices[:, 1])
    np.testing.assert_allclose(np.hypot(ring - 2, mesh.vertices[:, 2]), 0.5, rtol=1e-5)
    corner = mesh.vertices[mesh.faces].astype(float)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    assert (np.einsum("nc,nc->n", across, mesh.normals[mesh.faces[:, 0]]) > 0).all()
    # The volume, by the divergence theorem, is a little less than the torus's, 2 pi^2 R r^2.
    volume = np.einsum("nc,nc->", across, corner[:, 0]) / 6
    assert 0.96 <= volume / (2 * np.pi**2 * 2 * 0.25) <= 1
    with pytest.raises(ArgumentError, match="sides"):
        models.donut(2)
