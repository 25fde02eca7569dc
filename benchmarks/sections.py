"""The report's sections: one function a benchmark, which makes its plot and returns its Markdown."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from benchmarks import complexity, peers, plots, raster, relief, slicing, startup, table2
from benchmarks.depthmesh_section import depthmesh_section
from benchmarks.results import Record, Result
from benchmarks.statistics import Quartiles, exponent, median, number, ratios
from benchmarks.tables import only, position, sizes_of, table, totals, verdict

COMPLEXITY = """## Complexity

Sums over {positions} positions of the epipole. *Visited* counts the steps of the walks: source samples,
and for the sweep target pixels, too.

![Growth with the image's side](complexity.png)
"""

TABLE2 = """## The paper's table 2

Milliseconds a picture; reference images and picture have one size. The views stay prepared between pictures,
except where they are fresh.

![Table 2](table2.png)
"""

PEERS = """## Peers

From NumPy arrays to NumPy arrays, a fresh `DepthImage` each time, in turns in one process. The median
over {positions} positions in milliseconds, in brackets the median of the ratios to {base}.
cv2.registerDepth and Open3D deliver depth alone; Open3D's rays are made beforehand; cv2.remap (colour
and depth) is given the finished maps.

![Peers](peers.png)
"""

COVERAGE = """{ours} covers {covered:.1%} of the target, {base} {base_covered:.1%} (medians over all
cases); where both do, their depths differ by {difference:.2%} (median).
"""

RASTER = """## Triangles

Vertex colours, from NumPy arrays to NumPy arrays, in turns in one process with {peer} (Mesa's software OpenGL).

"""

SLICING = "## Slices\n"

OBJECTS = """### Objects

The paper's figure 12: the scanned dragon from six depth images of 512 x 512 fills the picture. A GeForce 2 GTS drew
{paper}. llvmpipe draws as many slices along the same edge of the box, as alpha-tested quadrilaterals, front to
back. *IoU* says how far the two pictures cover the same pixels; their slices lie half a spacing apart. Milliseconds
from NumPy arrays to NumPy arrays, in turns.

![Frames per second by size and slices](slicing-objects.png)
"""

AGAINST_MESH = """### The dragon beside its mesh

From three sides at 480 x 360, 256 slices: the silhouettes' intersection over union, and the colours where both are,
in dB. *Visible* and *naive* are the depth object's textures.
"""

DONUT = """### The donut

625 polygons, {slices} slices, {width} x {height} pixels. The paper's: {low:.0f} to {high:.0f} frames per second on the
GeForce 2 GTS.
"""

DIRECTIONS = """### Directions of slicing

The paper's figure 10 as numbers: a displaced polygon against rays cast at it, 3 pixels away from depth edges. Mean
depth error in slice spacings, and the largest share of the surface that is seen through. Slices along the surface lie
farther apart the more one looks along them; the others do not, and none is seen through.

![Error and see-through by the number of slices](slicing-error.png)
"""

RELIEF = """## Relief

800 x 600 pixels, a map of 256 x 256 bricks, from NumPy arrays to NumPy arrays, in turns. The paper's scenes ran at
{rate:.0f} frames per second on a GeForce 6800 GT, its monitor's rate.

### A plane that fills the picture

llvmpipe runs the same search as a fragment shader in GLSL. It filters 8-bit textures in 8 bits, so that a height
between two texels is rounded to 1/255, and rays meet the relief elsewhere; textures of floats it filters in float. The
bar is judged by the latter, which draws the same picture.

"""

RELIEF_SCENES = """### Scenes

Milliseconds, and frames per second in brackets. *Exact* is equation 6 for the distance to the quadric, the others are
equation 7. The factors are those of exact over approximate distances; the paper reports two. The room is several
reliefs with a light and its shadows, so that all of them are drawn twice; the other scenes have neither.
"""

RELIEF_STEPS = """### Steps

A map of bricks, and one of single texels that stand out, seen at 15 degrees: the share of pixels that see something
more than a texel behind what they should, the steps of a ray, halvings included, and the time.
"""

RELIEF_EMBREE = """### Beside ray casting of the displaced mesh

The torus. Memory is that of vertices, triangles and maps; beside the build, by how much the process grew with it.
"""

STARTUP = """## Start and memory

Each in processes of its own. A whole process counts from its start to its end, the interpreter included. The
second process finds its kernels built.
"""

MEMORY = """Memory in MiB. *Added* is the peak of the process's resident memory (VmHWM, set back just
before) less what the process held once a tiny warp was done and before the inputs were made: inputs,
outputs and everything else.
"""


def complexity_section(result: Result, folder: Path) -> list[str]:
    """Exponents, totals over the positions, and the log-log plot."""
    units = {"visited": "samples", "end to end": "ms"}
    every = {(m, q): totals(result.select(subject=m, quantity=q)) for q in units for m in ("epipolar", "search")}
    series = {key: values for key, values in every.items() if len(values) > 1}
    plots.complexity(series, folder / "complexity.png")
    rows: list[list[str]] = []
    for key, values in series.items():
        fitted = exponent(list(values), list(values.values()))
        bar = complexity.BARS.get(key)
        judged = ["", ""]
        if bar:
            shown = f"{bar[0]:g} to {bar[1]:g}" if bar[0] > 0 else f"at most {bar[1]:g}"
            judged = [shown, verdict(bar[0] <= fitted <= bar[1])]
        rows.append([*key, f"{min(values)} to {max(values)}", f"{fitted:.3f}", *judged])
    detail = [
        [str(n), *(number(values[n]) if n in values else "" for values in series.values())]
        for n in sizes_of(result.records)
    ]
    positions = len({position(record) for record in result.records})
    return [
        COMPLEXITY.format(positions=positions),
        table(["method", "quantity", "n", "exponent", "bar", ""], rows),
        table(["n", *(f"{method}: {quantity} ({units[quantity]})" for method, quantity in series)], detail),
    ]


def table2_section(result: Result, folder: Path) -> list[str]:
    """The paper's table with ours beside it."""
    subjects = [*table2.SUBJECTS, table2.FRESH]
    rows: list[list[str]] = []
    series: dict[str, dict[int, float]] = {}
    for model, figures in table2.PAPER.items():
        for n in sizes_of(result.select(model=model)):
            here = {"model": model, "size": n}
            times = {s: only(result.select(subject=s, quantity="end to end", **here)) for s in subjects}
            kernels = only(result.select(subject="nearest", quantity="kernels", **here))
            ours = series.setdefault(model, {})[n] = median(times["nearest"])
            paper = [number(figures[n]), f"{figures[n] / ours:.0f}"] if n in figures else ["", ""]
            cells = [str(Quartiles.of(times[s])) for s in subjects]
            rows.append(
                [
                    model,
                    str(table2.IMAGES[model]),
                    str(n),
                    paper[0],
                    *cells,
                    number(median(kernels)),
                    paper[1],
                ]
            )
    plots.table2(series, table2.PAPER, folder / "table2.png")
    heads = ["model", "images", "size", "R10000", *subjects, "nearest, kernels alone", "R10000 / nearest"]
    return [TABLE2, table(heads, rows)]


def peers_section(result: Result, folder: Path) -> list[str]:
    """Ratios to the base by size with their bars, then each position."""
    subjects = list(dict.fromkeys(record.subject for record in result.select(quantity="end to end")))
    sizes = sizes_of(result.records)
    times = {
        (s, n): {position(r): r.values for r in result.select(subject=s, size=n, quantity="end to end")}
        for n in sizes
        for s in subjects
    }
    medians = {key: {at: median(values) for at, values in found.items()} for key, found in times.items() if found}
    relative = {(s, n): ratios(found, medians[peers.BASE, n]) for (s, n), found in medians.items()}
    plots.peers(medians, relative, peers.BARS, folder / "peers.png")

    def summary(subject: str, n: int) -> str:
        if (subject, n) not in medians:
            return ""
        return f"{number(median(medians[subject, n].values()))} ({median(relative[subject, n]):.2f})"

    def kernels(subject: str, n: int) -> str:
        found = result.select(subject=subject, size=n, quantity="kernels")
        return number(median(median(record.values) for record in found))

    rows = [[subject, *(summary(subject, n) for n in sizes)] for subject in subjects]
    rows += [[f"{subject}, kernels alone", *(kernels(subject, n) for n in sizes)] for subject in peers.OURS]
    bars: list[list[str]] = []
    for (subject, n), bar in peers.BARS.items():
        if (subject, n) in relative:
            spread = Quartiles.of(relative[subject, n])
            bars.append([subject, str(n), str(spread), f"at most {bar:g}", verdict(spread.median <= bar)])
    parts = [
        PEERS.format(positions=len({position(r) for r in result.records}), base=peers.BASE),
        table(["", *map(str, sizes)], rows),
        table(["subject", "size", f"ratio to {peers.BASE}", "bar", ""], bars),
        _coverage(result),
    ]
    for n in sizes:
        here = [subject for subject in subjects if (subject, n) in medians]
        base = medians[peers.BASE, n]
        rows = [
            [*at, *(f"{Quartiles.of(times[s, n][at])} {medians[s, n][at] / base[at]:.2f}" for s in here)] for at in base
        ]
        parts.append(f"### {n} x {n}, by region and motion\n\nMilliseconds, and the ratio to {peers.BASE}.\n")
        parts.append(table(["region", "motion", *here], rows))
    return parts


def _coverage(result: Result) -> str:
    def middle(subject: str, quantity: str) -> float:
        return median(v for record in result.select(subject=subject, quantity=quantity) for v in record.values)

    return COVERAGE.format(
        ours=peers.NEAREST,
        covered=middle(peers.NEAREST, "coverage"),
        base=peers.BASE,
        base_covered=middle(peers.BASE, "coverage"),
        difference=middle(peers.BASE, "median depth difference"),
    )


def raster_section(result: Result, folder: Path) -> list[str]:
    """Times and ratios of each mesh, and how far the pictures agree."""
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
    """Figure 12, the donut, figure 10."""
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
            tests = only(result.select(subject=record.subject, quantity="alpha tests", case="donut"))[0]
            bar = slicing.BARS["donut"]
            judged = [f"at least {bar:g}", verdict(rate >= bar)] if record.subject == "orthogonal" else ["", ""]
            cells = [str(Quartiles.of(record.values)), f"{rate:.0f}", *judged, f"{tests / 1e6:.2f}"]
            rows.append([record.subject, *cells])
        parts.append(table(["slicing", "ms", "frames per second", "bar", "", "million alpha tests"], rows))
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


def relief_section(result: Result, folder: Path) -> list[str]:
    """The plane, the scenes, thin features, ray casting."""
    parts = [RELIEF.format(rate=relief.PAPER_RATE)]
    plane = {record.subject: record.values for record in result.select(case="plane", quantity="end to end")}
    same = {record.subject: record.values[0] for record in result.select(case="plane", unit="dB")}
    rows = []
    for subject, values in plane.items():
        cells = ["", "", ""]
        if subject in same:
            ratio = median(plane[relief.PLANE]) / median(values)
            cells[:2] = f"{ratio:.2f}", f"{same[subject]:.1f}"
            if subject == relief.PEER_FLOAT:
                met = ratio <= relief.BARS["plane"] and same[subject] > relief.BARS["same picture"]
                bars = f"at most {relief.BARS['plane']:g} at more than {relief.BARS['same picture']:g} dB"
                cells[2] = f"{bars}: {verdict(met)}"
        rows.append([subject, str(Quartiles.of(values)), *cells])
    parts.append(table(["", "ms", "linear over this", "PSNR between the two", "bar"], rows))
    scenes = list(dict.fromkeys(str(r.parameters["scene"]) for r in result.select(case="scene")))
    rows = []
    for name in scenes:
        times = {r.subject: median(r.values) for r in result.select(case="scene", scene=name, quantity="end to end")}
        triangles = only(result.select(case="scene", scene=name, quantity="triangles"))[0]
        covered = only(result.select(case="scene", scene=name, quantity="coverage"))[0]
        cells = [f"{number(value)} ({1000 / value:.0f})" for value in times.values()]
        factors = [f"{times[f'{search}, exact'] / times[search]:.1f}" for search in ("linear", "safe")]
        judged = ["", ""]
        if name in relief.BARRED_SCENES:
            judged = [f"at least {relief.PAPER_RATE:.0f}", verdict(1000 / times["linear"] >= relief.PAPER_RATE)]
        rows.append([name, f"{triangles:.0f}", f"{covered:.0%}", *cells, *factors, *judged])
    head = ["scene", "triangles", "covered", *relief.WAYS, "factor, linear", "factor, safe", "bar for linear", ""]
    parts += [RELIEF_SCENES, table(head, rows), RELIEF_STEPS, *_relief_steps(result)]
    rows = []
    for record in result.select(case="embree", quantity="end to end"):
        more = {r.quantity: r.values[0] for r in result.select(case="embree", subject=record.subject)}
        memory = number(more["memory"] / 2**20) if "memory" in more else ""
        triangles = f"{more['triangles']:.0f}" if "triangles" in more else ""
        rows.append([record.subject, str(Quartiles.of(record.values)), triangles, memory])
    shared = [r.values[0] for r in result.select(case="embree", quantity="silhouette (IoU)")]
    note = f"The silhouettes' intersection over union is {shared[0]:.3f}.\n" if shared else ""
    return [*parts, RELIEF_EMBREE, table(["", "ms", "triangles", "MiB"], rows), note]


def _relief_steps(result: Result) -> list[str]:
    """Linear against safe stepping on both maps, and where their errors are equal."""
    rows: list[list[str]] = []
    notes: list[str] = []
    for name in relief.MAPS:
        found = {
            quantity: {r.subject: median(r.values) for r in result.select(case="steps", map=name, quantity=quantity)}
            for quantity in ("missed", "steps", "end to end")
        }
        safe = f"{relief.SAFE_STEPS}"
        for subject, missed in found["missed"].items():
            search = "safe" if subject == safe else f"linear, {subject} steps"
            rows.append(
                [name, search, f"{missed:.2%}", f"{found['steps'][subject]:.1f}", number(found["end to end"][subject])]
            )
        equal = [subject for subject, missed in found["missed"].items() if subject != safe and missed <= relief.EQUAL]
        if equal:
            steps, time = (found[quantity][equal[0]] / found[quantity][safe] for quantity in ("steps", "end to end"))
            notes.append(
                f"On *{name}* even steps miss no more than {relief.EQUAL:.1%} from {equal[0]} on: {steps:.1f} times "
                f"the steps of the safe search, and {time:.1f} times its time.\n"
            )
        elif found["missed"]:
            notes.append(
                f"On *{name}* no number of even steps that was tried misses as little as {relief.EQUAL:.1%}.\n"
            )
    return [table(["map", "search", "missed", "steps a ray", "ms"], rows), *notes]


def startup_section(result: Result, folder: Path) -> list[str]:
    """Import, first frame, and memory, with their bars."""
    limits = {
        ("import pyibr", "import"): startup.BARS["import"],
        ("second process", "whole process"): startup.BARS["first frame"],
    }
    times: list[list[str]] = []
    kernels: list[list[str]] = []
    for record in result.select(unit="ms"):
        spread = Quartiles.of(record.values)
        row = [record.subject, record.quantity, str(spread)]
        if record.quantity in ("build", "load"):
            kernels.append(row)
            continue
        bar = limits.get((record.subject, record.quantity))
        times.append([*row, *([f"at most {bar:g}", verdict(spread.median <= bar)] if bar else ["", ""])])
    memory: list[list[str]] = []
    sizes = sizes_of(result.records)
    for n in sizes:
        size = {record.subject: record.values[0] / 2**20 for record in result.select(unit="bytes", size=n)}
        share, bar = only(result.select(subject="peak memory", size=n))[0], startup.BARS["peak memory"]
        judged = [f"at most {bar:g}", verdict(share <= bar)] if n == max(sizes) else ["", ""]
        cells = [number(size[what]) for what in ("inputs", "outputs", "added", "process")]
        memory.append([f"{n} x {n}", *cells, f"{share:.2f}", *judged])
    heads = ["warp", "inputs", "outputs", "added", "whole process", "added / (inputs + outputs)", "bar", ""]
    return [
        STARTUP,
        table(["", "", "ms", "bar", ""], times),
        table(["kernel", "", "ms"], kernels),
        MEMORY if memory else "",
        table(heads, memory),
    ]


SECTIONS = {
    "complexity": complexity_section,
    "table2": table2_section,
    "peers": peers_section,
    "raster": raster_section,
    "slicing": slicing_section,
    "relief": relief_section,
    "depthmesh": depthmesh_section,
    "startup": startup_section,
}
