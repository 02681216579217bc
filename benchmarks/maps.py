# SPDX-License-Identifier: GPL-3.0-or-later
"""Measure maps of curvature and of occlusion.

``python benchmarks/maps.py curvature FOLDER`` draws how the error of curvature falls with the size
of the triangles, ``python benchmarks/maps.py occlusion FOLDER --size 1024`` measures time and error
of occlusion beside the bake of Blender's Cycles, on the same cores.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path

import numpy as np
from shock_filter import core

sys.path.append(str(Path(__file__).parent.parent / "tests" / "core"))

COUNTS = (8, 12, 16, 24, 32, 48, 64)
CELLS = 224  # a torus of 100,352 triangles


def curvature(folder: Path) -> None:
    """Write ``curvature-order.png`` and print the orders of convergence."""
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
    figure.savefig(folder / "curvature-order.png", dpi=110)


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


def cycles(mesh: core.TriangleMesh, uv: np.ndarray, size: int, samples: int) -> np.ndarray:
    """Bake occlusion by Cycles on the processor; return the image."""
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.world = bpy.data.worlds.new("World")
    scene.world.light_settings.distance = 1000.0
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = samples, False
    scene.cycles.use_adaptive_sampling = False
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


def occlusion(folder: Path, size: int, many: int) -> None:
    """Print times and errors of both, and write them and the images."""
    from PIL import Image

    mesh, uv = bumpy_torus()
    atlas = core.TextureAtlas(mesh, uv, size=(size, size))

    def ours(**given: float) -> np.ndarray:
        # With the analysis of the atlas, which a bake needs, too.
        settings = core.OcclusionSettings(**given)
        return core.ambient_occlusion(mesh, uv, settings, size=(size, size))

    ours(rays=2)  # kernels are ready, as in the extension
    began = time.perf_counter()
    wanted = cycles(mesh, uv, size, many)
    rows = [["Cycles", many, time.perf_counter() - began, 0.0]]
    inside = atlas.inside
    runs = [("Cycles", count, lambda count=count: cycles(mesh, uv, size, count))
            for count in (16, 64, 128, 256)]  # fmt: skip
    runs += [("rays, smoothed", count, lambda count=count: ours(rays=count))
             for count in (16, 32, 64)]  # fmt: skip
    shown = [wanted]
    for name, count, run in runs:
        began = time.perf_counter()
        image = run()
        seconds = time.perf_counter() - began
        error = float(np.sqrt(((image - wanted)[inside] ** 2).mean()))
        rows.append([name, count, seconds, error])
        shown.append(image)
        print(f"{name}, {count}: {seconds:.1f} s, error {100 * error:.2f} %", flush=True)
    (folder / "occlusion.json").write_text(json.dumps(rows))
    pixels = np.hstack([shown[0], shown[1], shown[-1]])[: size // 2]
    Image.fromarray(np.uint8(255 * np.clip(pixels, 0, 1))).save(folder / "occlusion.png")


def main() -> None:
    """Run what the command line says."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("curvature", "occlusion"))
    parser.add_argument("folder", type=Path)
    parser.add_argument("--size", type=int, default=1024)
    parser.add_argument("--many", type=int, default=1024)
    given = parser.parse_args()
    given.folder.mkdir(parents=True, exist_ok=True)
    if given.what == "curvature":
        curvature(given.folder)
    else:
        occlusion(given.folder, given.size, given.many)


if __name__ == "__main__":
    main()
