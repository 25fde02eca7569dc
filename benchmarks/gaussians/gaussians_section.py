"""The report's section on Gaussians."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from benchmarks.gaussians import gaussians as bench
from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict

GAUSSIANS = """## Gaussians

Made clouds are drawn at 640 x 480 pixels from cameras along a path: a *room* of flat Gaussians, a *cloud* of all
shapes, and a *photograph*, a flat Gaussian for each of its pixels. Times are milliseconds, from the cloud on the device
to NumPy arrays. *Processor* is the time of all cores together. The *first* picture is that of a new cloud, from NumPy
arrays, with the kernels built.
"""

LAVAPIPE = """### Beside Open3D on a software driver

Open3D draws the same PLY files by Vulkan on Mesa's lavapipe, in a process of its own. *Black tiles* is the number of
tiles of 16 x 16 pixels that are black at half of their pixels or more, but not in pyibr's picture. *Changed* is the
share of pixels that differ between its first two pictures, which have the same camera. *Difference* is the mean
difference from pyibr's colours, in levels of 255. Open3D leaves out Gaussians that cover more than 256 tiles, and cuts
each at 2.8 standard deviations.
"""

REFERENCE = """### Beside float64

The tests' reference blends Gaussian by Gaussian in NumPy. *Off* is the share of pixels of pyibr's picture whose colour
differs from it by more than a level of 255.
"""

PLANE = """### Depth

{count:,} flat Gaussians lie on a slanted plane that covers {covered:.0%} of the picture. *Near* is the share of these
pixels whose depth is within {near:.1%} of the plane's. Depth by centres comes from the reference.
"""


def gaussians_section(result: Result, _: Path) -> list[str]:
    """Make the tables of times, of the two peers, and of depth."""
    parts = [GAUSSIANS, _times(result)]
    if list(result.select(subject=bench.PEER)):
        parts += [LAVAPIPE, _lavapipe(result)]
    return [*parts, REFERENCE, _reference(result), *_plane(result)]


def _scenes(result: Result, subject: str, quantity: str) -> list[tuple[str, int]]:
    found = result.select(subject=subject, quantity=quantity, degree=0)
    return [(str(record.parameters["scene"]), int(record.parameters["gaussians"])) for record in found]


def _times(result: Result) -> str:
    rows: list[list[str]] = []
    for scene, size in _scenes(result, bench.OURS, bench.WALL):
        walls: list[float] = []
        for degree in bench.DEGREES:
            here = list(result.select(subject=bench.OURS, scene=scene, gaussians=size, degree=degree))
            found = {record.quantity: record.values for record in here}
            walls.append(median(found[bench.WALL]))
            rate, bar = 1000 / walls[-1], bench.RATES.get(size)
            judged = ["", ""] if bar is None else [f"at least {bar}", verdict(rate >= bar)]
            if degree:
                share = walls[-1] / walls[0]
                ratio = [f"{share:.2f}", f"at most {bench.DEGREE_BAR:g}", verdict(share <= bench.DEGREE_BAR)]
            else:
                ratio = ["", "", ""]
            cells = [str(Quartiles.of(found[quantity])) for quantity in (bench.WALL, bench.PROCESSOR)]
            first = number(median(found[bench.FIRST]))
            rows.append([scene, f"{size:,}", str(degree), *cells, first, f"{rate:.1f}", *judged, *ratio])
    heads = ["scene", "Gaussians", "degree", "ms", "processor", "first", "a second", "bar", "", "over degree 0"]
    return table([*heads, "bar", ""], rows)


def _lavapipe(result: Result) -> str:
    rows: list[list[str]] = []
    for scene, size in _scenes(result, bench.PEER, bench.WALL):
        ours, peers = (
            _quantities(result.select(subject=subject, scene=scene, gaussians=size, degree=0))
            for subject in (bench.OURS, bench.PEER)
        )
        share = median(ours[bench.PROCESSOR]) / median(peers[bench.PROCESSOR])
        judged = [f"{share:.3f}", f"at most {bench.PEER_BAR:g}", verdict(share <= bench.PEER_BAR)]
        times = [str(Quartiles.of(peers[quantity])) for quantity in (bench.WALL, bench.PROCESSOR)]
        black = ", ".join(f"{tiles:.0f}" for tiles in peers[bench.BLACK])
        shown = [black, f"{peers[bench.CHANGED][0]:.2%}", number(median(peers[bench.DIFFERENCE]))]
        rows.append([scene, f"{size:,}", *times, number(peers[bench.FIRST][0]), *judged, *shown])
    heads = ["scene", "Gaussians", "ms", "processor", "first", "pyibr's processor time / its", "bar", ""]
    return table([*heads, "black tiles", "changed", "difference"], rows)


def _quantities(records: Iterable[Record]) -> dict[str, list[float]]:
    return {record.quantity: record.values for record in records}


def _reference(result: Result) -> str:
    rows: list[list[str]] = []
    for scene, size in _scenes(result, bench.REFERENCE, bench.WALL):
        here = {"scene": scene, "gaussians": size, "degree": 0}
        (took,) = only(result.select(subject=bench.REFERENCE, **here))
        ours = median(only(result.select(subject=bench.OURS, quantity=bench.WALL, **here)))
        (off,) = only(result.select(quantity=bench.OFF, **here))
        rows.append([scene, f"{size:,}", f"{took:.0f}", f"{took / ours:.0f}", f"{off:.2%}"])
    return table(["scene", "Gaussians", "ms", "over pyibr's", "off"], rows)


def _plane(result: Result) -> list[str]:
    near = {record.subject: record for record in result.select(quantity=bench.NEAR)}
    parameters = near[bench.PLANES].parameters
    rows: list[list[str]] = []
    for subject, record in near.items():
        (last,) = only(result.select(scene="plane", subject=subject, quantity=bench.DIFFERENCE))
        met = verdict(record.values[0] >= bench.PLANE_BAR)
        judged = [f"at least {bench.PLANE_BAR:.0%}", met] if subject == bench.PLANES else ["", ""]
        rows.append([subject, f"{record.values[0]:.2%}", f"{last:.2%}", *judged])
    words = PLANE.format(count=parameters["gaussians"], covered=parameters["covered"], near=bench.NEAR_DEPTH)
    return [words, table(["depth", "near", "error of 99 % at most", "bar", ""], rows)]
