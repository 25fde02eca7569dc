"""The commands that open pages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import pyibr as ibr
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.heights import HEIGHT_HELP, MapOptions
from pyibr.app.commands.things import ImageOptions, StartCamera, ThingFiles, UpOption, direction_of, upward_of
from pyibr.app.live.pages import Pages
from pyibr.app.options import DeviceName, device_of, given_of, printable_text
from pyibr.app.place import place as place_page
from pyibr.app.place.captures import Captures
from pyibr.app.place.model import Placement
from pyibr.capture.coverage import surface_of
from pyibr.capture.frusta import load_frusta, part_of
from pyibr.capture.proposal import propose_frusta
from pyibr.core.camera import Camera
from pyibr.core.errors import ArgumentError
from pyibr.meshes.mesh import Mesh
from pyibr.picture.light import light_for
from pyibr.relief import ReliefSurface
from pyibr.slicing import SlicedSurface

_Port = Annotated[int, typer.Option(help="Port of the page, or the next free one; 0: any free port")]
_Open = Annotated[bool, typer.Option("--open", help="Open the page in the browser")]


def view(
    things: ThingFiles,
    *,
    options: ImageOptions,
    height: Annotated[Path | None, typer.Option(help=HEIGHT_HELP)] = None,
    maps: MapOptions,
    start: StartCamera = None,
    up: UpOption = None,
    port: _Port = 8080,
    open_page: _Open = False,
    device: DeviceName = None,
) -> None:
    """Look around in a browser; pictures are drawn live. Only this machine can open the page."""
    with device_of(device):
        exposed = Exposure(options.exposure)
        shown, customary = options.things(things, exposed)
        meshes = [thing for thing in shown if isinstance(thing, Mesh)]
        given: object = shown
        if height is not None:
            if len(meshes) != 1 or len(shown) != 1:
                raise ArgumentError("--height", "one mesh to displace, and nothing else", f"{len(shown)} things")
            made = maps.displace(meshes[0], height, exposed)
            given = {"relief": made(ReliefSurface), "slices": made(SlicedSurface)}
        elif given_maps := given_of(maps):
            raise ArgumentError(given_maps[0], "--height with it", "none")
        exposed.tell()
        first = None if start is None else Camera.load(start)
        _serve(ibr.view(given, first, up=direction_of(up or customary), port=port), open_page)


def place(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="The mesh to cover")],
    frusta: Annotated[Path | None, typer.Option(help="Initial set: its folder, or a JSON file")] = None,
    auto: Annotated[int, typer.Option(min=0, max=64, help="Number of frusta to propose in addition")] = 0,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="Folder of the set; with --no-page required")
    ] = None,
    size: Annotated[int, typer.Option(min=2, max=4096, help="Pixels a side of the frusta's images")] = 256,
    within: Annotated[
        tuple[float, float, float, float, float, float] | None,
        typer.Option(metavar="X Y Z X Y Z", help="Cover only the part inside a box, given by two corners"),
    ] = None,
    page: Annotated[bool, typer.Option("--page/--no-page", help="Open a page, or only save the set")] = True,
    up: UpOption = None,
    port: _Port = 8080,
    open_page: _Open = False,
    device: DeviceName = None,
) -> None:
    """Place frusta on a mesh in a browser, until their depth images cover it."""
    if not page and output is None:
        raise ArgumentError("--output", "a folder for the set, with --no-page", "none")
    with device_of(device):
        known = Mesh.load(mesh)
        upward = upward_of(mesh, up)
        given, about = ([], {}) if frusta is None else load_frusta(frusta)
        part = part_of(about, frusta or "") if within is None else np.sort(np.reshape(within, (2, 3)), axis=0)
        surface = surface_of(known, within=part)
        placement = Placement(size, part)
        placement.take(given, about)
        if auto:
            state = placement.state
            placement.add(
                *propose_frusta(
                    known, auto, size, known=state.frusta, side=state.side, surface=surface, progress=_tell_proposal
                )
            )
        state = placement.state
        if page:
            folder = output or Path(f"{mesh.name.split('.')[0]}-frusta")
            _serve(
                place_page(
                    known, state.frusta, size=size, folder=folder, up=upward, port=port, side=state.side, within=part
                ),
                open_page,
            )
            return
        assert output is not None
        captures = Captures(surface, light_for(known, upward))
        placement.save(output, captures.views(state.frusta))
        unseen = captures.unseen(state.frusta, state.side)
        typer.echo(f"{printable_text(output)}: {len(state.frusta)} frusta, {unseen:.1%} of the surface unseen")


def _tell_proposal(done: int, of: int, unseen: float) -> None:
    typer.echo(f"{done} of {of}: {unseen:.1%} of the surface unseen", err=True)


def _serve(pages: Pages, open_page: bool) -> None:
    """Print the page's address, and serve it until Ctrl-C."""
    typer.echo(f"{pages.url} can be opened on this machine only; Ctrl-C ends it")
    if open_page:
        typer.launch(pages.url)
    pages.wait()
