"""The frusta of a placement, the chosen frustum, and undo, independent of any page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from threading import RLock
from typing import Any, get_args

from numpy.typing import ArrayLike

from pyibr.capture.frusta import Frustum, Stroke, load_frusta, save_set
from pyibr.core.checks import Float64, integer_from, one_of
from pyibr.core.errors import ArgumentError
from pyibr.images import DepthImage
from pyibr.images.depth_image import Side

_STEPS = 200  # steps that can be undone
_COUNT_MAX = 256  # frusta


@dataclass(frozen=True)
class State:
    """A state that undo restores."""

    frusta: tuple[Frustum, ...] = ()
    chosen: int | None = None  # index of the frustum that is edited
    side: Side = "front"  # side of the surface that the frusta's images show

    @property
    def current(self) -> Frustum | None:
        """The chosen frustum."""
        return None if self.chosen is None else self.frusta[self.chosen]


class Placement:
    """A set of frusta that is edited.

    All changes can be undone. A gesture, such as a drag of the mouse, is undone in one step. Changes may come from any
    thread. Listeners are called on the thread that makes the change, within `lock`, for one change after the other.

    Parameters
    ----------
    size : int
        Pixels a side of the frusta's images.
    within : (2, 3), optional
        A box, (low, high) in the world, around the part of the surface to cover; by default all of it.

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
        """Add frusta, and choose the last of them."""
        sized = tuple(one.resized(self.size) if one.camera.size != (self.size,) * 2 else one for one in frusta)

        def added(state: State) -> State:
            together = (*state.frusta, *sized)
            if len(together) > _COUNT_MAX:
                raise ArgumentError("frusta", f"at most {_COUNT_MAX}", str(len(together)))
            return replace(state, frusta=together, chosen=len(together) - 1 if together else None)

        self._change(added)

    def delete(self) -> None:
        """Delete the chosen frustum, if any."""

        def deleted(state: State) -> State:
            if state.chosen is None:
                return state
            left = state.frusta[: state.chosen] + state.frusta[state.chosen + 1 :]
            return replace(state, frusta=left, chosen=min(state.chosen, len(left) - 1) if left else None)

        self._change(deleted)

    def put(self, changed: Callable[[Frustum], Frustum], gesture: object = None) -> None:
        """Replace the chosen frustum, if any, by `changed` of it; a gesture is undone in one step."""

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
        """Set the chosen frustum's angles, in degrees, and far plane."""
        self.put(lambda frustum: frustum.opened(across, down, far), gesture)

    def paint(self, point: tuple[float, float], radius: float, erases: bool = False, gesture: object = None) -> None:
        """Mark parts of the chosen frustum's image as empty; see `Stroke`. A gesture's points form one stroke."""

        def painted(frustum: Frustum) -> Frustum:
            goes_on = gesture is not None and gesture == self._gesture and frustum.strokes
            before = frustum.strokes[:-1] if goes_on else frustum.strokes
            points = (*frustum.strokes[-1].points, point) if goes_on else (point,)
            return replace(frustum, strokes=(*before, Stroke(points, radius, erases)))

        self.put(painted, gesture)

    def clean(self) -> None:
        """Remove all paint from the chosen frustum's image."""
        self.put(lambda frustum: replace(frustum, strokes=()))

    def look_from(self, side: Side) -> None:
        """Show another side of the surface."""
        one_of("side", side, Side)
        self._change(lambda state: replace(state, side=side))

    def choose(self, number: int | None) -> None:
        """Choose a frustum by its number, or none; this cannot be undone."""
        with self.lock:
            if number is not None and not 0 <= number < len(self.state.frusta):
                raise ArgumentError("number", f"a number below {len(self.state.frusta)}", str(number))
            if number == self.state.chosen:
                return
            self.state, self._gesture = replace(self.state, chosen=number), None
            self._tell()

    # ---- undo

    def undo(self) -> None:
        """Undo the last change, if any."""
        self._step(self._past, self._future)

    def redo(self) -> None:
        """Redo the last undone change, if nothing was changed since."""
        self._step(self._future, self._past)

    @property
    def steps(self) -> tuple[int, int]:
        """The numbers of changes that can be undone and redone."""
        return len(self._past), len(self._future)

    # ---- files

    @property
    def about(self) -> dict[str, Any]:
        """The set's entries in files, besides its frusta."""
        part = {} if self.within is None else {"within": self.within.tolist()}
        return {"side": self.state.side} | part

    def save(self, folder: str | PathLike[str], views: Sequence[DepthImage]) -> None:
        """Write the set with the images of its frusta; `pyibr.load` and `load` read it."""
        save_set(folder, self.state.frusta, views, **self.about)

    def load(self, path: str | PathLike[str]) -> None:
        """Replace all frusta by a set's folder or JSON file; this can be undone.

        Raises
        ------
        FileFormatError
            If the file has another content.
        """
        self.take(*load_frusta(path))

    def take(self, frusta: Sequence[Frustum], about: dict[str, Any]) -> None:
        """Replace all frusta, and the set's entries in their file."""
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
