"""The report's section on depth meshes and on simplification."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks import plots
from benchmarks.depthmesh import depthmesh, simplification
from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict

HEAD = "## Depth meshes\n"

CONSTRUCTION = """### Construction

As in table 1 of the paper, times are milliseconds for one depth image of 512 x 512. *Capture* makes the image: by ray
casting (Open3D) here, by rendering with OpenGL and reading the z-buffer in the paper. *Hierarchy* segments a view that
is on the device, and computes the normals, errors and bounding spheres of its quadtree. *Fresh view and hierarchy*
starts from a new `DepthImage`. The paper's female and male are other models.
"""

FRAMES = """### Frames

As in table 2 of the paper, three of six depth images of 512 x 512 are blended to a picture of the same size, which the
object fills. *Selection* and *frame* are times of whole calls, the other columns times of kernels. One kernel of pyibr
draws and blends depth and colours.
"""

QUALITY = """### Quality

Pictures from {count} random directions are compared with rays cast at the {model}. Cells show the mean, and the minimum
in brackets. PSNR (dB) and SSIM are computed for the pixels that all pictures cover.
"""

WARP = """### Comparison with the epipolar warp

Mesh and warp draw one depth image of the {model} from 15 degrees to its side, and are compared with ray casting. Errors
of colour and depth are computed for the pixels that all pictures cover; depth errors are relative to the {model}'s
largest extent. *Covered* counts a picture's pixels inside the true outline, *beside it* its pixels outside. Both counts
are relative to all pixels inside the true outline.
"""

MOVING = """### While the camera moves

A camera moves around the {model} in {frames} frames. The table shows mean milliseconds per frame, and the number of
frames for which triangles were chosen anew. With `reuse`, triangles are chosen finer than the tolerance requires, and
are drawn again while they meet it.
"""

SIMPLIFICATION = """### Simplification

The plot shows the number of triangles against the measured error: the largest vertical distance from a sample to the
mesh, found by casting rays. The nominal error is the argument that a library gets. pymartini's meshes keep it only at
the midpoints of their edges, meshes of pyibr and pydelatin at all samples.

![Triangles by measured error](depthmesh-simplification.png)
"""

TIMES = """Times are milliseconds, measured in turns; the nominal error is 30 m on the Fuji tile. *Triangles* returns
points and indices, as pymartini and pydelatin do; *simplify* makes a `Mesh` of them, with normals and uv. All other
calls start from a new `DepthImage`. *Hierarchy* also computes normals and bounding
spheres, which the triangles do not need.
"""

DECIMATION = """### Comparison with quadric decimation

Open3D decimates the full grid to pyibr's number of triangles. Errors are distances in depth from the samples to the
mesh; *missed* is the share of samples whose rays meet no triangle.
"""


def depthmesh_section(result: Result, folder: Path) -> list[str]:
    """Make the parts of the section, from the paper's two tables to decimation."""
    parts = [
        HEAD,
        *_construction(result),
        *_frames(result),
        *_quality(result),
        *_warp(result),
        *_moving(result),
        *_simplification(result, folder),
        *_decimation(result),
    ]
    return parts


def _names(result: Result, case: str, parameter: str) -> list[str]:
    return list(dict.fromkeys(str(record.parameters[parameter]) for record in result.select(case=case)))


def _construction(result: Result) -> list[str]:
    subjects = depthmesh.CAPTURE, depthmesh.HIERARCHY, depthmesh.FRESH
    rows: list[list[str]] = []
    for model in _names(result, "construction", "model"):
        here = {"case": "construction", "model": model}
        times = {record.subject: record.values for record in result.select(quantity="end to end", **here)}
        triangles = only(result.select(quantity="triangles", **here))[0]
        paper = depthmesh.PAPER_CONSTRUCTION.get(model)
        theirs = [f"{paper.render + paper.capture:g}", f"{paper.quadtree:g}"] if paper else ["", ""]
        if paper:
            theirs.append(f"{paper.quadtree / median(times[depthmesh.HIERARCHY]):.0f}")
        cells = [str(Quartiles.of(times[subject])) for subject in subjects]
        rows.append([model, f"{triangles:.0f}", *cells, *(theirs if paper else ["", "", ""])])
    heads = ["model", "triangles", *subjects, "paper: render and read", "paper: quadtree", "paper / hierarchy"]
    return [CONSTRUCTION, table(heads, rows)] if rows else []


def _frames(result: Result) -> list[str]:
    rows: list[list[str]] = []
    bars: list[list[str]] = []
    for record in result.select(case="frame", subject=depthmesh.FRAME, quantity="end to end"):
        here, frame = record.parameters, median(record.values)
        model, tolerance = str(here["model"]), float(here["tolerance"])
        selection = median(only(result.select(subject=depthmesh.SELECTION, quantity="end to end", **here)))
        kernels = [
            number(median(only(result.select(subject=stage, quantity="kernels", **here))))
            for stage in list(depthmesh.STAGES)[1:]
        ]
        triangles = only(result.select(subject=depthmesh.SELECTION, quantity="triangles", **here))[0]
        paper = depthmesh.PAPER_RENDERING.get(model)
        theirs = [""] * 6
        if paper and paper.tolerance == tolerance:
            stages = paper.selection, paper.depth, paper.color, paper.blend
            theirs = [f"{paper.triangles}", *(f"{stage:g}" for stage in stages), f"{paper.rate:g}"]
        ours = [
            f"{triangles:.0f}",
            number(selection),
            *kernels,
            str(Quartiles.of(record.values)),
            f"{1000 / frame:.0f}",
        ]
        rows.append([model, f"{tolerance:g}", *ours, *theirs])
        if model == "dragon" and tolerance == 1:
            most, least = depthmesh.BARS["selection"], depthmesh.BARS["rate"]
            bars = [
                ["selection", number(selection), f"at most {most:g} ms", verdict(selection <= most)],
                ["frames per second", f"{1000 / frame:.0f}", f"at least {least:g}", verdict(1000 / frame >= least)],
            ]
    heads = ["model", "tolerance", "triangles", *list(depthmesh.STAGES), "frame", "frames per second"]
    heads += [f"paper: {what}" for what in ("triangles", "selection", "depth", "colour", "blend", "frames per second")]
    return [FRAMES, table(heads, rows), table(["dragon, 1 pixel", "", "bar", ""], bars)] if rows else []


def _quality(result: Result) -> list[str]:
    records = list(result.select(case="quality", quantity="PSNR"))
    if not records:
        return []
    rows: list[list[str]] = []
    bars: list[list[str]] = []
    for projection in _names(result, "quality", "projection"):
        found: dict[tuple[str, str], list[float]] = {
            (record.subject, record.quantity): record.values
            for record in result.select(case="quality", projection=projection)
        }
        overlap = min(found["quality", "silhouette (IoU)"])
        mean = {key: float(np.mean(values)) for key, values in found.items()}
        for subject in (*depthmesh.BLENDS, depthmesh.FULL_GRID):
            cells = [
                f"{mean[subject, quantity]:.{digits}f} ({min(found[subject, quantity]):.{digits}f})"
                for quantity, digits in (("PSNR", 2), ("SSIM", 4), ("silhouette (IoU)", 4))
            ]
            rows.append([projection, subject, *cells])
        lost = mean[depthmesh.FULL_GRID, "PSNR"] - mean["quality", "PSNR"]
        best = all(mean["quality", q] >= mean[blend, q] for q in ("PSNR", "SSIM") for blend in depthmesh.BLENDS)
        least, most = depthmesh.BARS["overlap"], depthmesh.BARS["tolerance"]
        bars += [
            [projection, "least IoU", f"{overlap:.4f}", f"at least {least:g}", verdict(overlap >= least)],
            [projection, "1 pixel costs", f"{lost:.2f} dB", f"at most {most:g}", verdict(lost <= most)],
            [projection, "quality is best", "", "", verdict(best)],
        ]
    parts = [QUALITY.format(count=len(records[0].values), model=records[0].parameters["model"])]
    heads = ["views", "blend", "PSNR", "SSIM", "silhouette (IoU)"]
    return [*parts, table(heads, rows), table(["views", "", "", "bar", ""], bars)]


def _warp(result: Result) -> list[str]:
    rows: list[list[str]] = []
    for record in result.select(case="warp", quantity="end to end"):
        more = {r.quantity: r.values[0] for r in result.select(case="warp", subject=record.subject)}
        cells = [""] * 5
        if "PSNR" in more:
            shares = "median depth error", "depth off by over 1 %", "covered", "beside it"
            cells = [f"{more['PSNR']:.2f}", *(f"{more[share]:.3%}" for share in shares)]
        rows.append([record.subject, str(Quartiles.of(record.values)), *cells])
    heads = ["", "ms", "PSNR", "median depth error", "off by over 1 %", "covered", "beside it"]
    models = _names(result, "warp", "model")
    return [WARP.format(model=models[0]), table(heads, rows)] if models else []


def _moving(result: Result) -> list[str]:
    rows: list[list[str]] = []
    records = list(result.select(case="moving", quantity="end to end"))
    for record in records:
        here, frames = record.parameters, float(record.parameters["frames"])
        each = median(only(result.select(subject=depthmesh.ANEW, quantity="end to end", **here)))
        chosen = only(result.select(subject=record.subject, quantity="chosen", **here))[0]
        ratio = median(record.values) / each
        time = str(Quartiles.of([value / frames for value in record.values]))
        rows.append([str(here["thing"]), f"{here['degrees']:g}", record.subject, f"{chosen:.0f}", time, f"{ratio:.2f}"])
    if not rows:
        return []
    heads = ["", "degrees", "triangles", "chosen", "ms a frame", "ratio"]
    return [MOVING.format(**records[0].parameters), table(heads, rows)]


def _point(result: Result, record: Record) -> tuple[float, float, float]:
    """Look up the largest and the rms error of the mesh whose number of triangles a record holds; returns all three."""
    largest, rms = (
        only(result.select(subject=record.subject, quantity=quantity, **record.parameters))[0]
        for quantity in ("largest error", "rms error")
    )
    return largest, rms, record.values[0]


def _simplification(result: Result, folder: Path) -> list[str]:
    surfaces = _names(result, "errors", "surface")
    if not surfaces:
        return []
    series: dict[str, dict[str, list[tuple[float, float]]]] = {}
    parts: list[str] = []
    cases = "errors", simplification.MARTINI, simplification.DELATIN
    for surface in surfaces:
        rows: list[list[str]] = []
        timed: list[list[str]] = []
        for case in cases:
            records = list(result.select(case=case, surface=surface, quantity="end to end"))
            timed += [[record.subject, str(Quartiles.of(record.values))] for record in records]
            for record in result.select(case=case, surface=surface, quantity="triangles"):
                largest, rms, triangles = _point(result, record)
                error = float(record.parameters["error"])
                rows.append([record.subject, number(error), number(largest), number(rms), f"{triangles:.0f}"])
                if record.subject != simplification.SAME:
                    series.setdefault(surface, {}).setdefault(record.subject, []).append((largest, triangles))
        parts += [
            f"#### {surface}\n",
            table(["", "error", "measured", "rms", "triangles"], rows),
            table(["", "ms"], timed),
        ]
        if surface == "fuji":
            parts.append(table(["fuji", "ratio", "bar", ""], _bars(result)))
    plots.simplification(series, folder / "depthmesh-simplification.png")
    return [SIMPLIFICATION, TIMES, *parts]


def _bars(result: Result) -> list[list[str]]:
    """Rows of the table of bars, for the Fuji tile."""
    rows: list[list[str]] = []

    def judge(what: str, ratio: float, bar: float) -> None:
        rows.append([what, f"{ratio:.2f}", f"at most {bar:g}", verdict(ratio <= bar)])

    def found(case: str, subject: str, quantity: str) -> list[float]:
        records = result.select(case=case, surface="fuji", subject=subject, quantity=quantity)
        return [median(record.values) for record in records]

    martini = simplification.MARTINI
    if tile := found(martini, simplification.MARTINI_TILE, "end to end"):
        (ours,) = found(martini, simplification.HIERARCHY, "end to end")
        judge("hierarchy / pymartini's tile", ours / tile[0], simplification.BARS["hierarchy"])
        their = found(martini, martini, "triangles")
        same, nominal = (
            found(martini, simplification.SAME, "triangles"),
            found("errors", simplification.OURS, "triangles"),
        )
        worst = max(a / b for a, b in zip(same, their, strict=True))
        judge(
            "largest ratio of triangles to pymartini's, at its measured errors", worst, simplification.BARS["triangles"]
        )
        worst = max(a / b for a, b in zip(nominal, their, strict=True))
        rows.append(["the same ratio at pymartini's nominal errors, which its meshes exceed", f"{worst:.2f}", "", ""])
    if run := found(simplification.DELATIN, simplification.DELATIN, "end to end"):
        (ours,) = found(simplification.DELATIN, simplification.BOTH, "end to end")
        judge("time from depth image to triangles / pydelatin's time", ours / run[0], simplification.BARS["delatin"])
        (ours,) = found(simplification.DELATIN, simplification.WHOLE, "end to end")
        rows.append(
            ["time from depth image to `Mesh`, with normals and uv / pydelatin's time", f"{ours / run[0]:.2f}", "", ""]
        )
    return rows


def _decimation(result: Result) -> list[str]:
    rows: list[list[str]] = []
    for record in result.select(case=simplification.OPEN3D, quantity="triangles"):
        largest, rms, triangles = _point(result, record)
        missed = only(result.select(subject=record.subject, quantity="missed", **record.parameters))[0]
        where = [str(record.parameters["surface"]), number(float(record.parameters["error"])), record.subject]
        rows.append([*where, f"{triangles:.0f}", number(largest), number(rms), f"{missed:.2%}"])
    times = [
        [str(record.parameters["surface"]), record.subject, str(Quartiles.of(record.values))]
        for record in result.select(case=simplification.OPEN3D, quantity="end to end")
    ]
    heads = ["surface", "error", "", "triangles", "largest error", "rms error", "missed"]
    return [DECIMATION, table(heads, rows), table(["surface", "", "ms"], times)] if rows else []
