"""Cases of each benchmark, for full and quick runs: data only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from benchmarks.scenes import LIVINGROOM, MOTIONS, REGIONS, ROOM

Size = tuple[int, int]  # width, height
Position = tuple[str, str]  # region of the epipole, motion of the target camera

EVERY_REGION: tuple[Position, ...] = tuple((region, MOTIONS[i % 2]) for i, region in enumerate(REGIONS))


@dataclass(frozen=True)
class Plan:
    """Sizes are sides of square images, or (width, height), in pixels.

    In each turn, every subject of a case is timed once. Numbers in mappings are numbers of turns, unless noted.
    """

    complexity_positions: tuple[Position, ...]
    complexity: Mapping[str, Mapping[int, int]]  # by subject and size
    table2: Mapping[int, int]
    dragon_mesh: str
    peers_positions: tuple[Position, ...]
    peers: Mapping[int, int]
    open3d_largest: int  # side of the largest image whose triangles go to Open3D
    raster: Mapping[tuple[str, int], int]  # turns by mesh and side
    slicing: Mapping[tuple[int, int], int]  # turns by side and number of slices
    donut: int  # turns
    elevations: tuple[int, ...]  # degrees of cameras above the surface, to compare directions of slicing
    direction_slices: tuple[int, ...]
    relief_plane: int  # turns
    relief_scenes: Mapping[str, int]  # turns by scene
    relief_steps: tuple[int, ...]  # steps of the linear search
    displaced: Mapping[Size, int]  # turns by size
    displaced_truth: int  # pieces of each side of the truth's triangles
    depthmesh_side: int  # side of the depth images and the pictures
    depthmesh_models: Mapping[str, int]  # turns by model
    depthmesh_tolerances: tuple[float, ...]  # pixels
    depthmesh_quality: tuple[str, int]  # model, and number of cameras in random directions
    depthmesh_warp: int  # turns
    depthmesh_moving: int  # turns
    simplification: Mapping[str, int]  # turns by surface
    decimation: Mapping[str, int]
    gaussians: Mapping[int, int]  # number of pictures by number of Gaussians
    gaussians_size: Size
    gaussians_peer: int  # number of pictures
    rgbd_scene: str
    rgbd: Mapping[Size, int]
    rgbd_noise: tuple[float, ...]  # pixels of disparity
    rgbd_connected: tuple[Size, ...]  # sizes at which a warp without cuts at depth edges is timed, too
    rgbd_threads: Mapping[tuple[Size, float], int]  # number of processes for each number of threads, by size and noise
    rgbd_white: Mapping[Size, int]
    rgbd_stereo: Mapping[tuple[Size, float], int]  # turns by size and noise
    rgbd_light_field: Mapping[tuple[int, int], int]  # turns by side and number of views
    rgbd_together: Mapping[tuple[Size, int], int]  # turns by size and number of views
    rgbd_told: Mapping[Size, int]
    rgbd_small: Mapping[int, int]
    rgbd_steady: Mapping[Size, int]  # number of frames
    filling: Size
    edges: tuple[Size, ...]
    edge_scenes: int  # only every n-th scene is measured
    registration: Mapping[Size, int]
    tensors: Mapping[Size, int]
    tensors_path: Mapping[Size, int]
    cleaning: Mapping[Size, int]
    runtimes: Mapping[Size, int]
    pages_size: Size
    pages_rounds: int
    pages_seconds: float  # how long the camera moves in each round
    pages_chromium: bool
    gpu: Mapping[tuple[str, Size], Size | None]  # by call and its size: a smaller size, to count instructions
    card: str  # kind of device
    card_tests: tuple[str, ...]
    startup_repeats: int
    startup_empty_cache: bool  # whether the first process has to build the kernels
    memory: tuple[int, ...]
    pythons: tuple[Path, ...] = ()  # interpreters whose OpenCL runtimes are measured


FULL = Plan(
    complexity_positions=(("A", "forward"), ("E", "backward"), ("F", "forward")),
    complexity={
        "epipolar": {128: 15, 256: 11, 512: 7, 1024: 5, 2048: 3, 4096: 3},
        "epipolar, white noise": {128: 9, 256: 7, 512: 5, 1024: 3, 2048: 3, 4096: 3},
        "search": {128: 3, 256: 1, 512: 1, 1024: 1},
    },
    table2={128: 9, 256: 7, 512: 5},
    dragon_mesh="dragon_vrip.ply.gz",
    peers_positions=EVERY_REGION,
    peers={256: 15, 512: 11, 1024: 7, 2048: 5, 4096: 3},
    open3d_largest=512,
    raster={("dragon", 1024): 15, ("donut", 512): 41},
    slicing={
        **{(n, 128): 9 for n in (50, 100, 150, 200, 300, 400)},
        **{(300, slices): 9 for slices in (16, 32, 64, 256)},
        (150, 70): 15,
        (400, 150): 7,
    },
    donut=31,
    elevations=(5, 10, 20, 45, 90),
    direction_slices=(8, 16, 32, 64, 128, 256),
    relief_plane=21,
    relief_scenes={"torus": 31, "teapot": 31, "human": 15, "spot": 15, "room": 7},
    relief_steps=(8, 16, 32, 64, 128, 256, 512, 1024, 2048, 4096),
    displaced={(160, 120): 15, (640, 480): 11, (1600, 1200): 5},
    displaced_truth=75,
    depthmesh_side=512,
    depthmesh_models={"dragon": 21, "bunny": 21, "female": 21, "male": 21, "spot": 21},
    depthmesh_tolerances=(1, 4, 16),
    depthmesh_quality=("dragon", 20),
    depthmesh_warp=21,
    depthmesh_moving=5,
    simplification={"fuji": 41, "dragon, filled": 21},
    decimation={"fuji": 1, "dragon": 3},
    gaussians={200_000: 12, 500_000: 12, 1_000_000: 12},
    gaussians_size=(640, 480),
    gaussians_peer=2,
    rgbd_scene=LIVINGROOM,
    rgbd={(640, 480): 21, (1280, 720): 11, (1920, 1440): 7, (3840, 2160): 3},
    rgbd_noise=(0.0, 0.1, 0.3),
    rgbd_connected=((640, 480), (1920, 1440)),
    rgbd_threads={(size, noise): 3 for size in ((640, 480), (1920, 1440)) for noise in (0.0, 0.3)},
    rgbd_white={(640, 480): 15, (1024, 1024): 7},
    rgbd_stereo={((1280, 720), noise): 15 for noise in (0.0, 0.1, 0.3)},
    rgbd_light_field={(512, 48): 11},
    rgbd_together={((512, 512), 6): 11, ((640, 480), 100): 1},
    rgbd_told={(640, 480): 15},
    rgbd_small={64: 201},
    rgbd_steady={(640, 480): 30},
    filling=(640, 480),
    edges=((320, 240), (64, 48), (60, 45)),
    edge_scenes=1,
    registration={(640, 480): 31, (1280, 720): 21, (1920, 1080): 11},
    tensors={(640, 480): 11},
    tensors_path={(1280, 704): 5},
    cleaning={(640, 480): 15, (1280, 720): 7, (1920, 1440): 3},
    runtimes={(640, 480): 31, (1920, 1440): 11},
    pages_size=(640, 480),
    pages_rounds=5,
    pages_seconds=4.0,
    pages_chromium=True,
    gpu={
        ("warp", (1024, 1024)): (128, 128),
        ("warp, filled from behind", (1024, 1024)): (128, 128),
        ("warp sideways", (1024, 1024)): (128, 128),
        ("warp", (3840, 2160)): (240, 135),
        ("four views", (2048, 2048)): (64, 64),
        ("registration", (1280, 720)): (160, 90),
        ("relief", (512, 512)): (32, 32),
        ("depth object", (512, 512)): (32, 32),
        ("visual hull", (512, 512)): (32, 32),
        ("depth mesh", (1024, 1024)): (64, 64),
        ("dragon", (1024, 1024)): None,  # a simulator would take hours
    },
    card="gpu",
    card_tests=tuple(
        f"tests/{room}"
        for room in ("kernels", "picture", "warp", "raster", "slicing", "relief", "depthmesh", "cleaning")
    ),
    startup_repeats=5,
    startup_empty_cache=True,
    memory=(1024, 4096),
)

QUICK = Plan(
    complexity_positions=(("A", "forward"), ("E", "backward")),
    complexity={
        "epipolar": {32: 3, 64: 3, 128: 3},
        "epipolar, white noise": {32: 1, 64: 1},
        "search": {32: 1, 64: 1},
    },
    table2={96: 1},
    dragon_mesh="dragon_vrip_res3.ply.gz",
    peers_positions=(("A", "forward"), ("E", "backward")),
    peers={64: 3, 128: 3},
    open3d_largest=64,
    raster={("dragon", 64): 1, ("donut", 64): 1},
    slicing={(40, 128): 1, (80, 128): 1, (300, 8): 1, (300, 16): 1},
    donut=1,
    elevations=(20, 90),
    direction_slices=(8, 16),
    relief_plane=1,
    relief_scenes={"torus": 1, "teapot": 1},
    relief_steps=(8, 32),
    displaced={(64, 48): 1},
    displaced_truth=9,
    depthmesh_side=64,
    depthmesh_models={"donut": 1, "dragon": 1},
    depthmesh_tolerances=(1, 4),
    depthmesh_quality=("donut", 2),
    depthmesh_warp=1,
    depthmesh_moving=1,
    simplification={"relief": 1},
    decimation={"relief": 1},
    gaussians={2_000: 2},
    gaussians_size=(160, 120),
    gaussians_peer=1,
    rgbd_scene=ROOM,
    rgbd={(64, 48): 1, (96, 54): 1},
    rgbd_noise=(0.0, 0.3),
    rgbd_connected=((64, 48),),
    rgbd_threads={((64, 48), 0.0): 1},
    rgbd_white={(64, 48): 1},
    rgbd_stereo={((96, 54), 0.0): 1},
    rgbd_light_field={(32, 3): 1},
    rgbd_together={((32, 24), 3): 1},
    rgbd_told={(64, 48): 1},
    rgbd_small={16: 3},
    rgbd_steady={(64, 48): 3},
    filling=(64, 48),
    edges=((24, 18),),
    edge_scenes=10,
    registration={(64, 48): 1},
    tensors={(64, 48): 1},
    tensors_path={(64, 48): 1},
    cleaning={(64, 48): 1},
    runtimes={(64, 48): 1},
    pages_size=(320, 240),
    pages_rounds=1,
    pages_seconds=0.5,
    pages_chromium=False,
    gpu={("warp", (24, 18)): (12, 9)},
    card="gpu",
    card_tests=("tests/test_tiers.py",),
    startup_repeats=1,
    startup_empty_cache=False,
    memory=(256,),
)
