"""The sweep can follow its lines on cut surfaces from column to column or from edge to edge: both ways compared."""

from __future__ import annotations

import numpy as np
import pytest

import pyibr as ibr
from benchmarks.launches import counted_samples
from pyibr.core.pixelspace import camera_pair, pitch
from pyibr.opencl.watch import Watch, watching
from tests import scenes
from tests.warp.test_generated import Case, make_case
from tests.warp.test_special_positions import beside_border

WITHIN_A_CELL = 0.05  # fraction of the depth: differences within a cell are smaller, steps between pieces larger


class Answers(Watch):
    """Records what the sweep's lines hit; with `edges`, lines are followed from edge to edge."""

    def __init__(self, edges: bool) -> None:
        self.edges = edges
        self.seen = None

    def build(self, name, defines, make):
        return make({**defines, "EDGES": 1} if self.edges and name == "epipolar_sweep" else defines)

    def launch(self, kernel, grid, arguments, enqueue) -> None:
        if kernel.name == "resolve":
            self.seen = arguments["hits"].to_host().copy()
        enqueue(**arguments)


def nearness_seen(case: Case, edges: bool) -> np.ndarray:
    """(H, W) nearness, in the target, that each pixel's line hits; NaN if it hits nothing."""
    width, height = case.target.size
    with watching(Answers(edges)) as answers:
        ibr.warp(case.view, case.target, edges="cut", cut_ratio=1.05, side=case.side)
    seen = answers.seen[: height * pitch(width)].reshape(height, pitch(width))[:, :width]
    return np.where(seen > -1e37, seen, np.nan)


def is_swept_by_columns(case: Case) -> bool:
    return not camera_pair(case.view.camera, case.target).aligned and case.move != "turned alone"


@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
@pytest.mark.parametrize("first", range(1000, 1240, 40))
def test_columns_and_edges_meet_the_same_pieces(first):
    """Hits agree, except on lines through corners of cells: there rounding decides which triangles a line crosses."""
    shares = []
    for case in filter(is_swept_by_columns, map(make_case, range(first, first + 40))):
        by_columns, by_edges = nearness_seen(case, edges=False), nearness_seen(case, edges=True)
        with np.errstate(invalid="ignore", divide="ignore"):
            differ = np.abs(by_columns / by_edges - 1) > WITHIN_A_CELL
        differ |= np.isfinite(by_columns) != np.isfinite(by_edges)
        assert differ.sum() <= max(2, 0.002 * differ.size), f"{differ.sum()} of {differ.size} pixels, {case}"
        shares.append(differ.mean())
    assert len(shares) > 20
    assert np.mean(shares) < 2e-4


@pytest.mark.parametrize("seed", range(4))
def test_both_pieces_of_a_step_are_met(seed):
    """Noise tears many edges: between two columns, lines leave the surface and meet it again."""
    rng = np.random.default_rng(seed)
    camera = ibr.Camera([[40, 0, 20], [0, 40, 15], [0, 0, 1]], (41, 31))
    depth = (4 * (1 + rng.uniform(-0.035, 0.035, (31, 41)))).astype(np.float32)
    view = ibr.DepthImage(None, depth, camera)
    closer = camera.moved(0.3, 0.2, 0.4)
    # The principal point is such that no line runs exactly along the border of the source.
    target = ibr.Camera([[200, 0, 100.3], [0, 200, 75.2], [0, 0, 1]], (205, 155), closer.world_from_camera)
    case = Case(seed, "noise", "any", view, target, "cut", "front")
    by_columns, by_edges = (np.isfinite(nearness_seen(case, edges)) for edges in (False, True))
    assert by_edges.sum() > 15_000
    # Lines end at the source's border, between two columns. Interpolation between columns finds the end to a pixel.
    differ = by_columns != by_edges
    assert (differ & ~beside_border(by_edges)).sum() <= 3
    assert differ.sum() <= 0.1 * differ.shape[0]


@pytest.mark.filterwarnings("ignore:warp. the target camera sees nothing")
def test_nothing_is_traced_amid_a_side_that_is_not_shown():
    """If only the other side is seen, `resolve` traces few rays: they would find nothing and take long."""
    view = scenes.smooth((96, 128))
    with counted_samples() as visited:
        frame = ibr.warp(view, view.camera.moved(0.3, 0.2, 0.4), edges="cut", side="back")
    assert not frame.valid.any()
    assert visited["resolve"].pixels < 0.05 * frame.valid.size
