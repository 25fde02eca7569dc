"""A solid made of depth images of all sides: pictures for pictures.py, and the demo's second picture."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import pyibr as ibr
from pyibr.capture import MeshScene, object_views
from pyibr.capture.coverage import surface_of, unseen_share
from pyibr.capture.frusta import Frustum
from pyibr.capture.proposal import propose_frusta
from pyibr.capture.raycast import spread_directions


def knot() -> MeshScene:
    """Return a trefoil knot with stripes along its length, an object that hides much of itself."""
    vertices, faces, colors = knot_surface()
    return MeshScene(vertices, faces, colors=colors)


def knot_surface(lit: bool = True) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return vertices, faces and vertex colours of the knot, with or without shading."""
    a, b = np.meshgrid(np.linspace(0, 2 * np.pi, 361)[:-1], np.linspace(0, 2 * np.pi, 49)[:-1], indexing="ij")

    def line(t: np.ndarray) -> np.ndarray:
        return np.stack([np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=-1)

    along = line(a + 1e-4) - line(a - 1e-4)
    along /= np.linalg.norm(along, axis=-1, keepdims=True)
    side = np.cross(along, (0, 0, 1.0))
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    normal = np.cos(b)[..., None] * side + np.sin(b)[..., None] * np.cross(along, side)
    vertices = (line(a) + 0.55 * normal).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(360), np.arange(48), indexing="ij")

    def corner(di: int, dj: int) -> np.ndarray:
        return ((i + di) % 360 * 48 + (j + dj) % 48).ravel()

    faces = np.concatenate(
        [
            np.stack([corner(0, 0), corner(1, 0), corner(1, 1)], 1),
            np.stack([corner(0, 0), corner(1, 1), corner(0, 1)], 1),
        ]
    )
    hue = plt.get_cmap("twilight_shifted")(a / (2 * np.pi))[..., :3] * (0.6 + 0.4 * (np.floor(a * 14) % 2))[..., None]
    shade = 0.35 + 0.65 * np.clip(normal @ np.array([-0.4, -0.5, 0.77]), 0, 1) if lit else np.ones(a.shape)
    colors = np.clip(255 * (0.25 + 0.75 * hue) * shade[..., None], 0, 255).astype(np.uint8).reshape(-1, 3)
    return vertices, faces, colors


def by_rays(scene: MeshScene, camera: ibr.Camera) -> np.ndarray:
    """Ray-cast the mesh on white, with four rays per pixel, since the other pictures have four samples per pixel."""
    fine = camera.resized((2 * camera.width, 2 * camera.height))
    rays = scene.capture(fine, background=(255, 255, 255)).color.astype(np.float32)
    return rays.reshape(camera.height, 2, camera.width, 2, 3).mean(axis=(1, 3)).round().astype(np.uint8)


def twelve_views(scene: MeshScene, size: int) -> list[ibr.DepthImage]:
    """Take depth images from twelve evenly spread directions."""
    return [
        scene.capture(ibr.Camera.look_at(20 * way, (0, 0, 0), np.eye(3)[np.abs(way).argmin()], (size, size), fov_y=22))
        for way in spread_directions(12)
    ]


def what_shows_most(scene: MeshScene, views: list[ibr.DepthImage]) -> str:
    """Write a sentence on the surface that some views do not see, and on a further view that sees most of it."""
    mesh = ibr.Mesh(scene.vertices, scene.faces)
    surface = surface_of(mesh)
    known = [Frustum(view.camera, 2 * float(view.depth[view.valid].max())) for view in views]
    (best,) = propose_frusta(mesh, 1, known=known, surface=surface)
    seen = [surface.seen(view) for view in views]
    left = [unseen_share(surface, some) for some in (seen, [*seen, surface.seen(best.capture(mesh))])]
    x, y, z = best.camera.center
    return (
        f"Six images leave {left[0]:.1%} unseen, the fin between the loops: no image shows that this space is empty. "
        f"propose_frusta proposes a view from ({x:.1f}, {y:.1f}, {z:.1f}), which shows most of the fin and leaves "
        f"{left[1]:.1%} unseen."
    )


def depth_object() -> Figure:
    """Draw a knot: the mesh, solids from six and from twelve depth images, and the hull of twelve silhouettes."""
    scene = knot()
    six, twelve = object_views(scene, 512, projection="perspective"), twelve_views(scene, 512)
    camera = ibr.Camera.look_at((4.5, -5.5, 6.5), (0, 0, 0), (0, 0, 1), (420, 400), fov_y=42)
    things = {
        "depth object, 6 images": ibr.DepthObject(six, slices=256),
        "depth object, 12 images": ibr.DepthObject(twelve, slices=256),
        'the same, texture="naive"': ibr.DepthObject(twelve, slices=256, texture="naive"),
        "visual hull, 12 silhouettes": ibr.VisualHull(twelve, slices=256),
    }
    drawn = {name: ibr.render(one, camera, background=(255, 255, 255), samples=4).color for name, one in things.items()}
    panels = {"the mesh": by_rays(scene, camera), **drawn}
    figure, row = plt.subplots(1, 5, figsize=(17.2, 3.9), layout="constrained")
    for axes, (name, image) in zip(row, panels.items(), strict=True):
        axes.imshow(image)
        axes.set_title(name, loc="left", fontsize=12)
        axes.set_axis_off()
    figure.supxlabel(what_shows_most(scene, six), x=0.005, ha="left", fontsize=11)
    return figure


def relight() -> Figure:
    """Draw a depth object with unshaded colours in three lights, and the mesh in the third light."""
    vertices, faces, colors = knot_surface(lit=False)
    thing = ibr.DepthObject(object_views(MeshScene(vertices, faces, colors=colors), 512, normals=True), slices=256)
    camera = ibr.Camera.look_at((4.5, -5.5, 6.5), (0, 0, 0), (0, 0, 1), (420, 400), fov_y=42)
    shiny = {"ambient": 0.12, "specular": 0.45, "shininess": 40, "relight": True}
    lights = [
        ibr.Light(direction=(-1, 0.35, -0.6), **shiny),
        ibr.Light(direction=(0.6, 1, -1.2), color=(1, 0.85, 0.6), **shiny),
        ibr.Light(position=(0, 0, 2.6), color=(0.75, 0.85, 1.15), **shiny),
    ]
    mesh = ibr.Mesh(vertices, faces, colors=colors)
    how = {"background": (255, 255, 255), "samples": 4}
    panels = {
        "the images' own colours": ibr.render(thing, camera, **how).color,
        "relit from the right": ibr.render(thing, camera, lights[0], **how).color,
        "by a warm one from the left": ibr.render(thing, camera, lights[1], **how).color,
        "by a lamp in its middle": ibr.render(thing, camera, lights[2], **how).color,
        "the mesh by that lamp": ibr.render(mesh, camera, lights[2], **how).color,
    }
    figure, row = plt.subplots(1, 5, figsize=(17.2, 3.6), layout="constrained")
    for axes, (name, image) in zip(row, panels.items(), strict=True):
        axes.imshow(image)
        axes.set_title(name, loc="left", fontsize=12)
        axes.set_axis_off()
    return figure
