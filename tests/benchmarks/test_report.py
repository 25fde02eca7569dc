"""The benchmarks: their arithmetic, their files, reports of small results, and a complete quick run."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import pyibr as ibr
from benchmarks import llvmpipe, report, scenes, table2
from benchmarks.__main__ import APART, MODULES, main
from benchmarks.depthmesh import depthmesh, simplification
from benchmarks.launches import Visited, build_times, counted_samples, kernel_times
from benchmarks.results import Record, Result, Skip
from benchmarks.runner import in_turns
from benchmarks.statistics import Quartiles, exponent, ratios
from benchmarks.warp import opencv, peers
from pyibr.capture import capture, cube_cameras, models, object_views
from pyibr.opencl.device import current
from tests.capture.torus import torus
from tests.data import shared

ENVIRONMENT = {
    "time": "2026-01-01T00:00:00+00:00",
    "device": "a device",
    "device_reason": "the only cpu device that works",
    "platform": "a platform",
    "device_version": "OpenCL 3.0",
    "driver": "1.0",
    "cpu": "a processor",
    "cores": 2,
    "system": "a system",
    "python": "3.11.0",
    "versions": {"pyibr": "0.1.0", "open3d": None},
    "commit": None,
    "load_average": None,
}


def reported(result: Result, folder: Path) -> str:
    """Text of the report on a result."""
    result.save(folder / f"{result.benchmark}.json")
    return report.write(folder).read_text()


@pytest.mark.parametrize("power", [1.0, 2.0, 3.0])
def test_exponent_of_a_power_with_noise(power: float) -> None:
    sizes = [128, 256, 512, 1024]
    noise = np.random.default_rng(1).normal(0, 0.01, len(sizes))
    times = 7e-6 * np.power(sizes, power) * np.exp(noise)
    assert exponent(sizes, list(times)) == pytest.approx(power, abs=0.02)
    with pytest.raises(ValueError, match="two different"):
        exponent([128, 128], [1, 2])


def test_quartiles_and_ratios() -> None:
    assert Quartiles.of([4, 1, 3, 2, 5]) == Quartiles(2, 3, 4)
    assert ratios({"a": 2, "b": 3, "c": 5}, {"a": 4, "c": 10}) == [0.5, 0.5]


def test_turns_alternate_after_one_run_each_for_nothing() -> None:
    calls: list[str] = []
    times = in_turns({"a": lambda: calls.append("a"), "b": lambda: calls.append("b")}, repeats=2)
    assert "".join(calls) == "ababab"
    assert {name: len(values) for name, values in times.items()} == {"a": 2, "b": 2}


def test_the_report_is_of_one_commit() -> None:
    folder = Path(report.__file__).parent / "results" / ibr.__version__
    names = {"": set(MODULES) - set(APART), **{name: {name} for name in APART if name != "card"}}
    for place, expected in names.items():
        results = [Result.load(path) for path in (folder / place).glob("*.json")]
        assert {result.benchmark for result in results} == expected
        (commit,) = {result.environment["commit"] for result in results}
        assert commit and not commit.endswith("+"), "measured with uncommitted changes"


def test_result_survives_json(tmp_path: Path) -> None:
    parameters = {"size": 64, "region": "A"}
    records = [Record("a", "end to end", "ms", parameters, [1.5, 2]), Record("a", "visited", "samples", {}, [3])]
    result = Result("peers", ENVIRONMENT, records, [Skip("b", "it is not here")])
    result.save(tmp_path / "peers.json")
    assert Result.load(tmp_path / "peers.json") == result
    assert list(result.select(subject="a", region="A")) == records[:1]


@pytest.mark.thorough
def test_the_published_reports_are_those_of_their_results(tmp_path: Path) -> None:
    """Each version's folder has a report, and so has each folder of another machine's results in it."""
    published = Path(report.__file__).parent / "results" / ibr.__version__
    if not published.is_dir():  # a new version
        pytest.skip("no results of this version are here")
    for folder in {path.parent for path in published.rglob("*.json")}:
        copy = tmp_path / folder.name
        copy.mkdir()
        for path in folder.glob("*.json"):
            shutil.copy(path, copy)
        assert report.write(copy).read_text() == (folder / report.FILE).read_text()


@pytest.mark.parametrize("text", ["{", "{}", '{"schema": 0}', "[]"])
def test_files_of_another_kind_are_refused_by_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "peers.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"peers\.json: not a result"):
        Result.load(path)


def test_records_without_values_or_units_are_refused() -> None:
    for unit, values, said in (("ms", [], "at least one"), ("s", [1.0], "unit")):
        with pytest.raises(ValueError, match=said):
            Record("a", "end to end", unit, {}, values)


def canned_peers(nearest: float) -> Result:
    """A made-up result, two sizes: warpFrame takes 10 and 20 ms in two positions, pyibr ``nearest`` times as long."""
    records: list[Record] = []
    for n in (1024, 2048):
        for region, base in (("A", 10.0), ("E", 20.0)):
            parameters = {"size": n, "region": region, "motion": "forward"}
            factors = {peers.NEAREST: nearest, peers.LINEAR: 0.7, opencv.BASE: 1.0, opencv.REMAP: 0.3}
            for subject, factor in factors.items():
                values = [factor * base * f for f in (0.9, 1.0, 1.3)]
                records.append(Record(subject, "end to end", "ms", parameters, values))
            records += [Record(name, "kernels", "ms", parameters, [1.0]) for name in peers.OURS]
            records += [Record(name, "coverage", "share", parameters, [0.5]) for name in (peers.NEAREST, opencv.BASE)]
            records.append(Record(opencv.BASE, "median depth difference", "share", parameters, [0.5]))
    return Result("peers", ENVIRONMENT, records, [Skip("Open3D", "it is not installed")])


def test_report_says_which_bars_are_met(tmp_path: Path) -> None:
    text = reported(canned_peers(nearest=0.45), tmp_path)
    assert "| pyibr nearest | 1024 | cv2.warpFrame | 0.450 (0.450 to 0.450) | at most 0.55 | met |" in text
    assert "| pyibr nearest | 2048 | cv2.warpFrame | 0.450 (0.450 to 0.450) | at most 0.35 | **not met** |" in text
    assert "| pyibr nearest | 1024 | cv2.remap | 1.50 (1.50 to 1.50) | at most 1.7 | met |" in text
    assert "| pyibr linear | 2048 | cv2.remap | 2.33 (2.33 to 2.33) | at most 1.7 | **not met** |" in text
    assert "Left out: Open3D, because it is not installed." in text
    assert (tmp_path / "peers.png").stat().st_size > 5000


def test_report_of_nothing_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="none of"):
        report.write(tmp_path)


@pytest.mark.parametrize("motion", scenes.MOTIONS)
@pytest.mark.parametrize("region", scenes.REGIONS)
def test_epipoles_lie_where_they_should_and_the_relief_is_seen(region: str, motion: str) -> None:
    n = 64
    source, target = scenes.source_camera(n), scenes.target_camera(n, region, motion)
    u, v, w = target.K @ target.camera_from_world[:3, 3]
    column, row = (sum(at > end for end in (0, n - 1)) for at in (u / w, v / w))
    assert scenes.REGIONS[3 * row + column] == region
    assert (w > 0) == (motion == "backward")
    np.testing.assert_array_equal(source.K, target.K)
    assert ibr.warp(scenes.view(n), target).valid.mean() > 0.6


def test_counted_samples_do_not_depend_on_luck() -> None:
    view, target = scenes.view(48), scenes.target_camera(48, "F", "forward")
    counts: dict[str, list[dict[str, Visited]]] = {"search": [], "epipolar": []}
    for method, runs in counts.items():
        for _ in range(2):
            with counted_samples() as found:
                ibr.warp(view, target, method=method, edges="connect")  # pyright: ignore[reportArgumentType]
            runs.append(dict(found))
        assert runs[0] == runs[1]
    search, epipolar = counts["search"][0], counts["epipolar"][0]
    assert set(search) == {"search", "resolve"} and set(epipolar) == {"epipolar_sweep", "resolve"}
    assert search["resolve"] == Visited(0, 0)  # the search leaves no pixel to `resolve`
    # The sweep visits each pixel about once; the search visits, for each pixel, all samples along its ray.
    sweep = epipolar["epipolar_sweep"]
    assert 48 * 48 / 2 < sweep.pixels < 3 * 48 * 48
    assert sweep.samples < search["search"].samples / 5


def test_what_resolve_traces_is_counted() -> None:
    n = 48
    target = scenes.target_camera(n, "F", "forward")
    traced: list[int] = []
    for surface in (scenes.relief, scenes.white_noise):
        with counted_samples() as found:
            frame = ibr.warp(ibr.DepthImage(*surface(n), scenes.source_camera(n)), target, edges="connect")
        assert frame.valid.mean() > 0.9
        assert found["resolve"].pixels <= n * n
        assert found["resolve"].samples >= found["resolve"].pixels  # each traced pixel visits a cell or more
        traced.append(found["resolve"].pixels)
    # On a smooth surface, most pixels take what their lines hit; in noise, most are traced.
    assert traced[0] < 0.2 * n * n < 0.5 * n * n < traced[1]


def test_launches_are_seen_by_name() -> None:
    view, target = scenes.view(32), scenes.target_camera(32, "F", "forward")
    with kernel_times() as times:
        ibr.warp(view, target)
    assert set(times) == {"find_noise", "prepare", "clear", "epipolar_sweep", "draw_patches", "resolve"}
    with build_times() as built:
        ibr.warp(view, target)
    assert set(built) == {"clear", "epipolar_sweep", "draw_patches", "resolve"}
    with pytest.raises(RuntimeError, match="neither a sweep nor a search"), counted_samples():
        pass


@pytest.mark.thorough
@pytest.mark.parametrize("name", table2.PAPER)
def test_the_pictures_of_table_2_are_right(name: str) -> None:
    mesh = "dragon_vrip_res3.ply.gz"
    if name == "dragon":
        shared(f"meshes/{mesh}")
    pytest.importorskip("open3d", exc_type=ImportError)
    model = table2.made(name, 96, mesh)
    assert isinstance(model, table2.Model)
    assert len(model.views) == table2.IMAGES[name]
    assert model.covers.sum() > 1000
    for sample in table2.SUBJECTS.values():
        for fresh in (False, True):
            found = table2.rightness(model.picture(sample, fresh), model.truth, model.covers)
            assert all(found[quantity] <= bar for quantity, bar in table2.RIGHT.items()), found


def test_pictures_that_are_not_right_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wrong pictures show the torus without its inner wall, with its upper part missing, or too far away."""
    pytest.importorskip("open3d", exc_type=ImportError)
    coarse = torus()
    monkeypatch.setattr(models, "torus_mesh", lambda: coarse)
    model = table2.made("torus", 96, "")
    assert isinstance(model, table2.Model)
    outer = [capture(coarse, camera, layer="last") for camera in cube_cameras((0, 0, 0), 96)]
    hollow = ibr.warp(outer, model.camera, side="both", edges="connect")
    assert table2.rightness(hollow, model.truth, model.covers)[table2.OFF] > 0.15
    frame = model.picture("linear")
    left = frame.valid.copy()
    left[:48] = False
    missing = table2.rightness(ibr.Frame(frame.color, frame.depth, left, model.camera), model.truth, model.covers)
    assert missing[table2.UNCOVERED] == pytest.approx(model.covers[:48].sum() / model.covers.sum(), abs=0.02)
    depth = frame.depth * np.float32(1.025)
    away = table2.rightness(ibr.Frame(frame.color, depth, frame.valid, model.camera), model.truth, model.covers)
    assert away[table2.OFF] > 0.95


def test_a_row_of_table_2_says_whether_its_picture_is_right(tmp_path: Path) -> None:
    parameters = {"model": "torus", "size": 128}
    times = [Record(name, "end to end", "ms", parameters, [4.0]) for name in (*table2.SUBJECTS, table2.FRESH)]
    times.append(Record("nearest", "kernels", "ms", parameters, [3.0]))
    for shares, told in (
        ([0.004, 0.011], "| 0.40% | 1.10% | at most 1%, at most 2% | met |"),
        ([0.209, 0.0003], "| 20.90% | 0.03% | at most 1%, at most 2% | **not met** |"),
        ([], "|  |  |  | **not measured** |"),
    ):
        pairs = zip(table2.RIGHT, shares, strict=False)
        right = [Record("nearest", quantity, "share", parameters, [share]) for quantity, share in pairs]
        assert told in reported(Result("table2", ENVIRONMENT, [*times, *right]), tmp_path)


def test_the_depth_mesh_papers_stages_make_its_frame_rates() -> None:
    for row in depthmesh.PAPER_RENDERING.values():
        stages = row.selection + row.depth + row.color + row.blend
        assert stages < 1000 / row.rate < stages + 5  # ms; the paper's frames take longer than its stages


@pytest.mark.parametrize("projection", ["perspective", "orthographic"])
def test_departures_are_measured_in_depth_at_the_samples(projection: str) -> None:
    pytest.importorskip("open3d", exc_type=ImportError)
    n = 9
    camera = ibr.Camera([[8, 0, 4], [0, 8, 4], [0, 0, 1]], (n, n), projection=projection)  # pyright: ignore[reportArgumentType]
    depth = np.full((n, n), 3, np.float32)
    depth[4, 4], depth[0, 0] = 2.75, np.inf
    view = ibr.DepthImage(np.zeros((n, n, 3), np.uint8), depth, camera)
    corners = camera.unproject([[0, 0], [n - 1, 0], [n - 1, n - 1], [0, n - 1]], np.full(4, 3))
    off = simplification.departures(view, corners, np.array([[0, 1, 2], [0, 2, 3]]))
    assert len(off) == n * n - 1
    assert off.max() == pytest.approx(0.25, abs=1e-5)  # float32 rays
    assert np.count_nonzero(off > 1e-5) == 1
    half = simplification.departures(view, corners, np.array([[0, 1, 2]]))
    assert np.count_nonzero(np.isinf(half)) == n * (n - 1) // 2


HEADINGS = (
    "## Complexity; ## The paper's table 2; ## Peers; ## Real RGB-D; ### White noise; ### Stereo; ### A light field; "
    "### Small images; ### Published figures of others; ### Real RGB-D, 64 x 48; ## Depth edges; ## Triangles; "
    "## Slices; ## Relief; ## Depth meshes; ### Construction; ### Frames; ### Quality; "
    "### Comparison with the epipolar warp; ### Simplification; ### Comparison with quadric decimation; "
    "## Start and memory"
)


@pytest.mark.thorough
def test_everything_runs_quickly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("open3d", exc_type=ImportError)
    monkeypatch.setenv("PYIBR_DATA", str(tmp_path))
    main(quick=True, out=tmp_path / "out")
    text = (tmp_path / "out/report.md").read_text()
    headings = [*HEADINGS.split("; ")]
    headings += ["### Threads"] if "Portable" in current().device.platform else []  # others hide their threads
    headings += ["## Pages in the browser"] if find_spec("viser") else []
    headings += ["## On GPUs"] if shutil.which("oclgrind") else []
    assert [heading for heading in headings if heading not in text] == []
    assert "Left out: dragon, because dragon_vrip_res3.ply.gz is not in $PYIBR_DATA/meshes." in text
    plots = {"complexity", "table2", "peers", "rgbd", "slicing-error", "displaced", "depthmesh-simplification"}
    assert {path.stem for path in (tmp_path / "out").glob("*.png")} == plots
    # The report depends on nothing except the files.
    (tmp_path / "out/report.md").unlink()
    assert report.write(tmp_path / "out").read_text() == text


def test_pictures_of_llvmpipe_keep_their_own_textures() -> None:
    """The pictures of an object and of its hull are both prepared before either is drawn."""
    if isinstance(gl := llvmpipe.context(), str):
        pytest.skip(gl)
    pytest.importorskip("open3d")
    views = object_views(models.donut(), 96)
    things = [ibr.DepthObject(views, slices=48), ibr.VisualHull(views, slices=48)]
    camera = ibr.Camera.look_at((1.5, -2, 2.5), (0, 0, 0), (0, 0, 1), (120, 90), fov_y=45)
    pictures = [llvmpipe.slices(camera, thing, 1.0, 6.0) for thing in things]
    for thing, picture in zip(things, pictures, strict=True):
        ours, theirs = ibr.render(thing, camera).valid, np.isfinite(picture.picture()[1])
        # The two renderers' slices are half a spacing apart: outlines may differ by one of 48 slices.
        assert (ours & theirs).sum() / (ours | theirs).sum() >= 0.96
