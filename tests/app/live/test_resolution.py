"""While the camera moves, the resolution falls as far as necessary, and rises again."""

from __future__ import annotations

import pytest

from pyibr.app.live.resolution import Resolution


def settled(fixed: float, per_picture: float, allowed: float = 1 / 30, frames: int = 40) -> Resolution:
    """Resolution after frames that take the time `fixed`, and `per_picture` for all pixels at full resolution."""
    resolution = Resolution(allowed)
    for _ in range(frames):
        resolution.took(fixed + per_picture * resolution.scale**2)
    return resolution


@pytest.mark.parametrize(
    ("fixed", "per_picture", "scale"),
    [
        (0, 0.02, 1.0),
        (0, 0.05, 0.75),  # 0.05 * 0.75^2 = 0.028
        (0, 0.1, 0.5),
        (0, 0.5, 0.25),
        (0, 2.0, 0.125),
        (0.03, 0.001, 1.0),
        (0.05, 0.019, 0.75),  # no scale reaches 33 ms: it falls until pixels take at most 0.3 of the fixed time
        (0.2, 0.05, 0.75),
    ],
)
def test_frames_take_no_longer_than_allowed_if_pixels_are_what_costs(fixed, per_picture, scale):
    assert settled(fixed, per_picture).scale == scale


def test_it_does_not_swing():
    resolution = settled(0, 0.05)
    scales = set()
    for number in range(60):
        resolution.took(0.05 * resolution.scale**2 * (1.1 if number % 2 else 0.9))
        scales.add(resolution.scale)
    assert scales == {0.75}


def test_it_comes_back_once_frames_are_fast():
    resolution = settled(0, 0.5)
    for _ in range(60):
        resolution.took(0.01 * resolution.scale**2)
    assert resolution.scale == 1.0


def test_sizes_have_at_least_a_pixel():
    resolution = settled(0, 9.0)
    assert resolution.size((640, 480)) == (80, 60) and resolution.size((3, 1)) == (1, 1)


def test_it_does_not_fall_below_the_least_scale():
    resolution = Resolution(1 / 30, least=0.5)
    scales = set()
    for _ in range(20):
        resolution.took(2.0 * resolution.scale**2)
        scales.add(resolution.scale)
    assert min(scales) == 0.5
