"""Profiles of kinds of devices: options of builds and launches, and where arrays lie."""

from __future__ import annotations

from dataclasses import dataclass

from pyibr.opencl.runtimes import Kind


@dataclass(frozen=True)
class DeviceProfile:
    """Parameters of builds, launches and memory for a kind of device."""

    lanes: int
    """Neighbours that a work-item computes at once (``LANES``): compilers for CPUs leave scalar what branches."""
    in_place: bool
    """Whether kernels use the host's memory: a CPU's is the same, a GPU's own is much faster."""
    group: tuple[int, int, int]
    """Work-items of a work-group along a row, across rows, and beyond: a CPU's are large enough to stand alone."""
    bin: int
    """Side of a bin of the rasteriser in pixels: a CPU's work-item sets up what is there once, a GPU's for a pixel."""
    chunks: int
    """Parts that primitives are binned in, a work-item each: a GPU needs many, and each takes a row of counts."""
    drawers: int
    """Work-items that draw depth meshes, a region of pixels after the other: each has memory for what it sees of every
    mesh, which a CPU's caches are to hold."""
    segment: int
    """Pixels of an epipolar line that a work-item of the sweep settles, each walked for on its own; 0: all."""
    strip: int
    """Packets of a row that a work-item goes through: STRIP of kernels/lib/lanes.h, told by LANES."""
    run: int
    """Pixels of a row that a work-item fills: on a CPU, starting one takes longer than most pixels."""
    piece: int
    """Samples of a row that a work-item goes through where a view's surface is found, a multiple of `lanes`; 0: all."""
    band: int
    """Rows of a band that a work-item makes a surface of, in one launch; 0: in several, of pieces."""
    share: int
    """Elements of an array that a work-item sets or converts, for the same reason."""
    block: int
    """Side of the square of pixels that the lanes are in a bin: BLOCK of kernels/raster/region.h, told by LANES."""

    def packets(self, width: int, height: int, strip: int = 1) -> tuple[int, int]:
        """Work-items for all pixels, if each takes `strip` times `lanes` pixels of a row."""
        return -(-width // (strip * self.lanes)), height

    def pieces(self, width: int) -> tuple[int, int]:
        """Samples of a `piece` of a row of so many, and how many pieces that makes."""
        piece = self.piece or width
        return piece, -(-width // piece)

    def shares(self, count: int) -> tuple[int]:
        """Work-items for so many elements, `share` each."""
        return (-(-count // self.share),)

    def grid(self, bins: tuple[int, int], pixels: tuple[int, int]) -> tuple[int, int]:
        """Work-items that draw a picture's bins: one goes through a whole bin in its lanes, or through a pixel."""
        return pixels if self.lanes == 1 else bins


CPU = DeviceProfile(
    lanes=16,
    in_place=True,
    group=(1, 1, 1),
    bin=32,
    chunks=32,
    drawers=64,
    segment=0,
    strip=32,
    run=64,
    piece=0,
    band=32,
    share=1 << 11,
    block=4,
)
GPU = DeviceProfile(
    lanes=1,
    in_place=False,
    group=(32, 4, 1),
    bin=16,
    chunks=1024,
    drawers=1 << 17,
    segment=20,
    strip=1,
    run=1,
    piece=16,
    band=0,
    share=1,
    block=1,
)


def profile_of(kind: Kind) -> DeviceProfile:
    """The profile of a kind of device; accelerators are taken for GPUs."""
    return CPU if kind == "cpu" else GPU
