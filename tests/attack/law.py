"""The law: each call returns a sound result or raises one of pyibr's errors, and does the same when repeated."""

from __future__ import annotations

import os
import threading
import time
import warnings
from typing import Any

import numpy as np

import pyibr as ibr
from tests.attack.arguments import MAKERS, Call
from tools.everything import arrays_of

HANGS = 120.0
"""Seconds of processor time, including compiling, after which a call counts as endless."""


class BrokenLawError(AssertionError):
    """A call has broken the law."""


def judge(kind: str, seed: int) -> str:
    """Make a call twice, with new arguments; returns "sound" or the error's message, or raises BrokenLawError."""
    done = threading.Event()
    threading.Thread(target=_watch, args=(kind, seed, done), daemon=True).start()
    try:
        first, second = (_outcome(kind, seed) for _ in range(2))
    finally:
        done.set()
    if first[0] != second[0]:
        raise BrokenLawError(f"two outcomes: {first[0]} and {second[0]}")
    for number, (a, b) in enumerate(zip(first[1], second[1], strict=True)):
        if a.tobytes() != b.tobytes():
            raise BrokenLawError(f"two results: array {number} of {len(first[1])}")
    return first[0]


def reproduced_by(kind: str, seed: int) -> str:
    """The command that repeats a call."""
    return f"python -m tests.attack {kind} --first {seed} --count 1"


def _watch(kind: str, seed: int, done: threading.Event) -> None:
    """End the process if a call is endless, because kernels cannot be interrupted."""
    start = time.process_time()
    while not done.wait(1.0):
        if time.process_time() - start > HANGS:
            print(f"{reproduced_by(kind, seed)}: not done after {HANGS:g} s", flush=True)
            os._exit(3)


def _outcome(kind: str, seed: int) -> tuple[str, list[np.ndarray]]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "warp: (the )?target camera")  # targets may see nothing
        warnings.filterwarnings("ignore", "the cameras of depth and colour differ")  # both may stand at the origin
        try:
            call = MAKERS[kind](seed)
            made = call.call()
        except ibr.ArgumentError as error:
            if "\n" in str(error) or len(str(error)) > 500:
                raise BrokenLawError(f"the message is not one short line: {error}") from None
            return str(error), []
    if kind in ("register", "clean"):
        return "sound", checked_arrays([made] if isinstance(made, np.ndarray) else list(made))
    frames = made if isinstance(made, list) else [made]
    _check_out(call, made, frames)
    return "sound", [array for frame in frames for array in checked(frame, call.options)]


def _check_out(call: Call, made: Any, frames: list[ibr.Frame]) -> None:
    if call.out is not None:
        outs = call.out if isinstance(made, list) else [call.out]
        for frame, out in zip(frames, outs, strict=True):
            if frame.color is not out.color or frame.depth is not out.depth or frame.valid is not out.valid:
                raise BrokenLawError("the frame does not hold the arrays of `out`")


def checked_arrays(made: list[np.ndarray]) -> list[np.ndarray]:
    """Check that arrays have one size and known dtypes, and that depth is NaN, or finite and above 0."""
    for array in made:
        if array.shape[:2] != made[0].shape[:2] or array.dtype not in (np.bool_, np.uint8, np.uint16, np.float32):
            raise BrokenLawError(f"{array.dtype} of shape {array.shape}")
        some = array[~np.isnan(array)] if array.dtype == np.float32 and array.ndim == 2 else array
        if not np.isfinite(some).all() or (some is not array and (some <= 0).any()):
            raise BrokenLawError("values not finite, or depths not above 0")
    return made


def checked(frame: ibr.Frame, options: dict[str, Any]) -> list[np.ndarray]:
    """Return the arrays of a frame, after checking that it is sound."""

    def must(so: bool, words: str) -> None:
        if not so:
            raise BrokenLawError(words)

    must(isinstance(frame, ibr.Frame), f"a {type(frame).__name__} instead of a frame")
    shape = (frame.camera.height, frame.camera.width)
    color, depth, valid = frame.color, frame.depth, frame.valid
    must(color.shape[:2] == shape and color.shape[2] in (0, 3), "shape of color")
    must(color.dtype in (np.uint8, np.float32), "dtype of color")
    must(depth.shape == shape and depth.dtype == np.float32, "shape or dtype of depth")
    must(valid.shape == shape and valid.dtype == np.bool_, "shape or dtype of valid")
    must(set(np.unique(valid.view(np.uint8)).tolist()) <= {0, 1}, "valid is neither 0 nor 1")
    must(bool(np.isfinite(color).all()), "color not finite")
    told = ~np.isnan(depth)
    some = depth[told]
    must(bool((np.isfinite(some) & (some > 0)).all()), f"depths like {some[~(np.isfinite(some) & (some > 0))][:3]}")
    must(bool(told[valid].all()), "valid pixels without depth")
    if options.get("fill") is None:
        must(bool((told == valid).all()), "depth at invalid pixels, or none at valid ones")
        if not np.any(options.get("background", 0)):
            bare = ~valid if frame.alpha is None else frame.alpha == 0
            must(not color[bare].any(), "colour at invalid pixels")
    if frame.alpha is not None:
        alpha = frame.alpha
        must(alpha.shape == shape and bool(((alpha >= 0) & (alpha <= 1)).all()), "shape or values of alpha")
        must(bool((alpha[valid] > 0).all()), "valid pixels without alpha")
        must(bool(options.get("blended") or not alpha[~valid].any()), "alpha at invalid pixels")
    if frame.guessed is not None:
        must(frame.guessed.shape == shape and frame.guessed.dtype == np.bool_, "shape or dtype of guessed")
        must(not (frame.guessed & ~valid).any(), "guessed pixels that are invalid")
    if frame.classes is not None:
        classes = frame.classes
        must(classes.shape == shape and bool((classes <= 3).all()), "shape or values of classes")
        must(bool(((classes == ibr.PixelClass.SEEN) == valid).all()), "the class SEEN differs from valid")
        must(frame.source is not None, "classes without origins")
    if frame.source is not None:
        source, view = frame.source, frame.view
        must(source.shape == (*shape, 2) and view.shape == shape, "shape of source or view")
        must(bool((np.isfinite(source).all(axis=2) == valid).all()), "finite source differs from valid")
        must(bool(((view >= 0) == valid).all()), "view >= 0 differs from valid")
    return arrays_of(frame)
