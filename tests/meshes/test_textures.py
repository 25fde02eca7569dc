"""Levels of textures compared with means over areas by OpenCV."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from pyibr.meshes.textures import halved, rgba_words, texture_pyramid

SIZES = [(1, 1), (7, 13), (61, 37), (64, 32), (1, 9), (5, 1), (2, 3), (255, 512)]


def area_means(image: np.ndarray) -> np.ndarray:
    height, width = max(image.shape[0] // 2, 1), max(image.shape[1] // 2, 1)
    made = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return made.reshape(height, width, *image.shape[2:])


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("channels", [(), (3,), (4,)])
def test_halves_are_means_over_areas(size: tuple[int, int], channels: tuple[int, ...]) -> None:
    image = np.random.default_rng(0).random((*size, *channels)).astype(np.float32)
    made = halved(image)
    assert made.dtype == np.float32
    np.testing.assert_allclose(made, area_means(image), atol=5e-7)


@pytest.mark.parametrize("size", SIZES)
def test_a_pyramid_holds_all_levels_as_words(size: tuple[int, int]) -> None:
    level = np.random.default_rng(0).integers(0, 256, (*size, 3), dtype=np.uint8)
    words, start = texture_pyramid(level), 0
    while True:
        count = level.shape[0] * level.shape[1]
        made = words[start : start + count].view(np.uint8).reshape(*level.shape[:2], 4)
        assert (made[..., 3] == 255).all()
        # atol=1: pyibr computes in float32, so it may round a mean between two bytes to another byte than OpenCV.
        np.testing.assert_allclose(made[..., :3].astype(int), level, atol=1)
        start += count
        if count == 1:
            break
        level = area_means(made[..., :3])
    assert start == len(words)


def test_words_say_what_is_valid() -> None:
    color = np.array([[[0.0, 0.5, 1.0], [1.0, 2.0, -1.0]]], np.float32)
    words = rgba_words(color, np.array([[True, False]]))
    assert words.view(np.uint8).reshape(2, 4).tolist() == [[0, 128, 255, 255], [255, 255, 0, 0]]
