"""The report's section on relief mapping."""

from __future__ import annotations

from pathlib import Path

from benchmarks.relief import relief
from benchmarks.results import Result
from benchmarks.statistics import Quartiles, median, number
from benchmarks.tables import only, table, verdict

RELIEF = """## Relief

800 x 600 pixels, a map of 256 x 256 bricks, from NumPy arrays to NumPy arrays, in turns. The paper's scenes ran at
{rate:.0f} frames per second on a GeForce 6800 GT, its monitor's rate.

### A plane that fills the picture

llvmpipe runs the same search as a fragment shader in GLSL. It filters 8-bit textures in 8 bits, so that a height
between two texels is rounded to 1/255, and rays meet the relief elsewhere; textures of floats it filters in float. The
bar is judged by the latter, which draws the same picture.

"""

RELIEF_SCENES = """### Scenes

Milliseconds, and frames per second in brackets. *Exact*, the default, measures below the mesh itself, the others along
the normal (equation 7), or at right angles to the ray (equation 6). The factors are those of exact over approximate
distances, and of equation 6 over equation 7, for which the paper reports two. The room is several reliefs with a light
and its shadows, whose map is kept while the camera alone moves; where the light moves, all of them are drawn twice. The
other scenes have no light.
"""

RELIEF_STEPS = """### Steps

A map of bricks, and one of single texels that stand out, seen at 15 degrees: the share of pixels that see something
more than a texel behind what they should, the steps of a ray, halvings included, and the time.
"""

RELIEF_EMBREE = """### Beside the displaced mesh

The torus, cast at by Embree, two triangles a texel, and drawn by pyibr's own rasteriser, each triangle of the base cut
into several. Memory is that of vertices, triangles and maps, without colours; beside the build, by how much the
process grew with it. IoU and the depth's error (the median, of the relief's depth) are against what Embree sees.

A mesh is nearer to the truth in depth and outline, and takes many times the memory: its cost grows with its triangles,
a relief's with the picture's pixels. A coarse one costs less than exact distances, and more than the linear search. A
relief needs no cutting, so that other tiles, scales and maps are there at once, and far away its maps are filtered,
where a mesh's triangles become smaller than pixels.
"""


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
    parts += [RELIEF_SCENES, table(head, rows), RELIEF_STEPS, *_relief_steps(result)]
    rows = []
    for record in result.select(case="embree", quantity="end to end"):
        more = {r.quantity: r.values[0] for r in result.select(case="embree", subject=record.subject)}
        memory = number(more["memory"] / 2**20) if "memory" in more else ""
        triangles = f"{more['triangles']:.0f}" if "triangles" in more else ""
        same = f"{more['silhouette (IoU)']:.4f}" if "silhouette (IoU)" in more else ""
        off = number(more["depth error"]) if "depth error" in more else ""
        rows.append([record.subject, str(Quartiles.of(record.values)), triangles, memory, same, off])
    return [*parts, RELIEF_EMBREE, table(["", "ms", "triangles", "MiB", "IoU", "depth error"], rows)]


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
