"""The set of frusta that a page edits: changes, undo and captured images; the picture in the corner and its brush."""

from __future__ import annotations

import threading

import numpy as np
import pytest

import pyibr as ibr
from pyibr.app.place.captures import Captures
from pyibr.app.place.inset import draw_inset, inset_box, inset_position, own_picture
from pyibr.app.place.model import Placement, State
from pyibr.capture import models
from pyibr.capture.coverage import surface_of, unseen_share
from pyibr.capture.frusta import Frustum, Stroke, load_frusta, part_of, save_frusta

SIZE = 64


def frustum(x: float = 0.0, size: int = SIZE) -> Frustum:
    return Frustum.look_at((x, 0.3, 3), (0, 0, 0), (0, 1, 0), size, far=5.0)


def filled(count: int = 3) -> Placement:
    placement = Placement(SIZE)
    for number in range(count):
        placement.add(frustum(0.1 * number))
    return placement


def test_frusta_are_added_chosen_and_deleted():
    placement = filled()
    assert (len(placement.state.frusta), placement.state.chosen) == (3, 2)
    placement.choose(0)
    placement.delete()
    assert placement.state.frusta == (frustum(0.1), frustum(0.2)) and placement.state.chosen == 0
    placement.delete()
    placement.delete()
    placement.delete()
    assert placement.state == State((), None)
    placement.add(frustum(size=17))
    assert placement.state.frusta[0].camera.size == (SIZE, SIZE)
    with pytest.raises(ibr.ArgumentError, match="number"):
        placement.choose(1)
    with pytest.raises(ibr.ArgumentError, match="at most 256"):
        placement.add(*[frustum()] * 256)


def test_every_change_can_be_undone_and_redone():
    placement, pose = filled(2), frustum(1.0).camera.world_from_camera
    changes = [
        lambda: placement.add(frustum(0.7)),
        lambda: placement.move(pose),
        lambda: placement.open(30, 50, 2.0),
        lambda: placement.paint((0.5, 0.5), 0.1),
        lambda: placement.clean(),
        lambda: placement.look_from("back"),
        lambda: placement.delete(),
    ]
    states = [placement.state]
    for change in changes:
        change()
        assert placement.state != states[-1]
        states.append(placement.state)
    assert placement.steps == (2 + len(changes), 0)
    for expected in states[-2::-1]:
        placement.undo()
        assert placement.state == expected
    for expected in states[1:]:
        placement.redo()
        assert placement.state == expected
    placement.redo()
    assert placement.state == states[-1]
    placement.undo()
    placement.add(frustum(0.9))
    assert placement.steps[1] == 0
    for _ in range(99):
        placement.undo()
    assert placement.state == State()


def test_a_gesture_is_undone_as_one():
    placement, gesture = filled(1), object()
    before = placement.state
    for x in np.linspace(0, 1, 20):
        placement.move(frustum(x).camera.world_from_camera, gesture)
    moved = placement.state
    placement.move(frustum(2.0).camera.world_from_camera, object())
    placement.undo()
    assert placement.state == moved
    placement.undo()
    assert placement.state == before


def test_a_gesture_of_the_brush_is_one_stroke():
    placement, gesture = filled(1), object()
    for x in (0.1, 0.2, 0.3):
        placement.paint((x, 0.5), 0.1, gesture=gesture)
    placement.paint((0.9, 0.5), 0.05, True, object())
    strokes = placement.state.frusta[0].strokes
    assert strokes == (Stroke(((0.1, 0.5), (0.2, 0.5), (0.3, 0.5)), 0.1), Stroke(((0.9, 0.5),), 0.05, True))
    placement.undo()
    placement.undo()
    assert placement.state.frusta[0].strokes == ()


def test_what_is_impossible_changes_nothing():
    placement = filled(1)
    before = placement.state, placement.steps
    with pytest.raises(ibr.ArgumentError, match="fov"):
        placement.open(0, 40, 3)
    with pytest.raises(ibr.ArgumentError, match="side"):
        placement.look_from("left")
    with pytest.raises(ibr.ArgumentError, match="world_from_camera"):
        placement.move(np.ones((4, 4)))
    placement.put(lambda frustum: frustum)
    placement.choose(0)
    assert (placement.state, placement.steps) == before
    empty = Placement(SIZE)
    empty.move(np.eye(4))
    empty.open(10, 10, 1)
    empty.paint((0, 0), 0.1)
    empty.clean()
    empty.undo()
    assert empty.state == State()


def test_who_listens_hears_of_each_change_and_choice():
    placement, heard = Placement(SIZE), []
    placement.listeners.append(lambda: heard.append(placement.state))
    placement.add(frustum())
    placement.choose(None)
    placement.choose(None)
    placement.undo()
    assert heard == [State((frustum(),), 0), State((frustum(),), None), State()]


def test_changes_from_many_threads_are_all_there_and_can_be_undone():
    placement = Placement(SIZE)
    threads = [threading.Thread(target=lambda k=k: placement.add(frustum(0.01 * k))) for k in range(40)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(placement.state.frusta) == 40
    for left in range(39, -1, -1):
        placement.undo()
        assert len(placement.state.frusta) == left


def test_a_set_is_saved_and_opened_again(tmp_path):
    placement = filled(2)
    placement.paint((0.5, 0.5), 0.2)
    placement.look_from("both")
    captures = Captures(surface_of(models.donut(), count=500), None)
    views = captures.views(placement.state.frusta)
    placement.save(tmp_path / "set", views)
    save_frusta(tmp_path / "frusta.json", placement.state.frusta, **placement.about)
    for name in ("set", "frusta.json"):
        again = Placement(SIZE)
        again.load(tmp_path / name)
        assert again.state == State(placement.state.frusta, 0, "both")
        again.undo()
        assert again.state == State()
    smaller = Placement(32)
    smaller.load(tmp_path / "set")
    assert smaller.state.frusta[0].camera.size == (32, 32)
    for found, expected in zip(ibr.load(tmp_path / "set"), views, strict=True):
        np.testing.assert_array_equal(found.depth, expected.depth)
    with pytest.raises(ibr.FileFormatError, match="none"):
        placement.load(tmp_path / "none")


def test_a_set_says_which_part_it_covers(tmp_path):
    box = np.array([[0.0, -2.0, -2.0], [2.0, 2.0, 2.0]])
    placement = Placement(SIZE, box)
    placement.add(frustum())
    save_frusta(tmp_path / "part.json", placement.state.frusta, **placement.about)
    frusta, about = load_frusta(tmp_path / "part.json")
    assert frusta == [frustum()] and about == placement.about == {"side": "front", "within": box.tolist()}
    np.testing.assert_array_equal(part_of(about, "part.json"), box)
    assert part_of({"side": "front"}, "part.json") is None
    for bad in (3, [[1, 0, 0], [0, 1, 1]], "all"):
        with pytest.raises(ibr.FileFormatError, match=r"part\.json: within: expected"):
            part_of({"within": bad}, "part.json")


# ---- captures


def test_images_are_made_once_and_as_long_as_they_are_wanted(monkeypatch: pytest.MonkeyPatch):
    captures, made = Captures(surface_of(models.donut(), count=2000), None), []
    whole = Frustum.capture
    monkeypatch.setattr(Frustum, "capture", lambda self, *rest: made.append(self) or whole(self, *rest))
    one, other = frustum(), frustum(1.0)
    first = captures.views([one, other])
    assert captures.views([one, other]) == first
    assert len(made) == 2
    painted = one.painted(Stroke(((0.5, 0.2),), 0.2))
    view = captures.views([painted, other])[0]
    assert len(made) == 2  # a painted stroke needs no new capture
    np.testing.assert_array_equal(view.depth, painted.capture(models.donut()).depth)
    assert captures.nearest(painted) == view.depth[view.valid].min()
    assert captures.nearest(one) is None
    captures.views([other])
    captures.views([one, other])
    assert len(made) == 4  # one more by the comparison above, one for the image that was dropped


def test_the_share_is_of_all_frusta():
    surface = surface_of(models.donut(), count=2000)
    captures, frusta = Captures(surface, None), (frustum(), frustum(2.0))
    masks = [surface.seen(one.capture(models.donut())) for one in frusta]
    assert captures.unseen(frusta, "front") == unseen_share(surface, masks)
    assert captures.unseen((), "front") == 1.0 and captures.unseen(frusta, "back") > 0.9


# ---- the corner


@pytest.mark.parametrize("size", [(640, 480), (480, 640), (61, 37), (7, 13), (1, 1), (2000, 200)])
def test_the_corner_is_within_the_page_and_its_places_are_told(size):
    left, top, side = inset_box(size)
    assert left >= 0 and top >= 0 and left + side <= size[0] and top + side <= size[1]
    for part in ((0.0, 0.0), (0.25, 0.75), (1.0, 1.0)):
        at = (left + part[0] * side) / size[0], (top + part[1] * side) / size[1]
        found = inset_position(size, at)
        if found is not None:  # at its border, rounding may give None
            np.testing.assert_allclose(found, part, atol=1e-9)
    assert inset_position((640, 480), (0.9, 0.1)) is None


def test_the_chosen_ones_picture_is_put_into_the_corner_also_of_a_coarser_page():
    own = np.random.default_rng(0).integers(0, 255, (64, 64, 3)).astype(np.uint8)
    for scale in (1.0, 0.5, 0.125):
        page = np.zeros((round(480 * scale), round(640 * scale), 3), np.uint8)
        draw_inset(page, own, (640, 480))
        left, top, side = (round(scale * value) for value in inset_box((640, 480)))
        shown = page[top : top + side, left : left + side]
        np.testing.assert_array_equal(shown[0, 0], own[0, 0])
        np.testing.assert_array_equal(shown[side // 2, side // 2], own[side // 2 * 64 // side, side // 2 * 64 // side])
        assert (page[: top - 4] == 0).all()
    draw_inset(np.zeros((1, 1, 3), np.uint8), own, (1, 1))


def test_depth_is_dark_far_away_and_paint_is_seen():
    plate = ibr.Mesh([[-3, -3, 0], [3, -3, 0], [3, 3, -6], [-3, 3, -6]], [[0, 1, 2], [0, 2, 3]])
    one = Frustum.look_at((0, 0, 5), (0, 0, -3), (0, 1, 0), 32, far=9.0).painted(Stroke(((0.1, 0.9),), 0.1))
    view = one.capture(plate)
    row = view.depth[:, 16]
    down = np.flatnonzero(view.valid[:, 16])
    for kind in ("depth", "disparity"):
        grey = own_picture(view, kind, one.mask)[down, 16, 0].astype(int)
        assert (np.diff(grey) * np.diff(-row[down]) >= 0).all() and grey.max() > 240
        assert grey.min() < 40
    for kind in ("colors", "depth", "disparity"):
        assert (own_picture(view, kind, one.mask)[one.mask] == (200, 0, 200)).all()
    np.testing.assert_array_equal(own_picture(view, "colors", one.mask)[view.valid], view.color[view.valid])
