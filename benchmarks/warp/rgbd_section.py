"""The report's section on depth cameras."""

from __future__ import annotations

from pathlib import Path

from benchmarks import plots
from benchmarks.results import Parameter, Record, Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict
from benchmarks.warp import rgbd, rgbd_uses, steady
from benchmarks.warp.opencv import BASE, REGISTER, REMAP
from benchmarks.warp.rgbd import LINEAR, MOTIONS, OURS

RGBD = """## Real RGB-D

Frames of the scene *{scenes}* are warped; their camera has a field of view of 63 by 49 degrees. The target is another
frame's camera (34 degrees and 0.7 m away, or 3 degrees and 0.1 m), or a camera 7 cm to the side. Larger sizes are
scaled from 640 x 480, and cropped to the middle for 16:9. Noise is like a structured-light camera's with a baseline of
7.5 cm: its standard deviation is given in pixels of disparity, and noisy disparity is rounded to 1/8 pixel.

Times run from NumPy arrays to NumPy arrays, with a new `DepthImage` for each call, in turns in one process. Surfaces
are cut at depth edges, except in *connected*. {register} returns only depth; {remap} moves colour and depth by finished
maps.

![Ratio to {base} by noise and size](rgbd.png)
"""

RATIOS = """Cells show the ratio of a subject's time to {base}'s time, as a mean over the motions. Where it is above 1,
{base} is faster. The bars are for {linear}.
"""

WORST = """The largest ratio: {subject}, {size}, {noise} pixels of noise, {kind}, {motion}: **{ratio:.2f} times** the
time of {base}. {slower} of {count} rows of pyibr are slower than {base}.
"""

COVERAGE = """{ours} covers {covered:.1%} of the target, {base} {base_covered:.1%} (medians over all cases); where both
cover it, their depths differ by {difference:.2%} (median).
"""

THREADS = """### Threads

Times are milliseconds of the kernels of *{linear}* from frame 0 to frame 50, in processes of one and of two threads, in
turns.
"""

NOISE = """### White noise

Times are milliseconds of the kernel `resolve`, on a smooth surface and on white noise, in turns. `resolve` traces a
pixel again if the hit of its epipolar line is not the pixel's hit. With `connect`, the depths are white noise in the
smooth surface's range. With `cut`, noise of a tenth of this range is added to the smooth surface, so that the surface
is not cut everywhere.
"""

STEREO = """### Stereo

One call draws the pictures of both eyes, 3.2 cm to the left and right, from one new image with depth, and fills holes.
Times are milliseconds per pair.
"""

LIGHT_FIELD = """### A light field

The pictures of a light field display are drawn for cameras on a line of {width:g} cm. Times are milliseconds for all
pictures, in one call and in single warps. *Fresh*: each call gets a new view; *kept*: all calls use the same view.
"""

TOGETHER = """### Several views in one picture

Views whose cameras are {step:g} mm apart are blended to one picture; for comparison, each view is warped to a picture
of its own. Times are milliseconds for all views. *Fresh* views must be copied to the device, and their exposures be
matched; *kept* views need neither.
"""

TOLD = """### Origins and classes of pixels

Times are milliseconds of a plain warp, of a warp that also returns each pixel's position in the source (`origins`), and
of a warp that also classifies the pixels (`classes`), in turns. *Fresh* warps get a new view, *kept* warps the same
view. The relief is that of *Peers*, with the epipole in region F. The shelf is a raw RealSense frame, which lacks two
thirds of its samples.
"""

SMALL = """### Small images

Times are milliseconds of a warp of an image so small that its kernels take almost no time.
"""

STEADY = """### Steady over time

A camera at rest takes {frames} frames, each with different noise: {noise:g} pixels of disparity, {lost:.0%} of the
samples missing, {color:g} levels of colour. All are warped. Cells show a pixel's standard deviation over the frames, in
millimetres of depth and levels of 255 of colour: the mean over pixels that a warp without noise covers, and the mean
over its filled holes. The bar: the warps deviate no more than the input.
"""

PUBLISHED = """### Published figures of others

**These figures were published by others, for other machines and inputs; they were not measured here.** RVS blends four
views.
"""


_KINDS = (steady.DEPTH, steady.COLOR)


def rgbd_section(result: Result, folder: Path) -> list[str]:
    """Make the tables of ratios with their bars, of the uses, and of all rows."""
    rows = _Rows(result)
    uses = [*_threads(result), *_noise(result), *_stereo(result), *_light_field(result)]
    uses += [*_together(result), *_told(result), *_small(result)]
    uses += _steady(result)
    parts = [PUBLISHED, table(["program", "task", "time", "machine", "source"], [_cells(p) for p in rgbd.PUBLISHED])]
    if not rows.found:
        return [RGBD.split("\n", 1)[0] + "\n", *uses, *parts]
    measured = {key: rows.ratios(LINEAR, *key) for key in rows.groups}
    plots.rgbd(measured, rgbd.BARS, BASE, folder / "rgbd.png")
    scenes = " and ".join(dict.fromkeys(str(record.parameters["scene"]) for record in result.select(case="warp")))
    return [
        RGBD.format(scenes=scenes, register=REGISTER, remap=REMAP, base=BASE),
        rows.worst(),
        RATIOS.format(base=BASE, linear=LINEAR),
        rows.summary(),
        _coverage(result),
        *uses,
        *parts,
        *rows.details(),
    ]


class _Rows:
    """The timed warps, in groups by kind of motion, size and noise; a group has one row per motion."""

    def __init__(self, result: Result) -> None:
        self.result = result
        self.found: dict[tuple[str, str, float, str], dict[str, list[float]]] = {}
        for record in result.select(case="warp", quantity="end to end"):
            at = record.parameters
            key = str(at["kind"]), str(at["size"]), float(at["noise"]), str(at["motion"])
            self.found.setdefault(key, {})[record.subject] = record.values
        groups = dict.fromkeys(key[:3] for key in self.found)
        self.groups = sorted(groups, key=lambda group: list(MOTIONS).index(group[0]))

    def ratios(self, subject: str, kind: str, size: str, noise: float) -> list[float]:
        """Ratios to cv2.warpFrame, by motion; empty if the subject was not timed."""
        rows = [self.found[key] for motion in MOTIONS[kind] if (key := (kind, size, noise, motion)) in self.found]
        return [median(row[subject]) / median(row[BASE]) for row in rows if subject in row]

    def summary(self) -> str:
        """Table of mean ratios over the motions, with the bars."""
        others = [subject for subject in (*OURS, REGISTER, REMAP) if subject != LINEAR]
        lines: list[list[str]] = []
        for group in self.groups:
            kind, size, noise = group
            means = {subject: self.ratios(subject, *group) for subject in (LINEAR, *others)}
            cells = {subject: f"{sum(r) / len(r):.2f}" if r else "" for subject, r in means.items()}
            bar, judged = rgbd.BARS.get(group), ["", ""]
            if bar is not None:
                judged = [f"at most {bar:g}", verdict(sum(means[LINEAR]) / len(means[LINEAR]) <= bar)]
            lines.append([kind, size, f"{noise:g}", cells[LINEAR], *judged, *(cells[subject] for subject in others)])
        return table(["motion", "size", "noise", LINEAR, "bar", "", *others], lines)

    def worst(self) -> str:
        """Sentences on the largest ratio of any subject of pyibr, size, noise and motion."""
        ratios = {
            (subject, key): median(row[subject]) / median(row[BASE])
            for key, row in self.found.items()
            for subject in OURS
            if subject in row
        }
        (subject, (kind, size, noise, motion)), ratio = max(ratios.items(), key=lambda item: item[1])
        return WORST.format(
            subject=subject,
            size=size,
            noise=f"{noise:g}",
            kind=kind,
            motion=motion,
            ratio=ratio,
            base=BASE,
            slower=sum(ratio > 1 for ratio in ratios.values()),
            count=len(ratios),
        )

    def details(self) -> list[str]:
        """Tables of all rows, one per size."""
        parts: list[str] = []
        for size in dict.fromkeys(size for _, size, _, _ in self.found):
            here = {key: row for key, row in self.found.items() if key[1] == size}
            subjects = list(dict.fromkeys(subject for row in here.values() for subject in row))
            lines = [self._line(key, row, subjects) for key, row in here.items()]
            parts.append(f"### Real RGB-D, {size}\n\nCells show milliseconds, and the ratio to {BASE}.\n")
            parts.append(table(["noise", "motion", *subjects, f"{LINEAR}, kernels alone"], lines))
        return parts

    def _line(self, key: tuple[str, str, float, str], row: dict[str, list[float]], subjects: list[str]) -> list[str]:
        kind, size, noise, motion = key
        base = median(row[BASE])
        cells = [f"{Quartiles.of(row[s])} {median(row[s]) / base:.2f}" if s in row else "" for s in subjects]
        here: dict[str, Parameter] = {"kind": kind, "size": size, "noise": noise, "motion": motion}
        kernels = only(self.result.select(case="warp", subject=LINEAR, quantity="kernels", **here))
        return [f"{noise:g}", f"{kind}, {motion}", *cells, number(median(kernels))]


def _cells(figure: rgbd.Published) -> list[str]:
    return [figure.program, figure.task, figure.time, figure.machine, figure.source]


def _coverage(result: Result) -> str:
    def middle(subject: str, quantity: str) -> float:
        found = result.select(case="warp", subject=subject, quantity=quantity)
        return median(value for record in found for value in record.values)

    ours, base = middle(rgbd.NEAREST, "coverage"), middle(BASE, "coverage")
    difference = middle(BASE, "median depth difference")
    return COVERAGE.format(ours=rgbd.NEAREST, covered=ours, base=BASE, base_covered=base, difference=difference)


def _by(result: Result, *names: str, **wanted: Parameter) -> dict[tuple[Parameter, ...], list[Record]]:
    """Group records by the values of some of their parameters, in the order of measurement."""
    found: dict[tuple[Parameter, ...], list[Record]] = {}
    for record in result.select(**wanted):
        found.setdefault(tuple(record.parameters[name] for name in names), []).append(record)
    return found


def _threads(result: Result) -> list[str]:
    one, two = rgbd_uses.THREADS
    lines: list[list[str]] = []
    for (size, noise), records in _by(result, "size", "noise", case="threads").items():
        times = {(int(r.parameters["threads"]), r.subject): r.values for r in records}
        kernels = list(dict.fromkeys(kernel for _, kernel in times))
        sums = {count: sum(median(times[count, kernel]) for kernel in kernels) for count in (one, two)}
        for kernel in kernels:
            a, b = times[one, kernel], times[two, kernel]
            ratio = f"{median(a) / median(b):.2f}"
            lines.append([str(size), f"{noise:g}", kernel, str(Quartiles.of(a)), str(Quartiles.of(b)), ratio, "", ""])
        ratio, bar = sums[one] / sums[two], rgbd_uses.BARS["threads"]
        judged = [f"{ratio:.2f}", f"at least {bar:g}", verdict(ratio >= bar)]
        lines.append([str(size), f"{noise:g}", "all", number(sums[one]), number(sums[two]), *judged])
    heads = ["size", "noise", "kernel", "1 thread", "2 threads", "ratio", "bar", ""]
    return [THREADS.format(linear=LINEAR), table(heads, lines)] if lines else []


def _noise(result: Result) -> list[str]:
    lines: list[list[str]] = []
    bar = rgbd_uses.BARS["noise"]
    for (size, edges), records in _by(result, "size", "edges", case="white noise").items():
        found = {(r.subject, r.quantity): r.values for r in records}
        cells: list[str] = []
        for subject in (rgbd_uses.SMOOTH, rgbd_uses.NOISE):
            cells += [str(Quartiles.of(found[subject, "resolve"])), f"{found[subject, 'coverage'][0]:.1%}"]
        ratio = median(found[rgbd_uses.NOISE, "resolve"]) / median(found[rgbd_uses.SMOOTH, "resolve"])
        lines.append([str(size), str(edges), *cells, f"{ratio:.2f}", f"at most {bar:g}", verdict(ratio <= bar)])
    heads = ["size", "edges", rgbd_uses.SMOOTH, "covers", rgbd_uses.NOISE, "covers", "ratio", "bar", ""]
    return [NOISE, table(heads, lines)] if lines else []


def _stereo(result: Result) -> list[str]:
    lines: list[list[str]] = []
    bar = rgbd_uses.BARS["stereo"]
    for record in result.select(case="stereo", quantity="end to end"):
        rate = 1000 / median(record.values)
        at = record.parameters
        judged = [f"{rate:.0f}", f"at least {bar:g}", verdict(rate >= bar)]
        lines.append([str(at["size"]), f"{at['noise']:g}", record.subject, str(Quartiles.of(record.values)), *judged])
    heads = ["size", "noise", "edges", "ms", "pairs a second", "bar", ""]
    return [STEREO, table(heads, lines)] if lines else []


def _light_field(result: Result) -> list[str]:
    lines: list[list[str]] = []
    bar = rgbd_uses.BARS["light field"]
    found = _by(result, "size", "views", "view", case="light field", quantity="end to end")
    for (size, views, view), records in found.items():
        times = {record.subject: record.values for record in records}
        one, single = times[rgbd_uses.ONE_CALL], times[rgbd_uses.SINGLE]
        ratio = median(one) / median(single)
        judged = [
            f"{ratio:.2f}",
            *([f"at most {bar:g}", verdict(ratio <= bar)] if view == rgbd_uses.FRESH else ["", ""]),
        ]
        lines.append([str(size), str(views), str(view), str(Quartiles.of(one)), str(Quartiles.of(single)), *judged])
    heads = ["size", "views", "view", rgbd_uses.ONE_CALL, rgbd_uses.SINGLE, "ratio", "bar", ""]
    width = 100 * rgbd_uses.LIGHT_FIELD_WIDTH
    return [LIGHT_FIELD.format(width=width), table(heads, lines)] if lines else []


def _together(result: Result) -> list[str]:
    lines: list[list[str]] = []
    bar = rgbd_uses.BARS["together"]
    found = _by(result, "size", "views", "view", case="together", quantity="end to end")
    for (size, views, view), records in found.items():
        times = {record.subject: record.values for record in records}
        together, single = times[rgbd_uses.TOGETHER], times[rgbd_uses.SINGLE]
        ratio = median(together) / median(single)
        is_judged = view == rgbd_uses.KEPT and int(views) <= rgbd_uses.TOGETHER_HELD
        judged = [f"at most {bar:g}", verdict(ratio <= bar)] if is_judged else ["", ""]
        shown = [str(Quartiles.of(together)), str(Quartiles.of(single)), f"{ratio:.2f}"]
        lines.append([str(size), str(views), str(view), *shown, *judged])
    heads = ["size", "views", "view", rgbd_uses.TOGETHER, rgbd_uses.SINGLE, "ratio", "bar", ""]
    return [TOGETHER.format(step=1000 * rgbd_uses.TOGETHER_STEP), table(heads, lines)] if lines else []


def _told(result: Result) -> list[str]:
    lines: list[list[str]] = []
    found = _by(result, "size", "motion", "view", case="told", quantity="end to end")
    for (size, motion, view), records in found.items():
        times = {record.subject: record.values for record in records}
        plain = times[rgbd_uses.PLAIN]
        for subject, values in times.items():
            judged = ["", "", ""]
            if subject in rgbd_uses.BARS:
                ratio, bar = median(values) / median(plain), rgbd_uses.BARS[subject]
                judged = [f"{ratio:.2f}", f"at most {bar:g}", verdict(ratio <= bar)]
            lines.append([str(size), str(motion), str(view), subject, str(Quartiles.of(values)), *judged])
    heads = ["size", "motion", "view", "told", "ms", "ratio", "bar", ""]
    return [TOLD, table(heads, lines)] if lines else []


def _small(result: Result) -> list[str]:
    lines: list[list[str]] = []
    bar = rgbd_uses.BARS["small"]
    for record in result.select(case="small", quantity="end to end"):
        judged = [f"at most {bar:g}", verdict(median(record.values) <= bar)]
        fresh = record.subject == rgbd_uses.FRESH
        row = [str(record.parameters["size"]), record.subject, str(Quartiles.of(record.values))]
        lines.append([*row, *(judged if fresh else ["", ""])])
    return [SMALL, table(["size", "view", "ms", "bar", ""], lines)] if lines else []


def _steady(result: Result) -> list[str]:
    lines: list[list[str]] = []
    frames = 0
    for (size, motion), records in _by(result, "size", "motion", case="steady").items():
        frames = int(records[0].parameters["frames"])
        found = {(r.subject, r.parameters["fill"], r.parameters["where"], r.quantity): r.values[0] for r in records}
        most = [found[steady.INPUT, "", steady.INPUT, quantity] for quantity in (steady.DEPTH, steady.COLOR)]
        lines.append([str(size), str(motion), "", steady.INPUT, *_levels(most), "", "", ""])
        for fill in steady.FILLS:
            for subject in (steady.RAW, steady.SINGLE, steady.STEADY):
                values = [
                    [found[key] if (key := (subject, fill, where, quantity)) in found else 0.0 for quantity in _KINDS]
                    for where in (steady.SEEN, steady.HOLES)
                ]
                met = all(value <= bar for part in values for value, bar in zip(part, most, strict=True))
                judged = verdict(met) if subject == steady.STEADY else ""
                lines.append(["", "", fill, subject, *_levels(values[0]), *_levels(values[1]), judged])
    heads = ["size", "motion", "fill", "depth", "seen: mm", "levels", "holes: mm", "levels", "bar"]
    noise = {"noise": steady.NOISE, "lost": steady.LOST, "color": steady.COLOR_NOISE}
    return [STEADY.format(frames=frames, **noise), table(heads, lines)] if lines else []


def _levels(deviations: list[float]) -> list[str]:
    """Format deviations of depth (scene units, as millimetres) and of colour (shares, as levels of 255)."""
    return [number(1000 * deviations[0]), number(255 * deviations[1])]
