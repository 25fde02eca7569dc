"""`pyibr compare`: differences between pictures, or between depth maps."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from pyibr.app.commands.beside import read_ahead
from pyibr.app.commands.command import EMPTY
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.outputs import Outputs, VideoOptions, check_outputs
from pyibr.app.commands.progress import with_progress
from pyibr.app.commands.series import depths_in, paired, pictures_in
from pyibr.app.options import CameraFile, ExposureOption, StoredDepth, print_note, printable_text
from pyibr.core.camera import Camera
from pyibr.core.camera_json import write_json
from pyibr.core.errors import ArgumentError, FileFormatError, MissingPackageError
from pyibr.core.optional import flip_evaluator, scikit_image
from pyibr.images import metrics
from pyibr.io.image import read_mask

_Image = NDArray[Any]
_Mask = NDArray[np.bool_]
_Figures = dict[str, float]

_METRICS: dict[str, Callable[..., float]] = {
    "psnr": metrics.psnr,
    "ssim": metrics.ssim,
    "flip": metrics.flip,
    "iv_psnr": metrics.iv_psnr,
    "ws_psnr": metrics.ws_psnr,
}
_NEEDED: dict[str, Callable[[], object]] = {"ssim": scikit_image, "flip": flip_evaluator}
_NAMES = ", ".join(_METRICS).replace("_", "-")
_MORE_IS_WORSE = ("flip", "rmse", "median_error", "relative_error")

_WHITE, _WHITE_DEPTH = 0.25, 0.05  # errors shown as white, relative to the peak and to the depth
_NOT_COUNTED, _IN_ONE = (30, 30, 60), (60, 60, 160)
_A = Annotated[
    Path, typer.Argument(metavar="A", help="An image, a folder of images, or a video; with --depth also NPY, NPZ")
]
_B = Annotated[
    Path, typer.Argument(metavar="B", help="The same; files in folders are paired by name, or else in order")
]


def compare(
    a: _A,
    b: _B,
    depth: Annotated[bool, typer.Option("--depth", help="A, the truth, and B hold depth")] = False,
    mask: Annotated[Path | None, typer.Option(help="An image, black for ignored pixels")] = None,
    measures: Annotated[
        str | None,
        typer.Option("--metrics", metavar="A,B,...", help=f"For pictures: {_NAMES} (panoramas)"),
    ] = None,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="A picture of the errors, OUT_0000, ... or a video; or JSON")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print all figures as JSON")] = False,
    camera: CameraFile = None,
    scale_b: Annotated[float | None, typer.Option("--depth-scale-b", help="Depth scale of B, if it differs")] = None,
    *,
    stored: StoredDepth,
    exposure: ExposureOption = 0.0,
    video: VideoOptions,
) -> None:
    """Measure the differences between two pictures, two depth maps, or the frames of two folders or videos."""
    exposed, own = Exposure(exposure), None if camera is None else Camera.load(camera)
    if depth and measures:
        raise ArgumentError("--metrics", "none with --depth", measures)
    if scale_b is not None and not depth:
        raise ArgumentError("--depth-scale-b", "--depth with it", "none")
    of_b = stored if scale_b is None else stored._replace(depth_scale=scale_b)
    first, second = (
        depths_in(one, how, own) if depth else pictures_in(one, exposed) for one, how in ((a, stored), (b, of_b))
    )
    pairs = paired(first, second, str(b))
    if alone := len(first.names) + len(second.names) - 2 * len(pairs):
        print_note(f"{alone} files without a partner are left out")
    counted = None if mask is None else read_mask(mask)
    measure = _of_depth if depth else functools.partial(_of_pictures, _chosen(measures))
    read = {"A": first.files, "B": second.files}
    read |= {"--mask": [mask] if mask else [], "--camera": [camera] if camera else []}
    numbers = None if first.is_single and second.is_single else range(len(pairs))
    outputs = _outputs(output, read, numbers, video)
    each, size = list[dict[str, Any]](), ""
    with outputs or nullcontext(), exposed:
        frames = zip(first.read(x for x, _ in pairs), second.read(y for _, y in pairs), strict=True)
        for number, (x, y) in enumerate(with_progress(read_ahead(frames), len(pairs), "Comparing")):
            name = first.names[pairs[number][0]]
            x, y = _alike(x, y, f"{b}, {name}" if numbers else str(b))
            size = f"{x.shape[1]}x{x.shape[0]}"
            each.append({"name": name, **measure(x, y, counted)})
            if outputs is not None:
                errors = (_depth_errors if depth else _color_errors)(x, y)
                outputs.write({"color": _shown(errors, counted)}, number, 1.0, own)
    figures = {"a": str(a), "b": str(b), "frames": len(each), "size": size}
    means = _means(each)
    for_json = figures | {"mean": _finite(means), "each": [_finite(one) for one in each]}
    if output is not None and outputs is None:
        write_json(output, for_json)
    if as_json:
        typer.echo(json.dumps(for_json))
    else:
        _tell(figures | {"mean": means, "each": each})
    if means.get("covered_both") == 0:
        raise typer.Exit(EMPTY)


def _chosen(text: str | None) -> list[str]:
    """The requested metrics; by default all whose packages are installed, except the metric for panoramas."""
    if text is not None:
        asked = [name.strip().replace("-", "_") for name in text.split(",")]
        if unknown := [name for name in asked if name not in _METRICS]:
            raise ArgumentError("--metrics", f"some of {_NAMES}", unknown[0])
        return asked
    found = list[str]()
    for name in [one for one in _METRICS if one != "ws_psnr"]:
        try:
            _NEEDED.get(name, dict)()
            found.append(name)
        except MissingPackageError as error:
            print_note(f"{name} is left out: {error}")
    return found


def _outputs(
    output: Path | None, read: Mapping[str, Sequence[Path]], numbers: range | None, video: VideoOptions
) -> Outputs | None:
    """The pictures to write, if any; checks before any work that they can be written."""
    if output is None or output.suffix.lower() == ".json":
        if video != VideoOptions():
            raise ArgumentError("--fps, --codec", "a video for --output", str(output or "none"))
        check_outputs(read, {"--output": [output] if output else []})
        return None
    outputs = Outputs({"--output": (output, "color")}, StoredDepth(), numbers, video)
    outputs.check(read)
    return outputs


def _alike(a: _Image, b: _Image, name: str) -> tuple[_Image, _Image]:
    """Two images of one size, both of 8 bits or both floats."""
    if a.shape != b.shape:
        (height, width), (rows, columns) = a.shape[:2], b.shape[:2]
        raise FileFormatError(f"{name}: expected {width}x{height} pixels, as A has, got {columns}x{rows}")
    if a.dtype == b.dtype:
        return a, b
    first, second = (one / np.float32(255) if one.dtype == np.uint8 else one for one in (a, b))
    return first, second


def _of_pictures(chosen: Sequence[str], a: _Image, b: _Image, counted: _Mask | None) -> _Figures:
    return {name: _METRICS[name](a, b, valid=counted) for name in chosen}


def _of_depth(truth: _Image, depth: _Image, counted: _Mask | None) -> _Figures:
    """Errors where both have depth, NaN if nowhere; and the fraction of the counted pixels that have depth."""
    known = [np.isfinite(one) & (one > 0) for one in (truth, depth)]
    figures = {"covered_a": known[0], "covered_b": known[1], "covered_both": known[0] & known[1]}
    found = {name: 1 - metrics.hole_ratio(one, expected=counted) for name, one in figures.items()}
    if not found["covered_both"]:
        return {"rmse": math.nan, "median_error": math.nan, "relative_error": math.nan, **found}
    rmse, median = (one(depth, truth, valid=counted) for one in (metrics.depth_rmse, metrics.median_depth_error))
    with np.errstate(all="ignore"):
        share = metrics.median_depth_error(
            depth / truth, np.ones_like(truth), valid=known[0] if counted is None else counted & known[0]
        )
    return {"rmse": rmse, "median_error": median, "relative_error": share, **found}


def _color_errors(a: _Image, b: _Image) -> tuple[NDArray[np.float32], _Mask, _Mask]:
    """Mean differences of the channels, 1 for white; mask of known errors; mask of pixels that one picture lacks."""
    top = _WHITE * (255 if a.dtype == np.uint8 else 1)
    errors: NDArray[np.float32] = np.abs(a.astype(np.float32) - b.astype(np.float32)).mean(axis=-1) / np.float32(top)
    return errors, np.ones(errors.shape, np.bool_), np.zeros(errors.shape, np.bool_)


def _depth_errors(a: _Image, b: _Image) -> tuple[NDArray[np.float32], _Mask, _Mask]:
    first, second = (np.isfinite(one) & (one > 0) for one in (a, b))
    with np.errstate(all="ignore"):
        return (np.abs(b - a) / (_WHITE_DEPTH * a)).astype(np.float32), first & second, first ^ second


def _shown(found: tuple[NDArray[np.float32], _Mask, _Mask], counted: _Mask | None) -> NDArray[np.uint8]:
    """Picture of the errors, (H, W, 3).

    Errors go from black over red and yellow to white. Uncounted pixels are dark blue. Pixels that one picture lacks
    are blue.
    """
    errors, known, lacking = found
    ramp = np.clip(3 * np.nan_to_num(errors)[..., None] - np.arange(3), 0, 1)
    picture = np.where(known[..., None], np.rint(255 * ramp), np.array(_NOT_COUNTED)).astype(np.uint8)
    picture[lacking] = _IN_ONE
    if counted is not None:
        picture[~counted] = _NOT_COUNTED
    return picture


def _means(each: Sequence[Mapping[str, Any]]) -> _Figures:
    """Means over the frames that have a figure."""
    found: _Figures = {}
    for name in [name for name in each[0] if name != "name"]:
        known = [one[name] for one in each if not math.isnan(one[name])]
        found[name] = float(np.mean(known)) if known else math.nan
    return found


def _finite(figures: Mapping[str, Any]) -> dict[str, Any]:
    """Figures for JSON, which has no infinity: null for equal pictures and for undefined figures."""
    return {name: None if isinstance(one, float) and not math.isfinite(one) else one for name, one in figures.items()}


def _tell(figures: Mapping[str, Any]) -> None:
    """Print the means and, for several frames, the worst frame."""
    each, size = figures["each"], figures["size"]
    several = f", {len(each)} frames" if len(each) > 1 else ""
    typer.echo(f"{printable_text(figures['a'])} and {printable_text(figures['b'])}: {size}{several}")
    for name, mean in figures["mean"].items():
        unit = " dB" if name.endswith("psnr") else ""
        worst = ""
        if len(each) > 1 and math.isfinite(mean):
            pick = max if name in _MORE_IS_WORSE else min
            one = pick((one for one in each if not math.isnan(one[name])), key=lambda one: one[name])
            is_other = f"{one[name]:.6g}" != f"{mean:.6g}"
            worst = f"; the worst {one[name]:.6g}{unit}, {printable_text(one['name'])}" if is_other else ""
        typer.echo(f"  {name.replace('_', '-'):15}{mean:.6g}{unit}{worst}")
