"""Pictures of the README and the manual, into docs/images: python docs/gallery/pictures.py."""

from __future__ import annotations

import os
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")

import depthcameras
import depthmeshes
import gaussians
import matplotlib.pyplot as plt
import numpy as np
import quadtrees
import reliefrays
import reliefs
import reliefwalk
import rigs
import room
import slices
import warpfigures
from demo import FAINT, HOLE, INK, PATH, views_of
from epipolar import bare, cameras, epipolar_lines, epipolar_plane, orders
from matplotlib.colors import Normalize, to_rgb, to_rgba
from matplotlib.figure import Figure
from objects import depth_object, relight
from splats import splats
from terrain import height_field, source_view

import pyibr as ibr

IMAGES = Path(__file__).resolve().parents[1] / "images"


def terrain() -> Figure:
    """Draw a depth image and a new view of it, in a row: colour, depth, the new view, and its holes."""
    source = source_view(height_field())
    frame = views_of(source, PATH[2:3])[0].frame
    gray = (frame.color.mean(axis=2, keepdims=True) * 0.55 + 100) / 255
    depth = np.where(source.valid, -source.depth, np.nan)
    panels = {
        "source: colour": np.where(source.valid[..., None], source.color, 255),
        "source: depth": plt.get_cmap("viridis")(Normalize(-28_000, -11_000)(depth)),
        "new view": frame.color,
        "hidden from the source": np.where(frame.valid[..., None], gray, to_rgb(HOLE)),
    }
    panels["source: depth"][~source.valid] = to_rgba(FAINT)
    figure, row = plt.subplots(1, 4, figsize=(14, 2.62), layout="constrained")
    for axes, (name, image) in zip(row, panels.items(), strict=True):
        bare(axes).imshow(image)
        axes.set_title(name, loc="left", fontsize=12, color=INK)
    return figure


def save(name: str, figure: Figure, dpi: int) -> None:
    """Write one picture and print its size."""
    path = IMAGES / name
    quality = {"quality": 88} if path.suffix == ".jpg" else None
    figure.savefig(path, dpi=dpi, facecolor="white", pil_kwargs=quality)
    plt.close(figure)
    print(f"{path}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    IMAGES.mkdir(exist_ok=True)
    plt.rcParams |= {"font.family": "DejaVu Sans"}
    save("room.jpg", room.first_page(), 80)
    save("film-strip.jpg", room.film_strip(), 70)
    for name, picture in room.choices().items():
        ibr.write_color(IMAGES / f"choose-{name}.jpg", picture)
    save("terrain.jpg", terrain(), 110)
    save("epipolar-lines.png", epipolar_lines(), 80)
    save("epipolar-plane.png", epipolar_plane(), 100)
    save("paper-warp-cameras.png", cameras(), 80)
    save("paper-warp-orders.png", orders(), 70)
    save("globe-of-six.jpg", warpfigures.globe_of_six(), 80)
    save("torus-of-six.jpg", warpfigures.torus_of_six(), 80)
    save("beside-the-original.jpg", warpfigures.beside_the_original(), 80)
    save("thin-things.jpg", warpfigures.thin_things(), 80)
    save("slicing-directions.png", slices.slicing_directions(), 80)
    save("three-directions.jpg", slices.three_directions(), 80)
    save("slice-counts.png", slices.slice_counts(), 70)
    save("bands.png", slices.bands(), 70)
    save("donuts.jpg", slices.donuts(), 80)
    save("paper-slicing-volume.png", slices.volume(), 80)
    save("paper-slicing-planes.jpg", slices.planes(), 80)
    save("paper-slicing-intersection.png", slices.intersection(), 80)
    save("paper-slicing-inputs.jpg", slices.inputs(), 80)
    save("paper-slicing-one.jpg", slices.one_slice(), 80)
    save("depth-object.png", depth_object(), 90)
    save("relight.jpg", relight(), 80)
    save("gaussians.jpg", gaussians.together(), 80)
    save("gaussians-made-of.jpg", gaussians.made_of(), 80)
    ibr.write_color(IMAGES / "choose-gaussians.jpg", gaussians.choice())
    if biker := os.environ.get("PYIBR_BIKER"):  # path of a file of the scene
        save("gaussians-biker.jpg", gaussians.biker(ibr.Gaussians.load(biker)), 80)
    else:
        print(f"{IMAGES / 'gaussians-biker.jpg'} is not redrawn: PYIBR_BIKER names no file of the scene")
    save("depth-camera.jpg", depthcameras.steps(), 80)
    save("own-system.jpg", splats(), 100)
    save("relief-silhouettes.jpg", reliefs.silhouettes(), 80)
    if teapot := os.environ.get("PYIBR_TEAPOT"):  # path of a mesh file of the teapot
        save("paper-relief-teapot.jpg", reliefs.teapot(ibr.Mesh.load(teapot)), 80)
    else:
        print(f"{IMAGES / 'paper-relief-teapot.jpg'} is not redrawn: PYIBR_TEAPOT names no mesh of the teapot")
    save("relief-distances.jpg", reliefs.distances(), 80)
    save("relief-scenes.jpg", reliefs.scenes(), 80)
    save("relief-walk.jpg", reliefwalk.walk(), 80)
    save("paper-relief-texture.jpg", reliefs.texture(), 80)
    save("paper-relief-rays.png", reliefrays.rays(), 80)
    save("paper-relief-distances.png", reliefrays.measures(), 80)
    save("paper-relief-quadrics.png", reliefrays.quadrics(), 70)
    save("paper-relief-shadows.jpg", reliefs.shadows(), 80)
    save("depth-mesh.jpg", depthmeshes.segmentation(), 80)
    save("depth-mesh-blending.jpg", depthmeshes.blending(), 80)
    save("depth-mesh-object.jpg", depthmeshes.unseen(), 80)
    save("paper-depthmesh-tree.jpg", quadtrees.refinement(), 62)
    save("paper-depthmesh-sections.png", quadtrees.sections(), 80)
    save("paper-depthmesh-segments.png", quadtrees.segments(), 80)
    save("paper-depthmesh-strips.jpg", quadtrees.strips(), 66)
    save("paper-depthmesh-stages.jpg", depthmeshes.stages(), 80)
    rigs.main()
