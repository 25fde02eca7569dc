"""Videos with a track of colours and a track of depth, such as Azure Kinect's recordings with their calibration."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import cast

from pyibr.core.calibrations import cameras_in, chosen, listed, making
from pyibr.core.camera import Camera
from pyibr.core.errors import FileFormatError
from pyibr.io.depth_frames import DepthFrames, OfFile
from pyibr.io.folders import at_one_time, kind_of
from pyibr.io.recordings import Recording, paired_by_time
from pyibr.io.video import Video, opened, tracks_of

_KINECT = re.compile("K4A_|Azure Kinect|'DEPTH'.*'IR'")  # in the metadata; the depth is in millimetres


def has_depth(path: Path, channel: str | None = None) -> bool:
    """Tell whether a video has several tracks, and one of depth: by title, by pixels, or as the caller says."""
    with opened(path) as container:
        found = tracks_of(container, "depth")
    return len(found) > 1 and (channel is not None or min(found.values()) < 2)


def find_tracks(path: Path, channel: str | None = None) -> Recording | None:
    """Find a video of colours and depth (track `channel`), paired by time; attached JSON holds the cameras."""
    if not path.is_file() or not has_depth(path, channel):
        return None
    with opened(path) as container:
        told = str([stream.metadata for stream in (container, *container.streams)])
        files = {one.name: getattr(one, "data", b"") for one in container.streams if one.type == "attachment"}
    color, frames = Video(path), DepthFrames(path, channel)
    depth = cast("Video", frames.source)
    times = [[video.start + time for time in video.times] for video in (color, depth)]
    found = paired_by_time([path] * len(color), times[0], [path] * len(depth), times[1])
    scale = 1000.0 if _KINECT.search(told) else None
    stored = [OfFile(scale, frames=frames, number=place) for _, place in at_one_time(*times)]
    found = found._replace(stored=stored, video=path)
    name = next((name for name in files if files[name] and name.lower().endswith(".json")), None)
    if name is None:
        return found
    shapes = {"color": next(color.frames([0])).shape, "depth": next(depth.gray([0])).shape}
    of_color, of_depth = (_attached(f"{path}: {name}", files[name], shape, kind) for kind, shape in shapes.items())
    own = None if of_depth == of_color else [of_depth] * len(stored)
    return found._replace(known=lambda: [of_color], depth_cameras=None if own is None else lambda: own)


def _attached(name: str, data: bytes, shape: tuple[int, ...], kind: str) -> Camera:
    """The camera for images of this shape in a calibration; if several fit, the camera whose name has the kind."""
    size = shape[1], shape[0]
    with making(name):
        makers = chosen(cameras_in(json.loads(data), name, size), None, name, size)
        cameras = [Camera(**make()) for own, make in makers.items() if len(makers) == 1 or kind_of(own) in (kind, "")]
    fitting = [camera for camera in cameras if camera.size == size]
    if not fitting:
        raise FileFormatError(
            f"{name}: expected a camera of {size[0]}x{size[1]}, the track of {kind}, got {listed(makers)}"
        )
    return fitting[0]
