"""Images with depth and recordings as inputs of commands, with the options for reading them."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, NamedTuple

import typer

from pyibr.app.commands.cameras import ExtrinsicsFile, LensOptions
from pyibr.app.commands.exposure import Exposure
from pyibr.app.commands.sources import InputOptions, Losses, open_sources
from pyibr.app.commands.views import DepthOptions, DepthRange, views_of
from pyibr.app.options import CleaningOptions, DefaultDepthText, ExposureOption, StoredDepth, Take, default_depth_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.io.video import Video

Sources = Annotated[
    list[Path],
    typer.Argument(
        metavar="COLOR DEPTH",
        help="Image and planar depth; several such pairs; or recordings: a folder of images or a video, with a folder "
        "of depth; or one folder with both (TUM RGB-D, 7-Scenes, Redwood, COLMAP's dense workspace)",
    ),
]


class Reading(NamedTuple):
    """Options for reading."""

    camera: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE[#NAME]",
            help="The camera, or one for each pair: a calibration of any kind; a list, a folder of them, "
            "a COLMAP model",
        ),
    ] = None
    take: Take = None
    poses: Annotated[
        list[Path] | None,
        typer.Option(help="The camera poses of the frames: TUM, KITTI, Redwood, 4 x 4 matrices, cameras as JSON"),
    ] = None
    depth_camera: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE[#NAME]", help="The depth's camera, if it is not registered to the colours"),
    ] = None
    extrinsics: ExtrinsicsFile = None
    cleaning: CleaningOptions = CleaningOptions()
    default_depth: DefaultDepthText = "none"
    exposure: ExposureOption = 0.0
    lens: LensOptions = LensOptions()
    stored: StoredDepth = StoredDepth()


class Inputs:
    """Images with depth: all of one scene, or a sequence of frames.

    together: whether all frames of recordings show one scene.
    """

    def __init__(self, sources: list[Path], reading: Reading, together: bool = False) -> None:
        given = reading.camera or [], reading.depth_camera or [], reading.poses or []
        stored = reading.stored
        how = reading.take, reading.lens, stored.how.get("channel"), reading.extrinsics
        self._options = InputOptions(sources, *given, *how)
        self._sources, are_stills = open_sources(self._options)
        if together and not all(source.is_placed for source in self._sources):
            got = f"{len(self._sources[0].shots)} without poses"
            raise ArgumentError("--together", "frames with known poses, as by --poses", got)
        first = self._sources[0]
        self.name, self.size = sources[0], first.shots[0].camera.size
        self.is_scene = are_stills or together
        self.numbers = None if self.is_scene else [shot.number for shot in first.shots]
        self.film: Video | None = None if self.is_scene else first.video
        self.seen = DepthRange()
        self.count = 1 if self.numbers is None else len(self.numbers)
        self._exposure = Exposure(reading.exposure)
        self._depth = DepthOptions(
            stored,
            default_depth_of(reading.default_depth),
            *reading.cleaning.checked(),
            steady=not self.is_scene,
            recorded=not are_stills,
            seen=self.seen,
        )

    @property
    def files(self) -> dict[str, list[Path]]:
        """All files that are read, by option or argument."""
        return self._options.read(self._sources)

    def frames(self, skipped: Collection[int] = ()) -> Iterator[tuple[int, Sequence[DepthImage]]]:
        """Yield each frame's index and views, or all views of one scene once; report lost frames at the end.

        skipped: numbers of frames that are left out.
        """
        losses = Losses(recorded=self._depth.recorded)
        each = [views_of(source, self._depth, losses, self._exposure, skipped) for source in self._sources]
        frames = [[view for views in each for view in views]] if self.is_scene else zip(*each, strict=True)
        some = bool(skipped)
        for place, frame in enumerate(frames):
            if views := [view for view in frame if view is not None]:
                some = True
                yield place, views
        losses.tell(some)
        self._exposure.tell()
