"""The report's sections: one function per benchmark, which makes its plot and returns its Markdown."""

from __future__ import annotations

from pathlib import Path

from benchmarks import plots, startup, table2
from benchmarks.app.pages_section import pages_section
from benchmarks.cleaning.cleaning_section import cleaning_section
from benchmarks.depthmesh.depthmesh_section import depthmesh_section
from benchmarks.displaced_section import displaced_section
from benchmarks.gaussians.gaussians_section import gaussians_section
from benchmarks.gpu.gpu_section import card_section, gpu_section
from benchmarks.relief.relief_section import relief_section
from benchmarks.results import Parameter, Result
from benchmarks.runtimes.runtimes_section import runtimes_section
from benchmarks.slicing.slicing_section import raster_section, slicing_section
from benchmarks.statistics import Quartiles, exponent, median, number, ratios
from benchmarks.tables import only, position, sizes_of, table, totals, verdict
from benchmarks.warp import complexity, peers
from benchmarks.warp.edges_section import edges_section
from benchmarks.warp.filling_section import filling_section
from benchmarks.warp.opencv import BASE, REMAP
from benchmarks.warp.registration_section import registration_section
from benchmarks.warp.rgbd_section import rgbd_section

COMPLEXITY = """## Complexity

Values are sums over {positions} positions of the epipole. *Visited* is the number of samples of the source and pixels
of the target that a call steps through: in the sweep or search, and where `resolve` traces a pixel again. Lanes step
in packets; all lanes of a packet count as many steps as the slowest. *White noise* is a surface without cuts and with
random depths. Its steps have no bar: these images are too small to show O(n^2) (see the manual, theory/warp).

![Growth with the image's side](complexity.png)
"""

TABLE2 = """## The paper's table 2

Times are milliseconds per picture; views and picture have the same size. Views are prepared before the first picture;
*fresh views* are prepared again for each. The true depth comes from rays cast at the model. *Off* is the share of a
picture's valid pixels whose depth is off by more than 2 %; *uncovered* is the share of the model's pixels that it
does not show.

![Table 2](table2.png)
"""

PEERS = """## Peers

Times run from NumPy arrays to NumPy arrays, with a new `DepthImage` for each call. All subjects are timed in turns in
one process. A cell shows the median time over {positions} positions of the epipole, in milliseconds, and in brackets
the median ratio to the time of {base}. cv2.registerDepth and Open3D return only depth. Times leave out the making of
Open3D's rays and of the maps by which cv2.remap moves colour and depth.

![Peers](peers.png)
"""

COVERAGE = """{ours} covers {covered:.1%} of the target, {base} {base_covered:.1%} (medians over all
cases); where both cover it, their depths differ by {difference:.2%} (median).
"""

STARTUP = """## Start and memory

Each measurement starts new processes. A *whole process* is timed from its start to its end, including the interpreter.
The first process builds its kernels; the *second process* loads them from the cache.
"""

MEMORY = """Memory is in MiB. *Added* is the peak of the process's resident memory (VmHWM) during the warp, minus its
memory after a tiny warp, before the inputs were made. It includes inputs and outputs.
"""


def complexity_section(result: Result, folder: Path) -> list[str]:
    """Tables of exponents and of totals over the positions, and the log-log plot."""
    units = {"visited": "samples", "end to end": "ms"}
    subjects = complexity.SUBJECTS
    every = {(m, q): totals(result.select(subject=m, quantity=q)) for q in units for m in subjects}
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
        table(["subject", "quantity", "n", "exponent", "bar", ""], rows),
        table(["n", *(f"{subject}: {quantity} ({units[quantity]})" for subject, quantity in series)], detail),
    ]


def table2_section(result: Result, folder: Path) -> list[str]:
    """Table of the paper's times and ours, and its plot."""
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
                    *_rightness(result, here),
                ]
            )
    plots.table2(series, table2.PAPER, folder / "table2.png")
    heads = ["model", "images", "size", "R10000", *subjects, "nearest, kernels alone", "R10000 / nearest"]
    return [TABLE2, table([*heads, *table2.RIGHT, "bars", ""], rows)]


def _rightness(result: Result, here: dict[str, Parameter]) -> list[str]:
    """Cells of a table's row: fractions of wrong and uncovered pixels, their bars, and the verdict."""
    found = {name: list(result.select(subject="nearest", quantity=name, **here)) for name in table2.RIGHT}
    if not all(found.values()):
        return [*("" for _ in found), "", "**not measured**"]
    shares = {name: only(records)[0] for name, records in found.items()}
    met = all(shares[name] <= bar for name, bar in table2.RIGHT.items())
    bars = ", ".join(f"at most {bar:.0%}" for bar in table2.RIGHT.values())
    return [*(f"{share:.2%}" for share in shares.values()), bars, verdict(met)]


def peers_section(result: Result, folder: Path) -> list[str]:
    """Tables of times and ratios by size, of the bars, and of each position."""
    subjects = list(dict.fromkeys(record.subject for record in result.select(quantity="end to end")))
    sizes = sizes_of(result.records)
    times = {
        (s, n): {position(r): r.values for r in result.select(subject=s, size=n, quantity="end to end")}
        for n in sizes
        for s in subjects
    }
    medians = {key: {at: median(values) for at, values in found.items()} for key, found in times.items() if found}
    relative = {(s, n): ratios(found, medians[BASE, n]) for (s, n), found in medians.items()}
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
    bars = [
        [subject, str(n), BASE, *_judged(relative[subject, n], bar)]
        for (subject, n), bar in peers.BARS.items()
        if (subject, n) in relative
    ]
    bars += [
        [subject, str(n), REMAP, *_judged(ratios(medians[subject, n], medians[REMAP, n]), peers.REMAP_BAR)]
        for subject, n in medians
        if subject in peers.OURS and n >= peers.REMAP_FROM and (REMAP, n) in medians
    ]
    parts = [
        PEERS.format(positions=len({position(r) for r in result.records}), base=BASE),
        table(["", *map(str, sizes)], rows),
        table(["subject", "size", "compared with", "ratio", "bar", ""], bars),
        _coverage(result),
    ]
    for n in sizes:
        here = [subject for subject in subjects if (subject, n) in medians]
        base = medians[BASE, n]
        rows = [
            [*at, *(f"{Quartiles.of(times[s, n][at])} {medians[s, n][at] / base[at]:.2f}" for s in here)] for at in base
        ]
        parts.append(f"### {n} x {n}, by region and motion\n\nCells show milliseconds, and the ratio to {BASE}.\n")
        parts.append(table(["region", "motion", *here], rows))
    return parts


def _judged(found: list[float], bar: float) -> list[str]:
    """Cells with the quartiles of ratios, the bar for the median, and whether it is met."""
    spread = Quartiles.of(found)
    return [str(spread), f"at most {bar:g}", verdict(spread.median <= bar)]


def _coverage(result: Result) -> str:
    def middle(subject: str, quantity: str) -> float:
        return median(v for record in result.select(subject=subject, quantity=quantity) for v in record.values)

    return COVERAGE.format(
        ours=peers.NEAREST,
        covered=middle(peers.NEAREST, "coverage"),
        base=BASE,
        base_covered=middle(BASE, "coverage"),
        difference=middle(BASE, "median depth difference"),
    )


def startup_section(result: Result, folder: Path) -> list[str]:
    """Tables of times and memory, with their bars."""
    limits = {
        ("import pyibr", "import"): startup.BARS["import"],
        ("second process", "import to frame"): startup.BARS["first frame"],
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
    "rgbd": rgbd_section,
    "filling": filling_section,
    "edges": edges_section,
    "registration": registration_section,
    "cleaning": cleaning_section,
    "raster": raster_section,
    "slicing": slicing_section,
    "relief": relief_section,
    "displaced": displaced_section,
    "depthmesh": depthmesh_section,
    "gaussians": gaussians_section,
    "runtimes": runtimes_section,
    "pages": pages_section,
    "startup": startup_section,
    "gpu": gpu_section,
    "card": card_section,
}
