"""Frusta that are being placed: which there are, which one is chosen, and the way back. It knows no page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from threading import RLock
from typing import Any, get_args

from numpy.typing import ArrayLike

from pyibr.capture.frusta import Frustum, Stroke, load_frusta, save_frusta, save_set
from pyibr.core.checks import Float64, integer_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side

_STEPS = 200  # that can be undone
_COUNT_MAX = 256  # frusta


@dataclass(frozen=True)
class State:
    """The state that undoing brings back.

    Attributes
    ----------
    frusta : tuple of Frustum
    chosen : int or None
        Number of the one that is being worked on.
    side : {"front", "back", "both"}
        Of the surface, that the frusta's images show.
    """

    frusta: tuple[Frustum, ...] = ()
    chosen: int | None = None
    side: Side = "front"

    @property
    def current(self) -> Frustum | None:
        """The chosen frustum."""
        return None if self.chosen is None else self.frusta[self.chosen]


class Placement:
    """A set of frusta in the making.

    All that changes it can be undone. A gesture, as a drag of the mouse, is undone as one. It may be changed from any
    thread; who listens is told on the thread that makes the change, within `lock`: of one change after the other.

    Parameters
    ----------
    size : int
        Pixels a side of the frusta's images.
    within : (2, 3), optional
        The box, (low, high) in the world, of the part of the surface that is to be covered, if it is not all of it.

    Examples
    --------
    >>> from pyibr.app.place.model import Placement
    >>> from pyibr.capture.frusta import Frustum
    >>> placement = Placement(64)
    >>> placement.add(Frustum.look_at((0, 0, 3), (0, 0, 0), (0, 1, 0), 64))
    >>> placement.delete()
    >>> placement.undo()
    >>> len(placement.state.frusta), placement.state.chosen
    (1, 0)
    """

    def __init__(self, size: int, within: Float64 | None = None) -> None:
        self.size, self.within = integer_from("size", size, 2, 1 << 14), within
        self.state = State()
        self.listeners: list[Callable[[], None]] = []
        self._past: list[State] = []
        self._future: list[State] = []
        self._gesture: object = None
        self.lock = RLock()

    # ---- changes

    def add(self, *frusta: Frustum) -> None:
        """Add frusta, and choose the last one."""
        sized = tuple(one.resized(self.size) if one.camera.size != (self.size,) * 2 else one for one in frusta)

        def added(state: State) -> State:
            together = (*state.frusta, *sized)
            if len(together) > _COUNT_MAX:
                raise ArgumentError("frusta", f"at most {_COUNT_MAX}", str(len(together)))
            return replace(state, frusta=together, chosen=len(together) - 1 if together else None)

        self._change(added)

    def delete(self) -> None:
        """Take the chosen frustum away, if there is one."""

        def deleted(state: State) -> State:
            if state.chosen is None:
                return state
            left = state.frusta[: state.chosen] + state.frusta[state.chosen + 1 :]
            return replace(state, frusta=left, chosen=min(state.chosen, len(left) - 1) if left else None)

        self._change(deleted)

    def put(self, changed: Callable[[Frustum], Frustum], gesture: object = None) -> None:
        """Let the chosen frustum, if there is one, be what a function makes of it; a gesture is undone as one."""

        def put(state: State) -> State:
            number = state.chosen
            if number is None:
                return state
            frusta = (*state.frusta[:number], changed(state.frusta[number]), *state.frusta[number + 1 :])
            return replace(state, frusta=frusta)

        self._change(put, gesture)

    def move(self, world_from_camera: ArrayLike, gesture: object = None) -> None:
        """Move and turn the chosen frustum."""
        self.put(lambda frustum: frustum.at(world_from_camera), gesture)

    def open(self, across: float, down: float, far: float, gesture: object = None) -> None:
        """Give the chosen frustum other angles, in degrees, and another far plane."""
        self.put(lambda frustum: frustum.opened(across, down, far), gesture)

    def paint(self, point: tuple[float, float], radius: float, erases: bool = False, gesture: object = None) -> None:
        """Paint emptiness over the chosen frustum's image; see `Stroke`. A gesture's points are one stroke."""

        def painted(frustum: Frustum) -> Frustum:
            goes_on = gesture is not None and gesture == self._gesture and frustum.strokes
            before = frustum.strokes[:-1] if goes_on else frustum.strokes
            points = (*frustum.strokes[-1].points, point) if goes_on else (point,)
            return replace(frustum, strokes=(*before, Stroke(points, radius, erases)))

        self.put(painted, gesture)

    def clean(self) -> None:
        """Take all paint off the chosen frustum's image."""
        self.put(lambda frustum: replace(frustum, strokes=()))

    def look_from(self, side: Side) -> None:
        """Let another side of the surface be the one that is shown."""
        one_of("side", side, Side)
        self._change(lambda state: replace(state, side=side))

    def choose(self, number: int | None) -> None:
        """Choose a frustum by its number, or none; that is no change to undo."""
        with self.lock:
            if number is not None and not 0 <= number < len(self.state.frusta):
                raise ArgumentError("number", f"of one of {len(self.state.frusta)} frusta", str(number))
            if number == self.state.chosen:
                return
            self.state, self._gesture = replace(self.state, chosen=number), None
            self._tell()

    # ---- the way back

    def undo(self) -> None:
        """Take the last change back, if there is one."""
        self._step(self._past, self._future)

    def redo(self) -> None:
        """Take the last undoing back, if nothing was changed since."""
        self._step(self._future, self._past)

    @property
    def steps(self) -> tuple[int, int]:
        """The number of changes that can be undone, and of those that can be redone."""
        return len(self._past), len(self._future)

    # ---- files

    @property
    def about(self) -> dict[str, Any]:
        """The set's entries in files beside its frusta."""
        part = {} if self.within is None else {"within": self.within.tolist()}
        return {"side": self.state.side} | part

    def save(self, folder: str | PathLike[str], views: Sequence[DepthImage]) -> None:
        """Write the set with the images that its frusta see; `pyibr.load` and `load` read it."""
        save_set(folder, self.state.frusta, views, **self.about)

    def save_frusta(self, path: str | PathLike[str]) -> None:
        """Write the frusta alone."""
        save_frusta(path, self.state.frusta, **self.about)

    def load(self, path: str | PathLike[str]) -> None:
        """Take the frusta of a set's folder or JSON file instead of those that there are; that can be undone.

        Raises
        ------
        FileFormatError
            If it is no such file.
        """
        self.take(*load_frusta(path))

    def take(self, frusta: Sequence[Frustum], about: dict[str, Any]) -> None:
        """Take other frusta, and what their file says of the set."""
        side = about.get("side", "front")
        known: Side = side if side in get_args(Side) else "front"
        sized = tuple(one.resized(self.size) for one in frusta)
        self._change(lambda _: State(sized, 0 if sized else None, known))

    # ---- how

    def _change(self, make: Callable[[State], State], gesture: object = None) -> None:
        with self.lock:
            state = make(self.state)
            if state == self.state:
                return
            if gesture is None or gesture != self._gesture:
                self._past.append(self.state)
                del self._past[:-_STEPS]
            self._future.clear()
            self.state, self._gesture = state, gesture
            self._tell()

    def _step(self, source: list[State], target: list[State]) -> None:
        with self.lock:
            if not source:
                return
            target.append(self.state)
            self.state, self._gesture = source.pop(), None
            self._tell()

    def _tell(self) -> None:
        for listener in list(self.listeners):
            listener()
