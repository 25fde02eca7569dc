"""Mesa's software OpenGL (llvmpipe) draws the same meshes, slices and reliefs as pyibr, for comparison."""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyibr as ibr
from pyibr.opencl.device import one_call
from pyibr.slicing.drawing import buffers_of, slices_axis

Array = NDArray[Any]

_VIEWS_MAX = 6

_MESH_VERTEX = """
#version 330
uniform mat4 clip;
in vec3 position;
in vec3 tint;
out vec3 shade;
void main() { gl_Position = clip * vec4(position, 1.0); shade = tint; }
"""
_MESH_FRAGMENT = """
#version 330
in vec3 shade;
out vec4 color;
void main() { color = vec4(shade, 1.0); }
"""
_SLICE_VERTEX = """
#version 330
uniform mat4 clip;
in vec3 position;
out vec3 world;
void main() { gl_Position = clip * vec4(position, 1.0); world = position; }
"""
# A fragment of a slice passes if its point passes the test of each view, as in kernels/slicing/object.cl.
_SLICE_FRAGMENT = """
#version 330
#define VIEWS {views}
uniform mat4 views[VIEWS];
uniform vec2 sizes[VIEWS];
uniform float weights[VIEWS];
uniform sampler2D maps[VIEWS];
uniform sampler2D colors[VIEWS];
in vec3 world;
out vec4 color;
void main() {{
    vec2 places[VIEWS];
{tests}
    vec3 sum = vec3(0.0);
{blends}
    color = vec4(sum, 1.0);
}}
"""
_TEST = """
    {{
        vec4 p = views[{i}] * vec4(world, 1.0);
        places[{i}] = (p.xy / p.z + 0.5) / sizes[{i}];
        if (any(lessThan(places[{i}], vec2(0.0))) || any(greaterThan(places[{i}], vec2(1.0)))) discard;
        if ({fails}) discard;
    }}
"""
_BLEND = "    if (weights[{i}] > 0.0) sum += weights[{i}] * texture(colors[{i}], places[{i}]).rgb;"


_RELIEF_VERTEX = """
#version 330
uniform mat4 clip;
in vec3 position;
in vec2 place;
out vec3 world;
out vec2 uv;
void main() { gl_Position = clip * vec4(position, 1.0); world = position; uv = place; }
"""
# Draws a relief on the plane z = 0, where uv is (x, y) times `per_unit`. Each ray takes equal steps, then bisects.
_RELIEF_FRAGMENT = """
#version 330
uniform vec3 eye;
uniform vec2 per_unit;
uniform float scale;
uniform int steps, halvings;
uniform vec4 depth_row;
uniform vec2 planes;
uniform sampler2D heights, colors;
in vec3 world;
in vec2 uv;
out vec4 color;
void main() {
    vec3 v = normalize(world - eye);
    vec2 along = v.xy * per_unit;
    float slope = -v.z / scale, end = 1.0 / slope, size = end / float(steps), after = end;
    for (int i = 1; i <= steps; i++) {
        float t = size * float(i);
        if (t * slope >= 1.0 - textureLod(heights, uv + along * t, 0.0).r) {
            after = t;
            break;
        }
    }
    float before = after - size;
    for (int i = 0; i < halvings; i++) {
        float t = 0.5 * (before + after);
        if (t * slope >= 1.0 - textureLod(heights, uv + along * t, 0.0).r) after = t; else before = t;
    }
    color = textureLod(colors, uv + along * after, 0.0);
    float z = dot(depth_row, vec4(world + v * after, 1.0));
    gl_FragDepth = planes.y * (z - planes.x) / (z * (planes.y - planes.x));
}
"""


@functools.cache
def context() -> Any:
    """Return the only OpenGL context, or a text that says why there is none."""
    os.environ |= {"LIBGL_ALWAYS_SOFTWARE": "1", "GALLIUM_DRIVER": "llvmpipe"}
    try:
        moderngl: Any = import_module("moderngl")
        made = moderngl.create_context(standalone=True, backend="egl")
    except Exception as error:  # a missing package, library or display: llvmpipe is then left out
        return (
            f"there is no OpenGL through moderngl and EGL ({type(error).__name__}: {error}); it needs "
            "pip install moderngl, and on Debian apt install libegl1 libgl1-mesa-dri"
        )
    renderer = str(made.info["GL_RENDERER"])
    return made if "llvmpipe" in renderer else f"OpenGL is drawn by {renderer} here"


def clip_matrix(camera: ibr.Camera, near: float, far: float) -> Array:
    """Return the (4, 4) matrix from the world to OpenGL's clip space, with picture row y in buffer row y."""
    width, height = camera.size
    U, V, W, _ = camera.pixel_matrix @ camera.camera_from_world
    z = camera.camera_from_world[2]
    one = np.array([0.0, 0, 0, 1])
    if camera.projection == "perspective":
        depth = ((far + near) * z - 2 * far * near * one) / (far - near)
    else:
        depth = (2 * z - (far + near) * one) / (far - near)
    return np.array([2 * (U + 0.5 * W) / width - W, 2 * (V + 0.5 * W) / height - W, depth, W])


@dataclass
class Picture:
    """A picture whose buffers and shaders are ready to draw."""

    program: Any
    vertices: Any
    framebuffer: Any
    camera: ibr.Camera
    near: float
    far: float
    textures: dict[int, Any] = field(default_factory=dict[int, Any])  # by texture unit

    def draw(self) -> None:
        """Draw, and wait for the end."""
        gl = context()
        self._start(gl)
        gl.finish()

    def _start(self, gl: Any) -> None:
        self.framebuffer.use()
        for unit, texture in self.textures.items():
            texture.use(unit)
        gl.clear()
        gl.enable(gl.DEPTH_TEST)
        self.vertices.render()

    def picture(self) -> tuple[Array, Array]:
        """Draw; return colour (H, W, 3) uint8 and planar depth (H, W) float32, infinite where nothing is drawn."""
        self._start(context())
        height, width = self.camera.height, self.camera.width
        color = np.frombuffer(self.framebuffer.read(components=3, alignment=1), np.uint8).reshape(height, width, 3)
        d = np.frombuffer(self.framebuffer.read(components=1, attachment=-1, dtype="f4", alignment=1), np.float32)
        d = d.reshape(height, width)
        if self.camera.projection == "perspective":
            z = self.near * self.far / (self.far - d * (self.far - self.near))
        else:
            z = self.near + d * (self.far - self.near)
        return color, np.where(d < 1, z, np.inf).astype(np.float32)


def triangles(camera: ibr.Camera, mesh: ibr.Mesh, colors: Array, near: float, far: float) -> Picture:
    """Prepare a mesh with vertex colours (N, 3) in [0, 1]."""
    gl = context()
    program = gl.program(vertex_shader=_MESH_VERTEX, fragment_shader=_MESH_FRAGMENT)
    program["clip"].write(clip_matrix(camera, near, far).T.astype("f4").tobytes())
    data = np.concatenate([mesh.vertices, colors.astype(np.float32)], axis=1)
    buffer, indices = gl.buffer(data.tobytes()), gl.buffer(mesh.faces.tobytes())
    vertices = gl.vertex_array(program, [(buffer, "3f 3f", "position", "tint")], indices)
    return Picture(program, vertices, _framebuffer(gl, camera), camera, near, far)


def _maps_of(thing: ibr.DepthObject | ibr.VisualHull) -> list[Any]:
    """Return each view's map as kernels read it: nearness (1/depth) for a depth object, the mask for a visual hull."""
    sizes = [view.valid.size for view in thing.views]
    starts = np.cumsum([0, *sizes]) * (1 if isinstance(thing, ibr.VisualHull) else 2)
    with one_call():
        maps = buffers_of(thing)["maps"].to_host()
    return [maps[start : start + size] for start, size in zip(starts, sizes, strict=False)]


def slices(camera: ibr.Camera, thing: ibr.DepthObject | ibr.VisualHull, near: float, far: float) -> Picture:
    """Prepare an object's slices, to be drawn front to back: as many as pyibr's, across the same edge of its box."""
    gl = context()
    hull = isinstance(thing, ibr.VisualHull)
    axis = slices_axis(thing, camera)
    closeness = [float(camera.forward @ view.camera.forward) for view in thing.views]
    tested = thing.tested if isinstance(thing, ibr.VisualHull) else range(len(thing.views))
    numbers = sorted(tested, key=lambda k: -closeness[k])
    tests: list[str] = []
    for i in range(len(numbers)):
        read = f"texture(maps[{i}], places[{i}]).r"
        tests.append(_TEST.format(i=i, fails=f"{read} < 0.5" if hull else f"p.w / p.z > {read}"))
    blends = [_BLEND.format(i=i) for i in range(len(numbers))]
    program = gl.program(
        vertex_shader=_SLICE_VERTEX,
        fragment_shader=_SLICE_FRAGMENT.format(views=len(numbers), tests="".join(tests), blends="\n".join(blends)),
    )
    program["clip"].write(clip_matrix(camera, near, far).T.astype("f4").tobytes())
    views = [thing.views[k] for k in numbers]
    matrices = [view.camera.pixel_matrix @ view.camera.camera_from_world for view in views]
    program["views"].write(np.array([m.T for m in matrices], "f4").tobytes())
    program["sizes"].write(np.array([view.camera.size for view in views], "f4").tobytes())
    weights = np.zeros(len(numbers), "f4")
    weights[:3] = 1 / min(3, len(numbers))
    program["weights"].write(weights.tobytes())
    textures: dict[int, Any] = {}
    maps = _maps_of(thing)
    for i, (k, view) in enumerate(zip(numbers, views, strict=True)):
        for name, values, kind in (("maps", maps[k], "f4"), ("colors", view.color, "f1")):
            texture = gl.texture(view.camera.size, 3 if kind == "f1" else 1, values.tobytes(), alignment=1, dtype=kind)
            texture.repeat_x = texture.repeat_y = False
            textures[i + (_VIEWS_MAX if name == "colors" else 0)] = texture
    program["maps"].value = list(range(len(views)))
    program["colors"].value = list(range(_VIEWS_MAX, _VIEWS_MAX + len(views)))
    box = thing.box
    count = round(float(box.edges[axis] / box.edges.max()) * int(thing.slices))
    others = [k for k in range(3) if k != axis]
    quads = np.zeros((count, 6, 3))
    quads[:, :, axis] = (np.arange(count)[:, None] + 0.5) / count
    for corner, (a, b) in enumerate(((0, 0), (1, 0), (1, 1), (0, 0), (1, 1), (0, 1))):
        quads[:, corner, others[0]], quads[:, corner, others[1]] = a, b
    points = (box.low + quads * box.edges) @ box.axes  # 6 per slice: two triangles
    depth = points[:, 0] @ camera.camera_from_world[2, :3]
    points = points[np.argsort(depth)]
    buffer = gl.buffer(points.astype("f4").tobytes())
    vertices = gl.vertex_array(program, [(buffer, "3f", "position")])
    return Picture(program, vertices, _framebuffer(gl, camera), camera, near, far, textures)


def relief(camera: ibr.Camera, surface: ibr.ReliefSurface, near: float, far: float, in_float: bool = False) -> Picture:
    """Prepare a relief on the plane z = 0 for the linear search; `in_float` keeps its heights in float, not 8 bits."""
    gl = context()
    base = surface.base
    program = gl.program(vertex_shader=_RELIEF_VERTEX, fragment_shader=_RELIEF_FRAGMENT)
    uv = np.asarray(base.uv, np.float64) * surface.tiles
    per_unit = np.ptp(uv, axis=0) / np.ptp(base.vertices[:, :2], axis=0)
    values = {
        "eye": camera.center,
        "per_unit": per_unit,
        "depth_row": camera.camera_from_world[2],
        "planes": (near, far),
    }
    program["clip"].write(clip_matrix(camera, near, far).T.astype("f4").tobytes())
    for name, value in values.items():
        program[name].write(np.asarray(value, "f4").tobytes())
    program["scale"].value, program["steps"].value, program["halvings"].value = (
        surface.scale,
        surface.steps,
        surface.halvings,
    )
    heights = surface.height if in_float else np.rint(surface.height * 255).astype(np.uint8)
    textures: dict[int, Any] = {}
    for unit, (name, image) in enumerate((("heights", heights), ("colors", surface.color))):
        h, w = image.shape[:2]
        kind = "f4" if image.dtype == np.float32 else "f1"
        channels = 1 if image.ndim == 2 else 3
        textures[unit] = gl.texture((w, h), channels, np.ascontiguousarray(image).tobytes(), alignment=1, dtype=kind)
        program[name].value = unit
    data = np.concatenate([base.vertices, uv.astype(np.float32)], axis=1)[base.faces.ravel()]
    vertices = gl.vertex_array(program, [(gl.buffer(data.tobytes()), "3f 2f", "position", "place")])
    return Picture(program, vertices, _framebuffer(gl, camera), camera, near, far, textures)


def _framebuffer(gl: Any, camera: ibr.Camera) -> Any:
    return gl.framebuffer([gl.texture(camera.size, 4)], gl.depth_texture(camera.size))
