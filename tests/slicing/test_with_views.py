"""`with_views` for objects and hulls: the result has the bits of a new one, and data that stays is not made again."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
import pytest

import pyibr as ibr
from pyibr.slicing import boxes, solid
from pyibr.slicing import hull as hulls
from tests.slicing.solids import looking, torus, views_of_torus
from tests.slicing.test_objects import KINDS

CAMERA = looking(torus(), (0.5, 0.4, 1), (61, 47))


def nearer(view: ibr.DepthImage, by: float) -> ibr.DepthImage:
    """The view in other colours, with `by` added to its depth; holes stay holes."""
    return ibr.DepthImage(255 - view.color, view.depth + np.float32(by), view.camera)


def turned(view: ibr.DepthImage) -> ibr.DepthImage:
    """The view without depth in its lower half, and with a moved camera."""
    depth = view.depth.copy()
    depth[len(depth) // 2 :] = np.nan
    return ibr.DepthImage(view.color, depth, view.camera.moved(0.02, -0.01, 0.03))


def changes(views: Sequence[ibr.DepthImage]) -> list[list[ibr.DepthImage]]:
    """Sets of views, the first without a change, the others with changes of one view, of several or of all."""
    return [
        list(views),
        [nearer(views[0], 0.01), *views[1:]],
        [nearer(views[0], -0.3), *views[1:]],  # a larger box
        [*views[:-1], ibr.DepthImage(255 - views[-1].color, views[-1].depth, views[-1].camera)],  # colours alone
        [views[0], turned(views[1]), *views[2:]],
        [nearer(view, 0.02) for view in views],
        [*views[1:], views[0]],  # another first view, which gives other axes
        list(views[:3]),
        [*views, turned(views[2]), views[0]],
    ]


def same(expected: ibr.DepthObject | ibr.VisualHull, *found: ibr.DepthObject | ibr.VisualHull) -> None:
    """Pictures and boxes are equal. Objects have normals, so their lit pictures are equal, too."""
    light = ibr.Light(direction=(0.3, -0.4, -1), shadow_size=64)
    for lit in (None, light) if isinstance(expected, ibr.DepthObject) else (None,):
        a = ibr.render(expected, CAMERA, lit)
        for b in (ibr.render(one, CAMERA, lit) for one in found):
            np.testing.assert_array_equal(a.depth, b.depth)
            np.testing.assert_array_equal(a.color, b.color)
    for one, name in product(found, ("low", "high", "axes")):
        np.testing.assert_array_equal(getattr(one.box, name), getattr(expected.box, name))


@pytest.mark.thorough
@pytest.mark.parametrize(("kind", "missing"), [*((kind, "empty") for kind in KINDS), ("nine, anywhere", "unknown")])
def test_an_object_is_as_a_new_one(kind, missing):
    views = views_of_torus(kind)
    how = {"slices": 48, "slicing": "screen", "texture": "naive", "halvings": 3, "missing": missing}
    first = thing = ibr.DepthObject(views, **how)
    ibr.render(first, CAMERA)
    before = ibr.render(first, CAMERA)
    for others in changes(views):
        thing = thing.with_views(others)  # from the previous one, as in an animation
        same(ibr.DepthObject(others, **how), first.with_views(others), thing)
    np.testing.assert_array_equal(ibr.render(first, CAMERA).color, before.color)


@pytest.mark.parametrize("kind", ["orthographic", "nine, anywhere"])
def test_a_hull_is_as_a_new_one(kind):
    views = views_of_torus(kind)
    first = thing = ibr.VisualHull(views, slices="view")
    ibr.render(first, CAMERA)
    for others in changes(views):
        thing = thing.with_views(others)
        same(ibr.VisualHull(others, slices="view"), thing)
        assert thing.tested == ibr.VisualHull(others).tested
    outlines: list[ibr.Silhouette | ibr.DepthImage] = [ibr.Silhouette(v.color, v.valid, v.camera) for v in views]
    same(ibr.VisualHull(outlines, slices="view"), first.with_views(outlines))


def test_what_stays_is_not_made_again(monkeypatch):
    views = views_of_torus("orthographic")
    thing = ibr.DepthObject(views, slices=48)
    ibr.render(thing, CAMERA)
    made: list[object] = []
    for room, name in ((solid, "rgba_words"), (boxes, "DepthExtent")):
        real = getattr(room, name)
        monkeypatch.setattr(room, name, lambda *given, real=real, name=name: made.append(name) or real(*given))
    depth = views[0].depth.copy()
    seen = np.where(views[0].valid, depth, np.nan)
    middle = np.unravel_index(np.nanargmin(np.abs(seen - np.nanmedian(seen))), depth.shape)
    depth[middle] += np.float32(0.01)  # far from the box's sides, so that the box stays
    ibr.render(thing.with_views([ibr.DepthImage(views[0].color, depth, views[0].camera), *views[1:]]), CAMERA)
    assert sorted(made) == ["DepthExtent", "rgba_words"]


def test_a_hull_asks_the_new_outline_alone_for_what_it_says(monkeypatch):
    views = views_of_torus("orthographic")
    thing = ibr.VisualHull(views, slices=48)
    ibr.render(thing, CAMERA)
    ibr.render(ibr.VisualHull(views[1:], slices=48), CAMERA)  # this hull tests the view opposite to the first
    made: list[object] = []
    asked: list[int] = []
    for name in ("touches", "holds"):
        real = getattr(boxes.Outline, name)
        monkeypatch.setattr(boxes.Outline, name, lambda *given, real=real: asked.append(len(given[1])) or real(*given))
    for room, name in ((hulls, "mask_of"), (solid, "rgba_words"), (boxes, "Outline")):
        real = getattr(room, name)
        monkeypatch.setattr(room, name, lambda *given, real=real, name=name: made.append(name) or real(*given))
    mask = views[0].valid.copy()
    mask[np.unravel_index(np.flatnonzero(mask)[:40], mask.shape)] = False
    bitten = ibr.Silhouette(views[0].color, mask, views[0].camera)
    ibr.render(thing.with_views([bitten, *views[1:]]), CAMERA)
    assert sorted(made) == ["Outline", "mask_of", "rgba_words"]
    # Only cells at the box's sides are tested. A full grid, 64 cells a side, has 260,000 cells for each view.
    assert 1000 < sum(asked) < len(views) * 64**3 / 10


def test_a_hull_in_other_colours_is_not_drawn_again(monkeypatch):
    views = [ibr.Silhouette(view.color, view.valid, view.camera) for view in views_of_torus("orthographic")]
    thing = ibr.VisualHull(views, slices=48)
    first = ibr.render(thing, CAMERA)
    monkeypatch.setattr(hulls, "draw_object", None)
    frame = ibr.render(thing.with_views([ibr.Silhouette(255 - v.color, v.valid, v.camera) for v in views]), CAMERA)
    # Colours are rounded once in each picture.
    assert np.abs(255 - first.color[first.valid].astype(int) - frame.color[first.valid]).max() <= 1


def test_other_views_are_checked_as_the_first_ones():
    views = views_of_torus("orthographic")
    nothing = ibr.DepthImage(views[0].color, np.full_like(views[0].depth, np.nan), views[0].camera)
    for thing in (ibr.DepthObject(views), ibr.VisualHull(views)):
        for bad in ([], None, views[0], [*views, 3], [*views, nothing]):
            messages: list[str] = []
            for take in (thing.with_views, type(thing)):
                with pytest.raises(ibr.ArgumentError, match=r"^views: ") as caught:
                    take(bad)
                messages.append(str(caught.value))
            assert messages[0] == messages[1]
