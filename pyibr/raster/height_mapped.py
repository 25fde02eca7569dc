"""Colours, normals and wrap modes of surfaces with height maps, for their kernels (kernels/lib/footprint.h)."""

from __future__ import annotations

from typing import Any

from pyibr.core.camera import Camera
from pyibr.meshes.heights import HeightMapped, Wraps
from pyibr.meshes.textures import normal_pyramid, texture_pyramid
from pyibr.opencl.memory import DeviceArray, upload


def map_buffers(surface: HeightMapped) -> dict[str, DeviceArray]:
    """Upload the colours, and the normal map if there is one, to the current device."""
    made = {"colors": upload(texture_pyramid(surface.color))}
    if surface.normal_map is not None:
        made["normal_map"] = upload(normal_pyramid(surface.normal_map))
    return made


def color_arguments(surface: HeightMapped, camera: Camera) -> dict[str, Any]:
    """Kernel arguments: the size of the colour map, and the size of a pixel at distance 1."""
    height, width = surface.color.shape[:2]
    return {
        "color_width": width,
        "color_height": height,
        "color_levels": max(width, height).bit_length(),
        "pixel_size": 1 / float(max(camera.K[0, 0], camera.K[1, 1])),
    }


def normal_arguments(surface: HeightMapped, buffers: dict[str, DeviceArray], unread: DeviceArray) -> dict[str, Any]:
    """Kernel arguments for a lit surface's normal map; without a map the size is 0, and `unread` takes its place."""
    height, width = (0, 0) if surface.normal_map is None else surface.normal_map.shape[:2]
    return {"normal_width": width, "normal_height": height, "normal_map": buffers.get("normal_map", unread)}


def wrap_defines(wrap: Wraps) -> dict[str, int]:
    """Return the defines for axes that clamp (kernels/lib/wrap.h); without a define, an axis repeats."""
    return {name: 1 for name, how in zip(("CLAMPED_U", "CLAMPED_V"), wrap, strict=True) if how == "clamp"}
