"""Profiles of kinds of devices: parameters of builds, launches and memory."""

from __future__ import annotations

from dataclasses import dataclass

from pyibr.opencl.runtimes import Kind


@dataclass(frozen=True)
class DeviceProfile:
    """Parameters of builds, launches and memory for a kind of device. The defaults are for CPUs."""

    lanes: int = 16
    """Neighbours that a work-item computes together (``LANES``): CPU compilers do not vectorize code with branches."""
    in_place: bool = True
    """Whether kernels work in the host's memory: on a CPU it is the same memory, on a GPU the device's is faster."""
    group: tuple[int, int, int] = (1, 1, 1)
    """Work-items of a work-group along x, y and z; 1 on CPUs, whose work-items are large."""
    bin: int = 32
    """Side of a bin of the rasteriser in pixels: primitives are set up once per bin on CPUs, once per pixel on GPUs."""
    chunks: int = 32
    """Work-items that bin primitives: a GPU needs many, but each takes a row of counts."""
    drawers: int = 64
    """Work-items that draw depth meshes, each one region of pixels after the other. Each needs memory for every mesh,
    which should fit in a CPU's caches."""
    segment: int = 0
    """Pixels of an epipolar line per work-item of the sweep; 0 for the whole line."""
    strip: int = 32
    """Packets of a row per work-item: STRIP of kernels/lib/lanes.h, which follows from LANES."""
    run: int = 64
    """Pixels of a row that a work-item fills: on a CPU, starting a work-item takes longer than most pixels."""
    piece: int = 0
    """Samples of a row per work-item of the kernels that find surfaces, a multiple of `lanes`; 0 for the whole row."""
    band: int = 32
    """Rows of a band for which a work-item finds the surface in one launch; 0 for several launches over pieces."""
    share: int = 1 << 11
    """Elements of an array that a work-item sets or converts: more on CPUs, for the reason given at `run`."""
    block: int = 4
    """Side of the square of pixels that the lanes cover in a bin: BLOCK of kernels/raster/region.h, from LANES."""

    def packets(self, width: int, height: int, strip: int = 1) -> tuple[int, int]:
        """Return the grid of work-items for all pixels, if each processes `strip` times `lanes` pixels of a row."""
        return -(-width // (strip * self.lanes)), height

    def pieces(self, width: int) -> tuple[int, int]:
        """Return the number of samples per piece of a row, and the number of pieces."""
        piece = self.piece or width
        return piece, -(-width // piece)

    def shares(self, count: int) -> tuple[int]:
        """Return the number of work-items for `count` elements, `share` each."""
        return (-(-count // self.share),)

    def grid(self, bins: tuple[int, int], pixels: tuple[int, int]) -> tuple[int, int]:
        """Return the grid of work-items that draw a picture's bins: one per bin with lanes, or one per pixel."""
        return pixels if self.lanes == 1 else bins


CPU = DeviceProfile()
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
    """Return the profile of a kind of device; accelerators use the GPU profile."""
    return CPU if kind == "cpu" else GPU
