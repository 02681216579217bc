# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure maps of curvature and of occlusion.

``python benchmarks/maps.py --data FOLDER --write docs/maps.md`` draws how the error of curvature
falls with the size of the triangles, measures how many rays smoothing is worth, and time and error
of occlusion beside the bake of Blender's Cycles, on the same cores. Parts are unwrapped by Blender,
which has to be there as a Python package.
"""

from __future__ import annotations

import io
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import common
import numpy as np
from PIL import Image
from report import table
from shock_filter import core
from shock_filter.core.maps import tracing
from shock_filter.core.maps.ray_noise import without_noise

# Before this folder, which has a module `remeshed`, too.
sys.path.insert(0, str(Path(__file__).parent.parent / "tests" / "core"))

COUNTS = (8, 12, 16, 24, 32, 48, 64)
CELLS = 224  # a torus of 100,352 triangles
SIZE = 1024
SIZES = 256, 1024

PLACES = 2500

RAYS = """## Error and speed

Error of occlusion against that with 4,096 rays, in percent of the way from black to white (root
mean square), for 64 rays with the default smoothing and for more rays without smoothing:

"""

BESIDE_CYCLES = """A map of 1,024 x 1,024 texels of a bumpy torus of 100,352 triangles, compared
with the bake of Blender's Cycles on the same cores. Errors are relative to Cycles without its
noise, which follows from two further bakes. The last column gives how many times as long Cycles
takes for the same error, in seconds of all cores:

"""

MANY = 64
"""Samples of the bakes that others are compared with."""


def curvature(job: common.Job) -> None:
    """Draw errors against the size of triangles, and their orders of convergence."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt
    from surface_patches import SURFACES, patch

    figure, axes = plt.subplots(1, 4, figsize=(14, 3.6), sharey=True, constrained_layout=True)
    for axis, (name, surface) in zip(axes, SURFACES.items(), strict=True):
        for kind in ("regular", "random", "stretched"):
            sizes, errors = [], []
            for count in COUNTS[: 5 if kind == "stretched" else None]:
                mesh, square = patch(surface, kind, count)
                points = np.zeros((mesh.vertex_count, 2))
                points[mesh.faces] = square
                inside = ((points > 0.3) & (points < 0.7)).all(axis=1)
                known = surface(points).mean
                error = np.abs(core.curvature(mesh).mean - known)[inside].max()
                sizes.append(1.0 / count)
                errors.append(error / np.abs(known).max())
            order = np.polyfit(np.log(sizes), np.log(errors), 1)[0]
            axis.loglog(sizes, errors, "o-", label=f"{kind}: order {order:.2f}")
            print(f"{name}, {kind}: order {order:.2f}, last error {100 * errors[-1]:.3f} %")
        axis.loglog(sizes, np.array(sizes) ** 1.5, "k:", label="order 1.5")
        axis.set(title=name, xlabel="size of triangles / size of the surface")
        axis.legend(fontsize=7)
    axes[0].set_ylabel("largest error / largest curvature")
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110, metadata={"Software": None})
    shown = Image.open(drawn).convert("RGB").quantize(48)
    job.page.write("curvature", job.page.picture("curvature-order", shown, "Errors of curvature"))


def bumpy_torus(cells: int = CELLS) -> tuple[core.TriangleMesh, np.ndarray]:
    """Make a torus with bumps and grooves, in one chart; return the mesh and its coordinates."""
    steps = np.arange(cells) / cells * 2 * np.pi
    u, v = np.meshgrid(steps, steps, indexing="ij")
    groove = np.tanh(6 * np.sin(3 * v + 2 * u))
    r = 0.4 * (1 + 0.18 * np.sin(9 * u) * np.sin(5 * v) + 0.1 * groove)
    far = 1 + r * np.cos(v)
    places = np.stack([far * np.cos(u), far * np.sin(u), r * np.sin(v)], axis=-1).reshape(-1, 3)
    a, b = np.divmod(np.arange(cells * cells), cells)
    corners = np.stack([[a, b], [a + 1, b], [a + 1, b + 1], [a, b + 1]], axis=0)  # (4, 2, cells^2)
    grid = np.moveaxis(corners, 2, 0)
    split = np.concatenate([grid[:, [0, 1, 2]], grid[:, [0, 2, 3]]])
    faces = (split[..., 0] % cells) * cells + split[..., 1] % cells
    return core.TriangleMesh(places, faces), split / cells * 0.96 + 0.02


def cycles(
    mesh: core.TriangleMesh, uv: np.ndarray, size: int, samples: int, seed: int = 0
) -> np.ndarray:
    """Bake occlusion by Cycles on the processor; return the image."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.light_settings.distance = 1000.0
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.cycles.use_adaptive_sampling, scene.cycles.seed = False, seed
    data = bpy.data.meshes.new("Torus")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.faces.tolist())
    data.uv_layers.new().data.foreach_set("uv", uv.reshape(-1).astype(np.float32))
    data.shade_smooth()
    torus = bpy.data.objects.new("Torus", data)
    scene.collection.objects.link(torus)
    bpy.context.view_layer.objects.active = torus
    torus.select_set(True)
    image = bpy.data.images.new("Bake", size, size, float_buffer=True, is_data=True)
    material = bpy.data.materials.new("Material")
    material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = image
    material.node_tree.nodes.active = node
    data.materials.append(material)
    bpy.ops.object.bake(type="AO", margin=0)
    pixels = np.empty(size * size * 4, dtype=np.float32)
    image.pixels.foreach_get(pixels)
    return pixels.reshape(size, size, 4)[..., 0]


def unwrapped(vertices: np.ndarray, faces: np.ndarray) -> tuple[core.TriangleMesh, np.ndarray]:
    """Unwrap triangles as Blender does; return the mesh and its coordinates."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    data = bpy.data.meshes.new("Part")
    data.from_pydata(vertices.tolist(), [], faces.tolist())
    part = bpy.data.objects.new("Part", data)
    bpy.context.scene.collection.objects.link(part)
    bpy.context.view_layer.objects.active = part
    part.select_set(True)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.uv.smart_project(angle_limit=1.15, island_margin=0.01)
    bpy.ops.object.mode_set(mode="OBJECT")
    uv = np.empty(2 * len(data.loops), np.float32)
    data.uv_layers.active.uv.foreach_get("vector", uv)
    corners = np.empty(len(data.loops), np.int32)
    data.loops.foreach_get("vertex_index", corners)
    mesh = core.TriangleMesh(vertices, corners.reshape(-1, 3))
    return mesh, uv.reshape(-1, 3, 2).astype(np.float64)


def models(data: Path | None) -> Iterator[tuple[str, core.TriangleMesh, list[core.TriangleMesh]]]:
    """Yield names, meshes and what stands in the way of their light."""
    import parts
    from shapes import cube, icosphere

    for name in ("cog", "bracket"):
        yield f"{name}, remeshed", parts.remeshed(getattr(parts, name)()[0], 56), []
    if data:
        for name in ("fandisk.obj", "lion_statue.obj"):
            vertices, faces = common.load_mesh(data, name)
            yield Path(name).stem.replace("_", " "), core.TriangleMesh(vertices, faces), []
    vertices, faces = cube(6)
    room = vertices / np.abs(vertices).max() * [2, 2, 1]
    walls = faces[~(room[faces][..., 2] > 0.999).all(axis=1)][:, ::-1]
    corners, sides = cube(1)
    box = core.TriangleMesh(
        corners / np.abs(corners).max() * [0.5, 0.4, 0.5] + [0.3, 0.2, -0.5], sides
    )
    points, around = icosphere(3)
    ball = core.TriangleMesh(0.4 * points + [-0.9, -0.6, -0.5], around)
    yield "room with a box and a ball", core.TriangleMesh(room, walls), [box, ball]


def rays(job: common.Job) -> None:
    """Measure 64 smoothed rays and more raw ones against 4,096, at some texels of maps."""
    raw = (64, 256, 1024)
    rows = []
    for name, mesh, others in models(job.data):
        mesh, uv = unwrapped(mesh.vertices, mesh.faces)
        row = [name]
        scene = tracing.scene_of(mesh, others)
        for size in SIZES:
            sites = tracing.texel_sites(core.TextureAtlas(mesh, uv, size=(size, size)))
            chosen = np.random.default_rng(1).permutation(len(sites.numbers))[:PLACES]
            some = tracing.Sites._make(each[chosen] for each in sites)
            wanted = tracing.look_around(scene, some, 4096)[0].mean(axis=1)
            halves = tracing.look_around(scene, sites, 64)[0]
            smooth = without_noise(sites, halves, 4.0)[chosen, 0]
            row.append(f"{100 * np.sqrt(((smooth - wanted) ** 2).mean()):.2f}")
            if size == SIZES[-1]:
                for count in raw:
                    found = tracing.look_around(scene, some, count)[0].mean(axis=1)
                    row.append(f"{100 * np.sqrt(((found - wanted) ** 2).mean()):.2f}")
        rows.append(row)
    head = ["", *(f"64 smoothed, {n} x {n}" for n in SIZES), *(f"{n:,} raw" for n in raw)]
    job.page.write("rays", RAYS + table(head, rows))


def occlusion(job: common.Job) -> None:
    """Measure both beside a bake of many samples, and how long Cycles takes for the same error."""
    mesh, uv = bumpy_torus()
    shape = (SIZE, SIZE)
    atlas = core.TextureAtlas(mesh, uv, size=shape)

    def ours(rays: int) -> np.ndarray:
        # With the analysis of the atlas, which a bake needs, too.
        return core.ambient_occlusion(mesh, uv, core.OcclusionSettings(rays=rays), size=shape)

    def measured(run: Callable[[], np.ndarray]) -> tuple[np.ndarray, float, float]:
        began, used = time.perf_counter(), time.process_time()
        image = run()
        taken = time.perf_counter() - began, time.process_time() - used
        return image[atlas.inside], *taken

    ours(2)  # kernels are ready, as in the extension
    baked = [measured(lambda n=n: cycles(mesh, uv, SIZE, MANY, n)) for n in range(3)]

    def error(image: np.ndarray, one: int, other: int) -> float:
        # The noise of two bakes is not that of the product of both distances.
        apart = (image - baked[one][0]).astype(np.float64) * (image - baked[other][0])
        return float(np.sqrt(max(apart.mean(), 1e-12)))

    few = measured(lambda: cycles(mesh, uv, SIZE, MANY // 4, 3))
    theirs = {MANY // 4: (*few[1:], error(few[0], 0, 1)),
              MANY: (*baked[0][1:], error(baked[0][0], 1, 2))}  # fmt: skip
    rows = [["Cycles", str(n), *_formatted(each), ""] for n, each in theirs.items()]
    # As errors fall with a power of the time.
    (_, time_0, error_0), (_, time_1, error_1) = theirs.values()
    power = np.log(time_1 / time_0) / np.log(error_0 / error_1)
    for count in (16, 64):
        image, wall, used = measured(lambda count=count: ours(count))
        found = wall, used, error(image, 0, 1)
        alike = time_1 * (error_1 / found[2]) ** power
        rows.append(["rays, smoothed", str(count), *_formatted(found), f"{alike / used:.1f}"])
    head = ["", "rays", "seconds", "of all cores", "error, %", "times Cycles' speed"]
    job.page.write("occlusion", BESIDE_CYCLES + table(head, rows))


def _formatted(measured: tuple[float, float, float]) -> list[str]:
    wall, used, error = measured
    return [f"{wall:.1f}", f"{used:.1f}", f"{100 * error:.2f}"]


SECTIONS = {"curvature": curvature, "rays": rays, "occlusion": occlusion}


if __name__ == "__main__":
    common.measure(common.make_parser(__doc__, SECTIONS).parse_args(), SECTIONS, "maps")
