"""The command line: its commands, and the output of their errors."""

from __future__ import annotations

import errno
import functools
import itertools
import logging
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Generator
from contextlib import contextmanager
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

import pyibr as ibr
from pyibr.app.batch.work import COMMANDS
from pyibr.app.batch_command import batch
from pyibr.app.commands.command import expanded
from pyibr.app.commands.doctor import doctor
from pyibr.app.live_commands import place, view
from pyibr.app.options import printable_text
from pyibr.core.errors import ArgumentError, DeviceError, Error

_SAME = (
    "camera depth_scale depth_offset cut_ratio thin near far focal_35mm layout divergence convergence "
    "depth_range grid cone focus default_depth max_error count scale tiles wrap slices anisotropy samples "
    "ambient resolution holes strength codec device size layer"
)
_OPTIONS = {name: f"--{name.replace('_', '-')}" for name in _SAME.split()} | {
    "view": "DEPTH",
    "channel": "--depth-channel",
    "part": "--depth-channel",
    "fov_x": "--fov",
    "degrees": "--orbit",
    "direction": "--light",
    "position": "--lamp",
    "path": "--output",
    "valid": "--mask",
    "expected": "--mask",
}
"""The command line's names of the library's arguments."""


class _Teller(logging.Handler):
    def __init__(self, tell: Callable[[str], object]) -> None:
        super().__init__(logging.INFO)
        self._tell = tell

    def emit(self, record: logging.LogRecord) -> None:
        self._tell(record.getMessage())


def _tell_warning(tell: Callable[[str], object], message: Warning | str, *_: object, **__: object) -> None:
    tell(str(message))


@contextmanager
def telling(tell: Callable[[str], object]) -> Generator[None, None, None]:
    """Context in which `tell` is called with messages of the logger "pyibr" and with warnings."""
    logger, teller = logging.getLogger("pyibr"), _Teller(tell)
    level = logger.level
    logger.addHandler(teller)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = functools.partial(_tell_warning, functools.cache(tell))  # each once
            yield
    finally:
        logger.removeHandler(teller)
        logger.setLevel(level)


class _Command(TyperCommand):
    """Takes no option's name as another option's value, and names wrong values."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        options: dict[str, Any] = {name: one for one in self.params for name in one.opts if name.startswith("-")}
        values = dict[object, str]()
        for number, word in enumerate(itertools.takewhile("--".__ne__, args), 1):
            one = options.get(word)
            if one is not None and not getattr(one, "is_flag", False):
                own = list(itertools.takewhile(lambda value: value not in options, args[number : number + one.nargs]))
                values[one] = " ".join(own) or "none"
                if len(own) < one.nargs:
                    raise typer.BadParameter(f"expected {one.nargs} values, got {values[one]}", ctx, one)
        try:
            return super().parse_args(ctx, args)
        except typer.BadParameter as error:
            error.message += f", got {values[error.param]}" if error.param in values else ""
            raise


class _OneLineErrors(TyperGroup):
    """Prints an error as one line, without a traceback."""

    def invoke(self, ctx: Any) -> Any:
        try:
            with _ended_tidily(), telling(lambda text: typer.secho(f"pyibr: {text}", err=True)):
                return super().invoke(ctx)
        except Error as error:
            text = str(error)
            if isinstance(error, ArgumentError) and error.argument in _OPTIONS:
                text = _OPTIONS[error.argument] + text.removeprefix(error.argument)
            raise _ended(text, 2, lines=isinstance(error, DeviceError)) from error
        except KeyboardInterrupt as error:
            raise _ended("interrupted", 130) from error  # 128 + SIGINT, as in shells
        except MemoryError as error:
            raise _ended("out of memory", 2) from error
        except OSError as error:
            if error.errno == errno.EPIPE:  # the reader of the output has gone and needs no message
                raise
            raise _ended(str(error), 2) from error


@contextmanager
def _ended_tidily() -> Generator[None, None, None]:
    """Context in which SIGTERM cleans up like Ctrl-C: complete files stay, temporary files are removed."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(number: int, _: object) -> None:
        sys.exit(128 + number)

    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT)}
    try:
        signal.signal(signal.SIGTERM, end)
        if callable(before[signal.SIGINT]):  # unless SIGINT is ignored
            signal.signal(signal.SIGINT, signal.default_int_handler)
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _ended(text: str, status: int, lines: bool = False) -> typer.Exit:
    typer.secho(f"pyibr: {printable_text(text, lines)}", err=True, fg="red")
    return typer.Exit(status)


app = typer.Typer(
    cls=_OneLineErrors,
    help="New views from images with depth, on any OpenCL device.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pyibr {ibr.__version__}")
        raise typer.Exit


@app.callback()
def _main(  # pyright: ignore[reportUnusedFunction]
    version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass


_MM = "--depth-scale 1000 --camera camera.json"
_EXAMPLES: dict[str, tuple[str, ...]] = {
    "warp": (
        f"color.png depth.png {_MM} --orbit 10 -o new.png",
        "a.png a_depth.npy b.png b_depth.npy --camera a.json --camera b.json --to new.json -o new.png",
        "rgbd_dataset_freiburg1_desk --clean --move 0.05 0 0 -o new.mp4",
        f"color.mp4 depth {_MM} --depth-camera depth.json --clean --fill background --orbit 5 -o new.mp4",
    ),
    "stereo": (
        f"color.png depth.png {_MM} -o stereo.png",
        "color.mp4 depth --depth-scale 1000 --fov 70 --layout half-sbs --divergence 2.5 -o film_LR.mp4",
    ),
    "quilt": (f"color.png depth.png {_MM} --grid 8 6 --size 420 560 --cone 20 -o room_qs8x6a0.75.png",),
    "orbit": (
        "dragon.ply -o turn.mp4",
        "gaussians.ply --to camera.json --depth-out depth.npy -o picture.png",
        f"color.png depth.png {_MM} --swing 10 -o swing.webp",
    ),
    "clean": (
        "depth.png --depth-scale 1000 --color color.png -o cleaned.png",
        "depth --depth-scale 1000 --holes 20 --invented-out invented.png -o cleaned",
        "rgbd_dataset_freiburg1_desk -o cleaned",
    ),
    "register": ("depth.png --depth-scale 1000 --depth-camera depth.json --color-camera color.json -o registered.png",),
    "mesh": (
        f"color.png depth.png {_MM} --max-error 0.005 -o scene.glb",
        f"color.png depth.png {_MM} --count 3000 -o small.glb",
    ),
    "capture": (
        "dragon.ply -o dragon",
        "dragon.ply --frusta frusta.json --size 512 -o finer",
        "dragon.ply --camera cameras.json -o seen",
        "gaussians.ply --camera cameras.json -o seen",
    ),
    "object": (
        "dragon --frames 36 -o turn.mp4",
        "room --depth-scale 1000 --missing unknown -o room.glb",
    ),
    "hull": ("pictures masks --camera cameras.json -o hull.ply",),
    "compare": (
        "truth.png new.png -o errors.png",
        "truth.mp4 new.mp4 --metrics psnr,iv-psnr --json",
        "depth.mkv new_depth.mkv --depth --depth-scale 1000 -o errors.mp4",
    ),
    "convert": (
        "calibration.yaml -o camera.json",
        "depth.mkv --depth-scale 1000 --to-kind inverse -o disparity.exr",
        "rgbd_dataset_freiburg1_desk -o desk",
        "rgbd_dataset_freiburg1_desk --as colmap -o model",
        "gaussians.ply -o gaussians.compressed.ply",
    ),
    "relief": (
        "ball.glb bumps.png --color bricks.png --scale 0.1 --light 1 1 1 -o relief.png",
        "ball.glb bumps.png --scale 0.1 --tiles 4 2 --frames 72 -o relief.mp4",
    ),
    "slices": ("ball.glb bumps.png --color bricks.png --scale 0.1 --light 1 1 1 -o slices.png",),
    "view": ("dragon.ply",),
    "place": ("dragon.ply --auto 16 -o dragon",),
    "batch": ("job.toml", "job.toml --scheduler tcp://10.0.0.1:8786"),
    "doctor": ("", "--build"),
}
"""Examples of the use of each command, in the order of the help."""

_PAGES_AND_OTHERS: dict[str, Callable[..., None]] = {"view": view, "place": place, "batch": batch, "doctor": doctor}
for _name, _uses in _EXAMPLES.items():
    _shown = [f"[bold]pyibr {_name} {_use}".rstrip() + "[/bold]" for _use in _uses]
    _command = expanded((COMMANDS | _PAGES_AND_OTHERS)[_name])
    app.command(_name, cls=_Command, epilog="\n\n".join([f"Example: {_shown[0]}", *_shown[1:]]))(_command)
