"""Random calls keep the law; `make fuzz` makes many more.

They run in separate processes, so that a crash or an endless kernel is also reported with its seed.
"""

from __future__ import annotations

import sys

import pytest

import pyibr as ibr
from tests.attack.arguments import Call
from tests.attack.law import BrokenLawError, checked, judge
from tests.warp.test_bad_input import CAMERA, VIEW
from tools.processes import run_python


@pytest.mark.thorough
@pytest.mark.parametrize(
    ("kind", "first", "count"),
    [
        ("warp", 0, 450),
        ("render", 0, 75),  # few, because each call builds kernels that no other call uses
        ("register", 0, 250),
        ("clean", 0, 100),
        ("rays", 0, 150),
    ],
)
def test_random_calls_obey_the_law(kind, first, count):
    done = run_python("-m", "tests.attack", kind, "--first", str(first), "--count", str(count))
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-2000:]}"


def changed(**fields: object) -> ibr.Frame:
    frame = ibr.warp(VIEW, CAMERA.moved(0.3, 0, 0))
    return ibr.Frame(**{**vars(frame), **fields})  # pyright: ignore[reportArgumentType]


def test_the_law_tells_frames_that_are_unsound():
    sound = changed()
    assert (~sound.valid).any()
    assert len(checked(sound, {})) == 3
    for name, value in (
        ("color", sound.color[:-1]),
        ("color", sound.color.astype(int)),
        ("color", sound.color + 1),
        ("depth", sound.depth.astype(float)),
        ("depth", -sound.depth),
        ("depth", sound.depth * float("inf")),
        ("depth", sound.depth * 0),
        ("valid", ~sound.valid),
        ("valid", sound.valid.astype(int)),
    ):
        with pytest.raises(BrokenLawError):
            checked(changed(**{name: value}), {})


def test_the_law_tells_calls_that_differ_or_fail(monkeypatch):
    calls = []

    def made_by(seed: int) -> Call:
        calls.append(seed)
        return Call(lambda: ibr.warp(VIEW, CAMERA.moved(0.1 * len(calls), 0, 0)))

    monkeypatch.setitem(sys.modules["tests.attack.law"].MAKERS, "warp", made_by)
    with pytest.raises(BrokenLawError, match="two results"):
        judge("warp", 5)
    monkeypatch.setitem(sys.modules["tests.attack.law"].MAKERS, "warp", lambda seed: Call(lambda: 1 / 0))
    with pytest.raises(ZeroDivisionError):
        judge("warp", 5)
