"""Arguments and files of Gaussians: errors, repairs, and what a file keeps."""

from __future__ import annotations

import pickle
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.exact import same_bits
from tests.gaussians.clouds import camera, cloud, like

GOOD = {
    "means": [[0, 0, 3.0], [1, 0, 4]],
    "scales": [[0.1, 0.2, 0.3]] * 2,
    "rotations": [[1, 0, 0, 0.0]] * 2,
    "opacities": [0.5, 1.0],
    "colors": [[0.5, 0.5, 0.5]] * 2,
}
COLORS = "colors: expected uint8, or float32"


RANGES = [
    ("means", np.nan, "expected finite numbers"),
    ("means", 2e9, r"expected numbers from -1e\+09 to 1e\+09, got .* to 2000000000\.0"),
    ("scales", -0.1, "expected numbers from 0 to"),
    ("scales", np.inf, "expected finite"),
    ("rotations", 0, "expected quaternions .* 1 of length 0"),
    ("rotations", np.nan, "expected finite"),
    ("opacities", 1.1, r"expected numbers from 0 to 1, got 1\.0 to 1\.1"),
    ("opacities", -0.1, "expected numbers from 0 to 1"),
    ("opacities", np.nan, "expected finite"),
]


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        *(
            ({name: np.array([np.full_like(GOOD[name][0], value), GOOD[name][1]], dtype)}, f"{name}: {words}")
            for name, value, words in RANGES
            for dtype in (np.float64, np.float32)
        ),
        ({"means": np.zeros((0, 3))}, "means: expected at least one Gaussian"),
        ({"scales": [[1, 1, 1]]}, "scales: expected finite numbers of shape"),
        ({"colors": None}, "colors: expected either `colors` or `sh`, got neither"),
        ({"sh": np.zeros((2, 1, 3))}, "got both"),
        ({"colors": None, "sh": np.zeros((2, 5, 3))}, "sh: expected 1, 4, 9 or 16 coefficients"),
        ({"colors": None, "sh": np.full((2, 4, 3), np.nan)}, "sh: expected finite"),
        *(
            ({"colors": bad}, COLORS)
            for bad in ([[2.0] * 3] * 2, [[1], [2, 3]], [["red"] * 3] * 2, [[10**400] * 3] * 2)
        ),
        ({"opacities": [0.5, 1.0000000001]}, r"got 0\.5 to 1\.0000000001"),
        ({"low_pass": -1}, "low_pass: expected a variance"),
        ({"near": 0}, "near: expected a depth"),
    ],
)
def test_a_mistake_is_named(changes, words):
    with pytest.raises(ibr.ArgumentError, match=words):
        ibr.Gaussians(**{**GOOD, **changes})


def test_a_scale_of_zero_and_a_long_quaternion_are_repaired():
    arguments = {**GOOD, "rotations": [[1e200, 1e200, 0, 0], [0, 0, 0, -1e-200]], "scales": [[0.1, 0, 0]] * 2}
    thing = ibr.Gaussians(**arguments)
    np.testing.assert_allclose(np.linalg.norm(thing.rotations, axis=1), 1, rtol=1e-6)
    frame = ibr.render(thing, camera())
    assert np.isfinite(frame.depth[frame.valid]).all() and frame.alpha.max() > 0.3


def test_a_cloud_cannot_change_and_can_be_copied():
    thing = cloud(50, 1)
    with pytest.raises(ValueError, match="read-only"):
        thing.means[0] = 0
    with pytest.raises(AttributeError):
        thing.near = 1
    same_bits(ibr.render(thing, camera()), ibr.render(pickle.loads(pickle.dumps(thing)), camera()))
    assert repr(thing) == "<Gaussians 50, degree 1>" and len(thing) == 50
    low, high = like(thing, [0]).bounds  # an opacity of 1 falls to 1/255 at 3.33 standard deviations
    np.testing.assert_allclose([low, high], thing.means[0] + 3.33 * thing.scales[0].max() * np.array([[-1], [1]]))


def test_bounds_leave_out_strays_alone():
    thing = cloud(1000)
    low, high = thing.bounds
    means = thing.means.copy()
    means[:3, 0], means[3:6, 1] = 500, -500
    with_strays = like(thing, means=means).bounds
    np.testing.assert_array_equal(low[2], with_strays[0][2])
    assert low[1] <= with_strays[0][1] < low[1] + 1 and high[0] - 1 < with_strays[1][0] <= high[0]
    reach = 3.33 * thing.scales.max(axis=1, keepdims=True)
    np.testing.assert_allclose([low, high], [(thing.means - reach).min(axis=0), (thing.means + reach).max(axis=0)])


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_file_keeps_the_cloud(tmp_path: Path, degree: int):
    thing = cloud(300, degree)
    thing.save(tmp_path / "cloud.ply")
    found = ibr.Gaussians.load(tmp_path / "cloud.ply")
    header = (tmp_path / "cloud.ply").read_bytes().partition(b"end_header")[0].decode()
    names = [line.split()[2] for line in header.splitlines() if line.startswith("property")]
    rests = [f"f_rest_{number}" for number in range(3 * (degree + 1) ** 2 - 3)]
    assert names == [*NAMES[:3], "nx", "ny", "nz", *NAMES[3:6], *rests, *NAMES[6:]]  # which some programs expect
    np.testing.assert_array_equal(found.means, thing.means)
    np.testing.assert_array_equal(found.sh, thing.sh)
    np.testing.assert_allclose(found.scales, thing.scales, rtol=1e-6)
    np.testing.assert_allclose(found.opacities, thing.opacities, atol=1e-6)
    one, other = ibr.render(thing, camera()), ibr.render(found, camera())
    assert np.abs(one.color.astype(int) - other.color).max() <= 1


def ply(rows: list[list[float]], names: list[str]) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n" + "".join(f"property float {n}\n" for n in names)
    return (head + "end_header\n" + "\n".join(" ".join(map(str, row)) for row in rows) + "\n").encode()


NAMES = ["x", "y", "z", *(f"f_dc_{n}" for n in range(3)), "opacity", *(f"scale_{n}" for n in range(3))]
NAMES += [f"rot_{n}" for n in range(4)]
ROW = [0, 0, 3, 1, 0, 0, 2, -2, -2, -2, 1, 0, 0, 0]


def test_files_of_other_programs(tmp_path: Path):
    file = tmp_path / "cloud.ply"

    def write(*changes: tuple[int, float]) -> None:
        file.write_bytes(ply([[*ROW[:at], value, *ROW[at + 1 :]] for at, value in changes], NAMES))

    write((6, 0.0), (6, np.inf), (6, -np.inf))
    np.testing.assert_allclose(ibr.Gaussians.load(file).opacities, [0.5, 1, 0])
    write((0, 1), (0, np.nan), (0, 2e9), (3, 1e10), (6, np.nan), (7, 1e6), (7, 50), (10, 0))
    with pytest.warns(UserWarning, match="left out: 7 Gaussians .* not finite or exceed 1e9, scales below 0, or quat"):
        assert len(ibr.Gaussians.load(file)) == 1


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (ply([ROW], NAMES)[:-30], "fewer numbers"),
        (ply([ROW], NAMES).replace(b"vertex 1", b"vertex 99999999999"), "more than the file holds"),
        (ply([ROW[:-1]], NAMES[:-1]), "no 3D Gaussians: no rot_3"),
        (ply([[*ROW, 1.0]], [*NAMES, "f_rest_0"]), "1 properties f_rest"),
        (ply([[*ROW, *[0.0] * 9]], [*NAMES, *(f"f_rest_{n}" for n in range(1, 10))]), "no f_rest_0 in the header"),
        (ply([[np.nan, *ROW[1:]]], NAMES), "none of its 1 Gaussians are usable"),
        (b"ply\nend_header\n", "no format"),
        (b"", "empty"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes, words: str):
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.Gaussians.load(tmp_path / "cloud.ply")


def test_memory_is_bounded_by_the_file(tmp_path: Path):
    file, thing, few = tmp_path / "cloud.ply", cloud(100_000, 3), cloud(9)
    draws = [lambda _, n=n: ibr.render([thing, few][:n], camera((17, 9))) for n in (1, 2)]
    tracemalloc.start()  # counts NumPy's arrays
    try:
        for call, most in zip((thing.save, ibr.Gaussians.load, *draws), (2.3, 2.3, 1.5, 0.1), strict=True):
            tracemalloc.reset_peak()
            before = tracemalloc.get_traced_memory()[0]
            call(file)
            assert tracemalloc.get_traced_memory()[1] - before < most * file.stat().st_size
    finally:
        tracemalloc.stop()
