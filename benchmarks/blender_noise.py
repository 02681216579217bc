# SPDX-License-Identifier: GPL-3.0-or-later
"""Denoise random parts as Blender's modifiers leave them: blocks, voxels, quads, with noise or not.

Needs bpy and trimesh. Parts are those of `blender_parts`, from other seeds; errors too. The
comparison is Taubin's smoothing with the best number of passes for each mesh.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path

import blender_parts as parts
import bpy
import numpy as np
import trimesh
from mathutils import Euler
from report import Page, table
from shock_filter import core

FIRST_SEED = 800_000
COUNT = 12
FACES = 1000, 120_000
PASSES = 5, 10, 20, 40, 80


def design(rng: np.random.Generator) -> bpy.types.Object:
    """Join and cut primitives, turned or upright."""
    bpy.ops.wm.read_homefile(use_empty=True)
    obj = parts.simple(rng, rng.uniform(1.3, 1.9))
    for _ in range(rng.integers(1, 4)):
        other = parts.simple(rng, rng.uniform(0.4, 1.1))
        other.location = rng.uniform(-0.6, 0.6, 3)
        parts.combine(obj, other, "UNION" if rng.random() < 0.5 else "DIFFERENCE")
    parts.apply(obj)
    turn = Euler(rng.uniform(0, 2 * np.pi, 3) if rng.random() < 0.6 else (0, 0, 0))
    obj.data.transform(turn.to_matrix().to_4x4())
    return obj


def _modified(obj, kind: str, **settings) -> None:
    modifier = obj.modifiers.new(kind, kind)
    for name, value in settings.items():
        setattr(modifier, name, value)
    parts.apply(obj)


def _voxels(obj, rng, sizes=(0.03, 0.07)) -> None:
    size = float(np.exp(rng.uniform(*np.log(sizes))))
    _modified(obj, "REMESH", mode="VOXEL", voxel_size=size, adaptivity=0.0)


def _blocks(obj, rng) -> None:
    depth = int(rng.integers(5, 8))
    _modified(obj, "REMESH", mode="BLOCKS", octree_depth=depth, use_remove_disconnected=False)


def _quads(obj, rng) -> None:
    _voxels(obj, rng, (0.02, 0.04))
    bpy.context.view_layer.objects.active = obj
    obj.select_set(True)
    bpy.ops.object.quadriflow_remesh(target_faces=int(rng.integers(3000, 12000)), seed=1)


def _moved(obj, rng, most: float = 0.4) -> None:
    mesh = obj.data
    places = np.empty(3 * len(mesh.vertices), dtype=np.float32)
    mesh.vertices.foreach_get("co", places)
    edge = core.TriangleMesh(*parts.arrays(mesh)).mean_edge_length
    places += rng.normal(0, rng.uniform(0.1, most) * edge, len(places)).astype(np.float32)
    mesh.vertices.foreach_set("co", places)


def _decimated(obj, rng) -> None:
    _voxels(obj, rng, (0.02, 0.035))
    _modified(obj, "DECIMATE", ratio=float(rng.uniform(0.1, 0.5)))


def _noise_then_decimated(obj, rng) -> None:
    _voxels(obj, rng, (0.02, 0.03))
    _moved(obj, rng)
    _modified(obj, "DECIMATE", ratio=0.3)


def _clouds(obj, rng) -> None:
    _voxels(obj, rng)
    texture = bpy.data.textures.new("Noise", "CLOUDS")
    texture.noise_scale = float(rng.uniform(0.02, 0.1))
    edge = core.TriangleMesh(*parts.arrays(obj.data)).mean_edge_length
    strength = float(rng.uniform(0.2, 1.0) * edge)
    _modified(obj, "DISPLACE", texture=texture, strength=strength, mid_level=0.5)


def _then_moved(make: Callable, most: float = 0.4) -> Callable:
    def both(obj, rng):
        make(obj, rng)
        _moved(obj, rng, most)

    return both


KINDS: dict[str, Callable] = {
    "blocks": _blocks,
    "voxels, noise": _then_moved(_voxels),
    "quads, noise": _then_moved(_quads),
    "decimated, then noise": _then_moved(_decimated, 0.25),
    "noise, then decimated": _noise_then_decimated,
    "voxels, clouds": _clouds,
    "voxels": _voxels,
    "quads": _quads,
    "decimated": _decimated,
}


def made(kind: str) -> Iterator[parts.Part]:
    """Make the meshes of a kind."""
    for seed in range(COUNT):
        rng = np.random.default_rng(FIRST_SEED + seed)
        obj = design(rng)
        wanted = parts.arrays(obj.data)
        KINDS[kind](obj, rng)
        part = parts.Part(*parts.arrays(obj.data), wanted)
        if FACES[0] <= len(part.faces) <= FACES[1]:
            yield part


def error(part: parts.Part, vertices: np.ndarray) -> float:
    """Degrees to the design, in the mean by area."""
    degrees, areas = part.errors(vertices)
    return float(np.average(degrees, weights=areas))


def best_of_taubin(part: parts.Part) -> float:
    """Return the least error of some numbers of passes."""
    found = []
    for passes in PASSES:
        mesh = trimesh.Trimesh(part.vertices.copy(), part.faces, process=False)
        trimesh.smoothing.filter_taubin(mesh, lamb=0.5, nu=0.53, iterations=passes)
        found.append(error(part, np.asarray(mesh.vertices)))
    return min(found)


def rows(kinds: list[str]) -> list[list[str]]:
    """Measure each kind."""
    found = []
    for kind in kinds:
        results = []
        for part in made(kind):
            result = core.denoise_geometry(core.TriangleMesh(part.vertices, part.faces))
            results.append((error(part, part.vertices), error(part, result), best_of_taubin(part)))
            print(f"{kind}: {len(part.faces)} faces, {results[-1]}", flush=True)
        before, after, peer = np.array(results).T
        left = after / np.maximum(before, 0.05)
        found.append([kind, f"{len(left)}", f"{before.mean():.2f}", f"{after.mean():.2f}",
                      f"{peer.mean():.2f}", f"{left.mean():.2f}", f"{left.max():.2f}",
                      f"{(after / peer).max():.2f}"])  # fmt: skip
    return found


def main() -> None:
    """Print the table, or write it into a page."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--write", type=Path, help="Markdown page to write the table into")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    options = parser.parse_args()
    head = ["", "meshes", "input", "ours", "best of Taubin", "share", "worst", "worst to Taubin"]
    Page(options.write).write("blender-noise", table(head, rows(options.kinds)))


if __name__ == "__main__":
    main()
