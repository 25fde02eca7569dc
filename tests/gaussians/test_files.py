"""Files of Gaussians: what each format keeps, files of other programs, and damaged files."""

from __future__ import annotations

import gzip
import resource
import struct
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyibr as ibr
from tests.data import shared
from tests.gaussians.clouds import camera, cloud, like

BY_GAUSSFORGE = (".splat", ".spz", ".sog")
STEPS = {  # largest errors: of means, logarithms of scales, opacities, and harmonics of degree 0, 1 and beyond
    ".ply": (0, 1e-6, 1e-6, 0, 0, 0),
    ".compressed.ply": (1.8e-3, 2e-3, 0.002, 0.01, 0.016, 0.016),
    ".splat": (0, 1e-6, 0.004, 0.014, None, None),
    ".spz": (1.3e-4, 0.032, 0.002, 0.014, 0.036, 0.067),
    ".ksplat": (0, 1e-6, 0.002, 0.007, 0, 0),
    ".sog": (4e-4, 0.04, 0.004, 0.03, 0.01, 0.01),
}


def forge() -> Any:
    return pytest.importorskip("gaussforge", reason="needs the extra gaussians").GaussForge()


def shown(count: int = 900, degree: int = 3) -> ibr.Gaussians:
    """Gaussians with colours that all formats can hold, some of them opaque or invisible."""
    thing, numbers = cloud(count, degree), np.arange(count) % 9
    opacities = np.where(numbers == 0, 1, np.where(numbers == 1, 0, thing.opacities))
    return like(thing, opacities=opacities, sh=np.clip(thing.sh, -0.9, 0.9) * np.float32(0.9))


def paired(one: ibr.Gaussians, other: ibr.Gaussians) -> ibr.Gaussians:
    """`other` in the order of `one`: some formats sort."""
    nearest = [int(np.square(other.means - mean).sum(axis=1).argmin()) for mean in one.means]
    assert sorted(nearest) == list(range(len(one)))
    return like(other, nearest)


@pytest.mark.parametrize("suffix", STEPS)
def test_a_format_keeps_what_it_can(tmp_path: Path, suffix: str):
    if suffix in BY_GAUSSFORGE:
        forge()
    thing, file = shown(), tmp_path / f"cloud{suffix}"
    if suffix == ".splat":
        with pytest.warns(UserWarning, match=r"harmonics beyond degree 0 are left out; \.splat cannot hold them"):
            thing.save(file)
    else:
        thing.save(file)
    found, (of_means, of_scales, of_opacities, *of_sh) = paired(thing, ibr.Gaussians.load(file)), STEPS[suffix]
    assert np.abs(found.means - thing.means).max() <= of_means
    assert np.abs(np.log(found.scales / thing.scales)).max() <= of_scales
    assert np.abs(found.opacities - thing.opacities).max() <= of_opacities
    assert np.abs((found.rotations * thing.rotations).sum(axis=1)).min() > 1 - 5e-5
    assert found.sh.shape == thing.sh.shape if of_sh[2] is not None else found.sh.shape[1] == 1
    for step, part in zip(of_sh, (slice(1), slice(1, 4), slice(4, 16)), strict=True):
        assert step is None or np.abs(found.sh[:, part] - thing.sh[:, part]).max() <= step
    same_degree = like(thing, sh=thing.sh[:, : found.sh.shape[1]])
    one, other = ibr.render(same_degree, camera()), ibr.render(found, camera())
    assert np.square(one.color.astype(float) - other.color).mean() < 255**2 / 10**3.4  # 34 dB


@pytest.mark.parametrize("suffix", [".compressed.ply", ".ksplat", *BY_GAUSSFORGE])
def test_flat_and_opaque_gaussians_survive(tmp_path: Path, suffix: str):
    """Scales of 0 become tiny ones."""
    if suffix in BY_GAUSSFORGE:
        forge()
    thing = ibr.Gaussians([[0, 0, 3]], [[0.5, 0.5, 0]], [[2, 0, 0, 0]], [1], colors=np.ones((1, 3)))
    thing.save(tmp_path / f"cloud{suffix}")
    found = ibr.Gaussians.load(tmp_path / f"cloud{suffix}")
    np.testing.assert_allclose(found.scales, [[0.5, 0.5, 0]], rtol=0.033, atol=5e-5)
    np.testing.assert_allclose(found.opacities, [1], atol=0.004)


def test_two_files_of_a_scene_show_one_picture():
    """SPZ and compressed PLY, made by other programs, of a scene; one has y up, the other y down."""
    forge()
    one, other = (ibr.Gaussians.load(shared(f"gaussians/biker.{name}")) for name in ("compressed.ply", "spz"))
    assert len(one) == len(other) == 152_746
    for eye in ((0, -1.6, -4), (3.5, -2.5, 0.5)):
        seen = ibr.Camera.look_at(eye, (0, -1.6, 0), (0, -1, 0), (320, 240), fov_y=60)
        a, b = ibr.render(one, seen), ibr.render(other, seen)
        front = np.maximum(a.alpha, b.alpha) > 1 / 255
        differences = np.abs(a.color.astype(float) - b.color)
        assert front.mean() > 0.05 and (differences.max(axis=2) <= 2).mean() > 0.99
        assert 10 * np.log10(255**2 / np.square(differences[front]).mean()) > 48
        upper, lower = a.alpha[:120].sum(axis=1), a.alpha[120:].sum(axis=1)
        assert np.flatnonzero(upper)[0] < 60 and lower.any()


def test_half_a_turn_takes_colours_along(tmp_path: Path):
    """Without the turn from y up to y down, a camera turned likewise sees the same colours."""
    thing, file = shown(), tmp_path / "cloud.spz"
    thing.save(file)
    (tmp_path / "up.ply").write_bytes(forge().convert(file.read_bytes(), "spz", "ply")["data"])
    upside_down = ibr.Camera(camera().K, camera().size, np.diag([1.0, -1, -1, 1]) @ camera().world_from_camera)
    one = ibr.render(ibr.Gaussians.load(file), camera())
    other = ibr.render(ibr.Gaussians.load(tmp_path / "up.ply"), upside_down)
    assert np.abs(one.color.astype(int) - other.color).max() <= 1 and one.valid.mean() > 0.5


def test_another_program_reads_compressed_ply(tmp_path: Path):
    thing, file = shown(600), tmp_path / "cloud.compressed.ply"
    thing.save(file)
    (tmp_path / "other.ply").write_bytes(forge().convert(file.read_bytes(), "compressed.ply", "ply")["data"])
    one, other = ibr.Gaussians.load(file), ibr.Gaussians.load(tmp_path / "other.ply")
    for name, step in (("means", 1e-6), ("scales", 1e-6), ("rotations", 1e-6), ("sh", 1e-5), ("opacities", 2e-3)):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), atol=step)


RNG = np.random.default_rng(0)
ROWS = {  # five Gaussians as other programs write them
    "means": RNG.uniform(-1, 1, (5, 3)).astype(np.float32),
    "scales": RNG.uniform(0.01, 0.1, (5, 3)).astype(np.float32),
    "rotations": RNG.normal(size=(5, 4)).astype(np.float32),
    "colors": RNG.integers(0, 256, (5, 4), dtype=np.uint8),
    "sh": RNG.uniform(-1, 1, (5, 8, 3)).astype(np.float32),
}


def same_rows(found: ibr.Gaussians, places: float, shapes: float, turns: float, harmonics: float = 0) -> None:
    np.testing.assert_allclose(found.means, ROWS["means"], atol=places)
    np.testing.assert_allclose(found.scales, ROWS["scales"], rtol=shapes)
    unit = ROWS["rotations"] / np.linalg.norm(ROWS["rotations"], axis=1, keepdims=True)
    assert np.abs((found.rotations * unit).sum(axis=1)).min() > 1 - turns
    colors = np.column_stack([0.5 + 0.28209479 * found.sh[:, 0], found.opacities])
    np.testing.assert_allclose(colors, ROWS["colors"] / 255, atol=1e-6)
    rest = found.sh[:, 1:]
    np.testing.assert_allclose(rest, ROWS["sh"][:, : rest.shape[1]], atol=harmonics)


def test_a_splat_file(tmp_path: Path):
    forge()
    unit = ROWS["rotations"] / np.linalg.norm(ROWS["rotations"], axis=1, keepdims=True)
    turned = np.rint(unit * 128 + 128).clip(0, 255).astype(np.uint8)
    rows = [ROWS[name].view(np.uint8) for name in ("means", "scales", "colors")]
    np.hstack([*rows, turned]).tofile(tmp_path / "cloud.splat")
    same_rows(ibr.Gaussians.load(tmp_path / "cloud.splat"), 0, 1e-6, 1e-4)


@pytest.mark.parametrize(
    ("level", "steps"), [(0, (0, 1e-6, 1e-6, 0)), (1, (1e-4, 1e-3, 1e-5, 1e-3)), (2, (1e-4, 1e-3, 1e-5, 0.006))]
)
def test_a_ksplat_file(tmp_path: Path, level: int, steps: tuple[float, ...]):
    """Two sections of different degrees; compressed positions are offsets of 16 bits from a bucket's centre."""
    header = bytearray(4096)
    struct.pack_into("<BBxxIIIIH", header, 0, 0, 1, 2, 2, 5, 5, level)
    sections, bodies = list[bytearray](), list[bytes]()
    for chosen, degree, count in ((slice(3), 2, 3), (slice(3, 5), 1, 2)):
        kind = "<f2" if level else "<f4"
        middle = np.array([0.1, 0.2, 0.3], np.float32)
        places = np.rint((ROWS["means"][chosen] - middle) / (5 / 2 / 32767) + 32767).astype("<u2")
        by_degree = [ROWS["sh"][chosen, first:last] for first, last in ((0, 3), (3, 8))[:degree]]
        sh = np.hstack([part.transpose(0, 2, 1).reshape(count, -1) for part in by_degree])
        columns = [places if level else ROWS["means"][chosen], *(ROWS[name][chosen].astype(kind) for name in SHAPE)]
        columns += [
            ROWS["colors"][chosen],
            np.rint((sh + 1.5) / 3 * 255).astype(np.uint8) if level == 2 else sh.astype(kind),
        ]
        body = np.hstack([np.ascontiguousarray(column).view(np.uint8) for column in columns]).tobytes()
        section, buckets = bytearray(1024), struct.pack("<I", count) + middle.tobytes() if level else b""
        many = (256, 1, 5, 12, 32767, len(body), 0, 1) if level else (0, 0, 0, 0, 0, len(body), 0, 0)
        struct.pack_into("<IIIIfHxxIIIIH", section, 0, count, count, *many, degree)
        sections.append(section)
        bodies.append(buckets + body)
    (tmp_path / "cloud.ksplat").write_bytes(b"".join([header, *sections, *bodies]))
    found = ibr.Gaussians.load(tmp_path / "cloud.ksplat")
    assert not found.sh[3:, 4:].any() and found.sh.shape == (5, 9, 3)
    whole = np.where(np.arange(9)[:, None] < 4, 1, (np.arange(5) < 3)[:, None, None])
    same_rows(like(found, sh=found.sh + (1 - whole) * np.pad(ROWS["sh"], ((0, 0), (1, 0), (0, 0)))), *steps)


SHAPE = ("scales", "rotations")


@pytest.mark.parametrize("suffix", STEPS)
def test_damaged_files_are_errors(tmp_path: Path, suffix: str):
    """Cut, overwritten and with wrong counts: an error of pyibr, or Gaussians; never a crash."""
    if suffix in BY_GAUSSFORGE:
        forge()
    file, rng = tmp_path / f"cloud{suffix}", np.random.default_rng(1)
    shown(60, 0 if suffix == ".splat" else 3).save(file)
    good, errors = file.read_bytes(), 0
    for number in range(12 if suffix in BY_GAUSSFORGE else 60):
        data, place = bytearray(good), int(rng.integers(len(good)))
        if number % 3 == 0:
            data = data[: place | 1]
        elif number % 3 == 1:
            data[place : place + 40] = rng.bytes(min(40, len(data) - place))
        else:
            place %= min(1200, len(data) - 4)
            data[place : place + 4] = b"\xff\xff\xff" + rng.bytes(1)
        file.write_bytes(data)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # some Gaussians are left out
            try:
                ibr.Gaussians.load(file)
            except ibr.FileFormatError as error:
                errors += 1
                assert str(file) in str(error)
    assert errors >= 4


def test_impossible_gaussians_are_left_out(tmp_path: Path):
    """A .ksplat file holds scales as they are, so they may be negative."""
    file = tmp_path / "cloud.ksplat"
    shown(60).save(file)
    data = bytearray(file.read_bytes())
    struct.pack_into("<f", data, 4096 + 1024 + 12, -0.1)
    file.write_bytes(data)
    with pytest.warns(UserWarning, match=r"left out: 1 Gaussians with values .* scales below 0"):
        assert len(ibr.Gaussians.load(file)) == 59


@pytest.mark.parametrize("count", [20_000_000, 4_000_000_000])
@pytest.mark.parametrize("suffix", [".ply", ".compressed.ply", ".spz", ".ksplat"])
def test_a_count_beyond_the_file_takes_no_memory(tmp_path: Path, suffix: str, count: int):
    file = tmp_path / f"cloud{suffix}"
    if suffix == ".spz":
        forge()
        head = struct.pack("<4sIIBBBB", b"NGSP", 3, count, 3, 12, 0, 0)
        file.write_bytes(gzip.compress(head + bytes(3000)))
    else:
        shown(60).save(file)
        data = bytearray(file.read_bytes())
        if suffix == ".ksplat":
            struct.pack_into("<II", data, 4096, count, count)
        else:
            data = data.replace(b"vertex 60", b"vertex %d" % count)
        file.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(ibr.FileFormatError):
        ibr.Gaussians.load(file)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 50_000  # kilobytes


def test_means_beyond_a_format_are_refused(tmp_path: Path):
    for suffix, most in ((".spz", 2047), (".sog", 1e8)):
        forge()
        thing, file = cloud(50), tmp_path / f"cloud{suffix}"
        like(thing, means=thing.means + np.float32(most * 0.99)).save(file)
        assert np.abs(ibr.Gaussians.load(file).means).max() > most * 0.98
        with pytest.raises(ibr.ArgumentError, match=rf"other than \{suffix}, which holds means up to"):
            like(thing, means=thing.means + np.float32(1.1 * most)).save(file)


def test_sections_of_ksplat_cannot_share_bytes(tmp_path: Path):
    """A short file whose many sections all describe the same bytes would fill the memory."""
    shown(600, 0).save(tmp_path / "cloud.ksplat")
    data = bytearray((tmp_path / "cloud.ksplat").read_bytes())
    section = bytearray(data[4096 : 4096 + 1024])
    struct.pack_into("<I", section, 4, 0)  # room
    struct.pack_into("<I", data, 4, 100)
    (tmp_path / "cloud.ksplat").write_bytes(data[:4096] + 100 * section + data[4096 + 1024 :])
    with pytest.raises(ibr.FileFormatError, match="600 Gaussians in room for 0"):
        ibr.Gaussians.load(tmp_path / "cloud.ksplat")


def test_only_properties_tell_a_cloud_from_a_mesh(tmp_path: Path):
    file = tmp_path / "mesh.ply"
    ibr.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).save(file)
    file.write_bytes(file.read_bytes().replace(b"\nelement", b"\ncomment f_dc_0 and packed_position\nelement", 1))
    assert len(ibr.Mesh.load(file).faces) == 1
    (tmp_path / "folder.splat").mkdir()
    with pytest.raises(ibr.FileFormatError, match="is a folder"):
        ibr.Gaussians.load(tmp_path / "folder.splat")
    with pytest.raises(ibr.FileFormatError, match="no such file"):
        ibr.read_color(tmp_path / "none.spz")


def test_mistakes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ibr.FileFormatError, match=r"ends in one of \.compressed\.ply, \.ply, \.splat, .* \.ply\.gz"):
        ibr.Gaussians.load(tmp_path / "cloud.obj")
    with pytest.raises(ibr.ArgumentError, match=r"path: expected a file that ends in one of \.compressed\.ply, \.ply"):
        cloud(3).save(tmp_path / "cloud.ply.gz")
    with pytest.raises(ibr.ArgumentError, match=r"other than \.sog for over 65536 Gaussians with harmonics beyond"):
        like(cloud(9, 1), np.zeros(65537, int)).save(tmp_path / "cloud.sog")
    cloud(3).save(tmp_path / "cloud.compressed.ply")
    for call in (ibr.Mesh.load, ibr.read_color, ibr.read_depth):
        with pytest.raises(
            ibr.FileFormatError, match=r"got 3D Gaussians: pyibr\.Gaussians\.load reads them, `pyibr orb"
        ):
            call(tmp_path / "cloud.compressed.ply")
    monkeypatch.setitem(sys.modules, "gaussforge", None)
    with pytest.raises(
        ibr.MissingPackageError, match=r"files need gaussforge.*: pip install 'pyibr-opencl\[gaussians\]'"
    ):
        cloud(3).save(tmp_path / "cloud.spz")
