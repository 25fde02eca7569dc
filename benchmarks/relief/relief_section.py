"""The report's section on relief mapping."""

from __future__ import annotations

from pathlib import Path

from benchmarks.relief import relief
from benchmarks.results import Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict

RELIEF = """## Relief

Pictures have 800 x 600 pixels; the map shows bricks, and has 256 x 256 texels. Times run from NumPy arrays to NumPy
arrays, measured in turns. The paper reports {rate:.0f} frames per second on a GeForce 6800 GT: its monitor's rate.

### A plane that fills the picture

llvmpipe runs the linear search as a fragment shader. It filters 8-bit textures in 8 bits: interpolated heights are
rounded to 1/255, so that rays meet the relief at other points. With float textures it filters in float, and draws the
same picture as pyibr; the bar compares with this time.

"""

RELIEF_SCENES = """### Scenes

Cells show milliseconds, and frames per second in brackets. With *exact* distances, the default, each ray is followed
through the prisms below the mesh's triangles. The other ways approximate where a ray leaves the relief: by a distance
along the normal (equation 7), or at right angles to the ray (equation 6). The first
two factors divide the time with exact distances by the time with approximate ones. The third divides the time with
equation 6 by the time with equation 7 (the paper reports a factor of two). The room has several reliefs, lit
with shadows. Its shadow map is kept while only the camera moves; when the light moves, all reliefs are drawn twice. The
other scenes have no light.
"""

RELIEF_STEPS = """### Steps

Two maps are seen at 15 degrees: *bricks*, and *thin*, in which single texels and rows stand out. *Missed* is the share
of pixels whose depth is more than a texel too large. Steps include bisections.
"""


def relief_section(result: Result, folder: Path) -> list[str]:
    """Make the parts on the plane, the scenes, and numbers of steps."""
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
        cells = [f"{number(times[way])} ({1000 / times[way]:.0f})" if way in times else "" for way in relief.WAYS]
        factors = [f"{times[f'{search}, exact'] / times[search]:.1f}" for search in ("linear", "safe")]
        sixth = times.get("linear, equation 6")
        factors.append(f"{sixth / times['linear']:.1f}" if sixth else "")
        judged = ["", ""]
        if name in relief.SCENE_BARS:
            way, rate = relief.SCENE_BARS[name]
            judged = [f"{way}: at least {rate:.0f}", verdict(1000 / times[way] >= rate)]
        rows.append([name, f"{triangles:.0f}", f"{covered:.0%}", *cells, *factors, *judged])
    head = [
        "scene",
        "triangles",
        "covered",
        *relief.WAYS,
        "factor, linear",
        "factor, safe",
        "equation 6",
        "bar, a second",
        "",
    ]
    return [*parts, RELIEF_SCENES, table(head, rows), RELIEF_STEPS, *_relief_steps(result)]


def _relief_steps(result: Result) -> list[str]:
    """Table of both searches on both maps, and how many steps the linear search needs to miss at most `EQUAL`."""
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
                f"On *{name}*, the linear search misses at most {relief.EQUAL:.1%} with {equal[0]} steps. These are "
                f"{steps:.1f} times the steps of the safe search, and take {time:.1f} times its time.\n"
            )
        elif found["missed"]:
            notes.append(
                f"On *{name}*, the linear search misses over {relief.EQUAL:.1%} with all tested numbers of steps.\n"
            )
    return [table(["map", "search", "missed", "steps a ray", "ms"], rows), *notes]
