"""The report's sections on triangles and on slicing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks import plots
from benchmarks.raster import raster
from benchmarks.results import Record, Result
from benchmarks.slicing import slicing
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict

RASTER = """## Triangles

Meshes with vertex colours are drawn by pyibr and by {peer} (Mesa's software OpenGL), in turns in one process. Times run
from NumPy arrays to NumPy arrays.

"""

SLICING = "## Slices\n"

OBJECTS = """### Objects

As in the paper's figure 12, an object fills the picture: here the scanned dragon, from six depth images of 512 x 512.
The paper's GeForce 2 GTS drew {paper}. llvmpipe draws as many slices as pyibr, across the same edge of the box, as
quadrilaterals from front to back; it discards fragments outside the object. *IoU* is the overlap of both pictures; it
is below 1, because their slices lie half a spacing apart. Times are milliseconds from NumPy arrays to NumPy arrays, in
turns.

![Frames per second by size and slices](slicing-objects.png)
"""

AGAINST_MESH = """### The dragon compared with its mesh

Pictures of 480 x 360 with 256 slices, from three sides, are compared with rays cast at the mesh: by the silhouettes'
intersection over union, and by the PSNR of colours in the intersection, in dB. *Visible* and *naive* are the depth
object's kinds of texture.
"""

DONUT = """### The donut

Fur on a donut of 625 polygons is drawn with {slices} slices, at {width} x {height}. The paper reports {low:.0f} to
{high:.0f} frames per second on the GeForce 2 GTS. Memory is that of vertices, triangles and heights, without colours.
"""

DIRECTIONS = """### Directions of slicing

The paper's figure 10 shows a displaced polygon; here its pictures are compared with rays cast at it, at least 3 pixels
from depth edges. The table gives the mean depth error, in slice spacings, and the largest share of the surface that
shows gaps. *Surface* slices are parallel to the polygon: in oblique views they lie far apart on a viewing ray. Slices
in the other directions do not, and have no gaps.

![Error and see-through by the number of slices](slicing-error.png)
"""


def raster_section(result: Result, folder: Path) -> list[str]:
    """Table of times, ratios, and the agreement of the pictures, for each mesh."""
    rows: list[list[str]] = []
    for record in result.select(subject=raster.OURS, quantity="end to end"):
        here = record.parameters

        def one(subject: str, quantity: str, here: dict[str, Any] = here) -> list[float]:
            return only(result.select(subject=subject, quantity=quantity, **here))

        ratio = median(record.values) / median(one(raster.PEER, "end to end"))
        bar = raster.BARS.get((str(here["mesh"]), int(here["size"])))
        rows.append(
            [
                str(here["mesh"]),
                f"{one(raster.OURS, 'triangles')[0]:.0f}",
                str(here["size"]),
                str(Quartiles.of(record.values)),
                number(median(one(raster.OURS, "kernels"))),
                *(str(Quartiles.of(one(subject, "end to end"))) for subject in (raster.PEER, raster.UNREAD)),
                f"{ratio:.2f}",
                *([f"at most {bar:g}", verdict(ratio <= bar)] if bar else ["", ""]),
                f"{one(raster.OURS, 'pixels that only one covers')[0]:.3%}",
                f"{one(raster.OURS, 'pixels of equal colour')[0]:.2%}",
            ]
        )
    heads = ["mesh", "triangles", "size", raster.OURS, "kernels alone", raster.PEER, raster.UNREAD, "ratio", "bar", ""]
    return [RASTER.format(peer=raster.PEER), table([*heads, "only one covers", "equal colour"], rows)]


def slicing_section(result: Result, folder: Path) -> list[str]:
    """Make the parts on objects (figure 12), the donut, and directions of slicing (figure 10)."""
    parts = [SLICING]
    rows: list[list[str]] = []
    objects = [record for record in result.select(case="object", quantity="end to end")]
    if objects:
        parts += _objects(result, objects, folder)
    beside = {r.subject: r for r in result.select(case="mesh", unit="dB")}
    if beside:
        rows = []
        for name, record in beside.items():
            same = only(result.select(case="mesh", subject=name, quantity="silhouette (IoU)"))
            rows.append([name, number(min(same)), f"{min(record.values):.1f}", f"{max(record.values):.1f}"])
        parts += [AGAINST_MESH, table(["", "least IoU", "PSNR from", "to"], rows)]
    donut = list(result.select(case="donut", quantity="end to end"))
    if donut:
        width, height = slicing.DONUT_SIZE
        low, high = slicing.PAPER_DONUT
        parts.append(DONUT.format(slices=slicing.DONUT_SLICES, width=width, height=height, low=low, high=high))
        rows = []
        for record in donut:
            rate = 1000 / median(record.values)
            more = {r.quantity: r.values[0] for r in result.select(subject=record.subject, case="donut")}
            bar = slicing.BARS["donut"]
            judged = [f"at least {bar:g}", verdict(rate >= bar)] if record.subject == "orthogonal" else ["", ""]
            tests = f"{more['alpha tests'] / 1e6:.2f}" if "alpha tests" in more else ""
            memory = number(more["memory"] / 2**20) if "memory" in more else ""
            rows.append([record.subject, str(Quartiles.of(record.values)), f"{rate:.0f}", *judged, tests, memory])
        parts.append(table(["slicing", "ms", "frames per second", "bar", "", "million alpha tests", "MiB"], rows))
    if any(result.select(case="directions")):
        parts += _directions(result, folder)
    return parts


def _objects(result: Result, records: list[Record], folder: Path) -> list[str]:
    subjects = list(dict.fromkeys(record.subject for record in records))
    at_slices, at_size = slicing.BAR_AT[1], slicing.BAR_AT[0]

    def series(subject: str, fixed: str, value: int, free: str) -> dict[int, float]:
        found = {
            int(record.parameters[free]): median(record.values)
            for record in records
            if record.subject == subject and record.parameters[fixed] == value
        }
        return dict(sorted(found.items()))

    plots.objects(
        {subject: series(subject, "slices", at_slices, "size") for subject in subjects},
        {subject: series(subject, "size", at_size, "slices") for subject in subjects},
        slicing.PAPER,
        folder / "slicing-objects.png",
    )
    rows: list[list[str]] = []
    for here in dict.fromkeys((int(r.parameters["size"]), int(r.parameters["slices"])) for r in records):
        at: dict[str, Any] = {"case": "object", "size": here[0], "slices": here[1]}
        cells: list[str] = []
        for subject in (slicing.OBJECT, slicing.HULL):
            ours, peer = (
                median(only(result.select(subject=s, quantity="end to end", **at)))
                for s in (subject, slicing.PEER[subject])
            )
            same = only(result.select(subject=subject, quantity="agreement with llvmpipe (IoU)", **at))[0]
            ratio = f"{ours / peer:.2f}"
            if subject == slicing.OBJECT and here == slicing.BAR_AT:
                ratio += f" (at most {slicing.BARS['object']:g}: {verdict(ours / peer <= slicing.BARS['object'])})"
            cells += [number(ours), number(peer), ratio, f"{same:.3f}"]
        paper = slicing.PAPER.get(here)
        rows.append([str(here[0]), str(here[1]), *cells, number(1000 / paper) if paper else ""])
    heads = ["size", "slices"]
    for subject in (slicing.OBJECT, slicing.HULL):
        heads += [subject, "llvmpipe", "ratio", "IoU"]
    figures = ", ".join(
        f"{rate:g} frames per second at {n} x {n}, {k} slices" for (n, k), rate in slicing.PAPER.items()
    )
    return [OBJECTS.format(paper=figures), table([*heads, "GeForce 2: depth object"], rows)]


def _directions(result: Result, folder: Path) -> list[str]:
    def values(quantity: str, slicing_: str, elevation: int) -> dict[int, float]:
        found = result.select(case="directions", quantity=quantity, subject=slicing_, elevation=elevation)
        return {int(record.parameters["slices"]): record.values[0] for record in found}

    here = list(result.select(case="directions"))
    elevations = sorted({int(record.parameters["elevation"]) for record in here})
    error = {s: {e: values("depth error", s, e) for e in elevations} for s in slicing.DIRECTIONS}
    through: dict[str, dict[int, float]] = {}
    for name in slicing.DIRECTIONS:
        shares = [values("seen through", name, e) for e in elevations]
        through[name] = {n: max(share[n] for share in shares) for n in shares[0]}
    counts = sorted(next(iter(through.values())))
    scaled = {s: {e: {n: v / n for n, v in row.items()} for e, row in rows.items()} for s, rows in error.items()}
    plots.directions(scaled, through, folder / "slicing-error.png")
    rows = [
        [name, f"{elevation}", *(number(by[elevation][n]) for n in counts)]
        for name, by in error.items()
        for elevation in elevations
    ]
    seen = [[name, "seen through", *(f"{share[n]:.2%}" for n in counts)] for name, share in through.items()]
    return [DIRECTIONS, table(["slicing", "elevation", *(f"{n} slices" for n in counts)], [*rows, *seen])]
