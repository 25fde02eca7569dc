"""``python -m benchmarks [NAMES] [--quick] [--out DIR]``: measure, write JSON, then the report."""

from __future__ import annotations

import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from benchmarks import report
from benchmarks.cases import FULL, QUICK
from benchmarks.runner import run

MODULES = {
    "complexity": "warp.complexity",
    "table2": "table2",
    "peers": "warp.peers",
    "rgbd": "warp.rgbd",
    "filling": "warp.filling",
    "edges": "warp.edges",
    "registration": "warp.registration",
    "cleaning": "cleaning.cleaning",
    "raster": "raster.raster",
    "slicing": "slicing.slicing",
    "relief": "relief.relief",
    "displaced": "displaced",
    "depthmesh": "depthmesh.depthmesh",
    "gaussians": "gaussians.gaussians",
    "runtimes": "runtimes.runtimes",
    "pages": "app.pages",
    "startup": "startup",
    "gpu": "gpu.gpu",
    "card": "gpu.card",
}
NAMES = ", ".join(MODULES)
ALONE = "card"  # measured on a machine with a GPU; its report is in a separate folder


def main(
    names: Annotated[list[str] | None, typer.Argument(help=f"Some of: {NAMES}. Default: all but {ALONE}.")] = None,
    quick: Annotated[bool, typer.Option(help="Tiny sizes, to see that everything runs.")] = False,
    python: Annotated[
        list[Path] | None,
        typer.Option(help="Another Python, possibly in a Debian in a folder; its OpenCL runtimes are measured, too."),
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="Default: benchmarks/results/VERSION, quick: build/benchmarks.")
    ] = None,
) -> None:
    """Measure pyibr against the papers' figures and its peers. Run nothing else meanwhile."""
    import pyibr as ibr

    wanted = names or [name for name in MODULES if name != ALONE]
    unknown = sorted(set(wanted) - set(MODULES))
    if unknown:
        raise typer.BadParameter(f"expected some of {NAMES}, got {', '.join(unknown)}")
    if out is None:
        here = Path(__file__).parent
        out = here.parent / "build/benchmarks" if quick else here / "results" / ibr.__version__
        out = out / ALONE if wanted == [ALONE] else out
    plan = replace(QUICK if quick else FULL, pythons=(Path(sys.executable), *(python or [])))
    for name in wanted:
        module = import_module(f"benchmarks.{MODULES[name]}")
        run(name, module.cases(plan)).save(out / f"{name}.json")
    Console().print(f"written: {report.write(out)}")


if __name__ == "__main__":
    typer.run(main)
