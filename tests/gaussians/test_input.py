"""Arguments and files of Gaussians: errors, repairs, and what a file keeps."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from tests.data import shared
from tests.exact import same_bits
from tests.gaussians.clouds import camera, cloud

GOOD = {
    "means": [[0, 0, 3.0], [1, 0, 4]],
    "scales": [[0.1, 0.2, 0.3]] * 2,
    "rotations": [[1, 0, 0, 0.0]] * 2,
    "opacities": [0.5, 1.0],
    "colors": [[0.5, 0.5, 0.5]] * 2,
}


def changed(name: str, value: object, *places: int) -> dict[str, object]:
    array = np.array(GOOD[name], np.float64)
    array[places] = value
    return {**GOOD, name: array}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (changed("means", np.nan, 0, 0), "means: expected finite numbers"),
        (changed("means", np.inf, 0, 0), "means: expected finite numbers"),
        (changed("scales", -0.1, 1, 2), "scales: expected numbers from 0 to"),
        (changed("scales", np.inf, 1, 2), "scales: expected finite"),
        (changed("rotations", 0, 1), "rotations: expected quaternions .* 1 of length 0"),
        (changed("rotations", np.nan, 1), "rotations: expected finite"),
        (changed("opacities", 1.1, 0), "opacities: expected numbers from 0 to 1, got 1 to 1.1"),
        (changed("opacities", -0.1, 0), "opacities: expected numbers from 0 to 1"),
        (changed("opacities", np.nan, 0), "opacities: expected finite"),
        ({**GOOD, "means": np.zeros((0, 3))}, "means: expected at least one Gaussian"),
        ({**GOOD, "scales": [[1, 1, 1]]}, "scales: expected finite numbers of shape"),
        ({**GOOD, "colors": None}, "colors: expected either `colors` or `sh`, got neither"),
        ({**GOOD, "sh": np.zeros((2, 1, 3))}, "got both"),
        ({**GOOD, "colors": None, "sh": np.zeros((2, 5, 3))}, "sh: expected 1, 4, 9 or 16 coefficients"),
        ({**GOOD, "colors": None, "sh": np.full((2, 4, 3), np.nan)}, "sh: expected finite"),
        ({**GOOD, "colors": [[2.0, 0, 0]] * 2}, "colors: expected uint8, or float32"),
        ({**GOOD, "low_pass": -1}, "low_pass: expected a variance"),
        ({**GOOD, "near": 0}, "near: expected a depth"),
    ],
)
@pytest.mark.parametrize("dtype", [np.float64, np.float32])
def test_a_mistake_is_named(arguments, words, dtype):
    given = {k: v.astype(dtype) if isinstance(v, np.ndarray) else v for k, v in arguments.items()}
    with pytest.raises(ibr.ArgumentError, match=words):
        ibr.Gaussians(**given)


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
    low, high = thing.bounds
    assert (low < thing.means.min(axis=0)).all() and (high > thing.means.max(axis=0)).all()


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_a_file_keeps_the_cloud(tmp_path: Path, degree: int):
    thing = cloud(300, degree)
    thing.save(tmp_path / "cloud.ply")
    found = ibr.Gaussians.load(tmp_path / "cloud.ply")
    np.testing.assert_array_equal(found.means, thing.means)
    np.testing.assert_array_equal(found.sh, thing.sh)
    np.testing.assert_allclose(found.scales, thing.scales, rtol=1e-6)
    np.testing.assert_allclose(found.opacities, thing.opacities, atol=1e-6)
    one, other = ibr.render(thing, camera()), ibr.render(found, camera())
    assert np.abs(one.color.astype(int) - other.color).max() <= 1


def ply(rows: list[list[float]], names: list[str]) -> bytes:
    head = f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\n" + "".join(f"property float {n}\n" for n in names)
    return (head + "end_header\n" + "\n".join(" ".join(map(str, row)) for row in rows) + "\n").encode()


NAMES = ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2"]
NAMES += ["rot_0", "rot_1", "rot_2", "rot_3"]
ROW = [0, 0, 3, 1, 0, 0, 2, -2, -2, -2, 1, 0, 0, 0]


def test_files_of_other_programs(tmp_path: Path):
    file = tmp_path / "cloud.ply"
    rows = [[*ROW[:6], logit, *ROW[7:]] for logit in (0.0, np.inf, -np.inf)]
    file.write_bytes(ply(rows, NAMES))
    np.testing.assert_allclose(ibr.Gaussians.load(file).opacities, [0.5, 1, 0])
    bad = [ROW, [np.nan, *ROW[1:]], [*ROW[:7], 1e6, *ROW[8:]], [*ROW[:10], 0, 0, 0, 0], [*ROW[:6], np.nan, *ROW[7:]]]
    file.write_bytes(ply(bad, NAMES))
    with pytest.warns(UserWarning, match="left out: 4 Gaussians with values that are not finite"):
        assert len(ibr.Gaussians.load(file)) == 1
    with pytest.raises(ibr.FileFormatError, match=r"Gaussians, not a mesh; pyibr\.Gaussians\.load"):
        ibr.Mesh.load(file)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (ply([ROW], NAMES)[:-30], "fewer numbers"),
        (ply([ROW], NAMES).replace(b"vertex 1", b"vertex 99999999999"), "more than the file holds"),
        (ply([ROW[:-1]], NAMES[:-1]), "no 3D Gaussians: no rot_3"),
        (ply([[*ROW, 1.0]], [*NAMES, "f_rest_0"]), "1 properties f_rest"),
        (ply([[np.nan, *ROW[1:]]], NAMES), "no Gaussians with finite values"),
        (b"ply\nend_header\n", "no format"),
        (b"", "empty"),
    ],
)
def test_a_damaged_file_is_refused(tmp_path: Path, content: bytes, words: str):
    (tmp_path / "cloud.ply").write_bytes(content)
    with pytest.raises(ibr.FileFormatError, match=words):
        ibr.Gaussians.load(tmp_path / "cloud.ply")


def test_other_names_are_refused(tmp_path: Path):
    with pytest.raises(ibr.FileFormatError, match=r"ends in \.ply"):
        ibr.Gaussians.load(tmp_path / "cloud.spz")
    with pytest.raises(ibr.ArgumentError, match=r"ends in \.ply"):
        cloud(3).save(tmp_path / "cloud.splat")


def test_a_compressed_file_says_so():
    file = shared("gaussians/biker.compressed.ply")
    with pytest.raises(ibr.FileFormatError, match="compressed"):
        ibr.Gaussians.load(file)
