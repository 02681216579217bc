# SPDX-License-Identifier: GPL-3.0-or-later
"""Run all filters on every mesh and image of a folder: each must succeed or give a reason.

A table in Markdown goes to the screen; the exit status is 1 if anything was neither filtered nor
refused with one of Shock Filter's own sentences.
"""

from __future__ import annotations

import argparse
import time
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import common
import numpy as np
from report import table
from shock_filter import core
from shock_filter.core.atlas import TextureAtlas
from shock_filter.core.files.formats.image.pillow import read_pillow
from shock_filter.core.files.formats.mesh.trimesh import ENDINGS, SceneFile
from shock_filter.core.files.meshes import IN_PLACE, read_document
from shock_filter.core.files.textures import read_textured_mesh
from shock_filter.core.registry import find
from shock_filter.core.shape.denoising import beltrami_joint_corners
from shock_filter.core.then_sharpen import sharpen_both, then_sharpen

MESHES = tuple(ENDINGS)
IMAGES = (".png", ".jpg", ".jpeg", ".bmp", ".webp")
TEXTURE_SIZE = 512

Run = tuple[str, Callable[[], Any]]


def mesh_runs(path: Path) -> tuple[str, Iterator[Run]]:
    """Return a mesh file's size in words, and the filters with their names."""
    document = read_document(path, IN_PLACE.get(path.suffix.lower(), SceneFile))
    representatives, index = core.weld(document.vertices)
    mesh = core.TriangleMesh(document.vertices[representatives], index[document.faces])

    def runs() -> Iterator[Run]:
        settings = core.BeltramiGeometrySettings()
        low, high = mesh.box
        colors = (mesh.vertices - low) / (high - low).max()  # something smooth, and steps
        colors[:, 2] = colors[:, 2] > np.median(colors[:, 2])
        corners = colors[mesh.faces]
        yield "geometry", lambda: core.sharpen_geometry(mesh)
        yield "steady", lambda: core.sharpen_geometry(mesh, core.GeometrySettings(time=np.inf))
        yield "denoise", lambda: find("denoise_geometry").function(64.0)(mesh, settings=settings)
        yield "colors", lambda: core.sharpen_vertex_signal(mesh, colors)
        yield "corners", lambda: core.sharpen_corner_signal(mesh, corners)
        sharpening = core.ShockSettings(time=64.0)
        both = then_sharpen(beltrami_joint_corners, sharpen_both, sharpening)
        yield "both", lambda: both(mesh, corners)
        yield "texture", lambda: textured(path)

    return f"{mesh.vertex_count:,} vertices", runs()


def textured(path: Path) -> np.ndarray:
    """Sharpen a texture of stripes on the mesh of a file, and fill its gutter."""
    surface = read_textured_mesh(path)
    rows, columns = np.mgrid[:TEXTURE_SIZE, :TEXTURE_SIZE]
    image = (0.5 + 0.5 * np.sin((rows + 2 * columns) / 9)).astype(np.float32)
    atlas = TextureAtlas(surface.mesh, surface.uv, size=image.shape)
    sharp = core.sharpen_texture(surface.mesh, surface.uv, image, atlas=atlas)
    return core.dilate_texture(surface.mesh, surface.uv, sharp, atlas=atlas)


def image_runs(path: Path) -> tuple[str, Iterator[Run]]:
    """Return an image's size in words, and the filters with their names."""
    pixels = np.asarray(read_pillow(path).pixels)
    height, width = pixels.shape[:2]

    def runs() -> Iterator[Run]:
        yield "image", lambda: core.sharpen_image(pixels)
        yield "steady", lambda: core.sharpen_image(pixels, core.ImageSettings(time=np.inf))
        yield "denoise", lambda: find("beltrami_image").function(16.0)(pixels)

    return f"{width} x {height} pixels", runs()


def sweep(path: Path) -> tuple[list[str], bool]:
    """Run everything on one file; return its row of the table, and whether all is well."""
    reader = mesh_runs if path.suffix.lower() in MESHES else image_runs
    size, seconds, results, well = "", [], [], True
    try:
        size, runs = reader(path)
        for name, run in runs:
            start = time.perf_counter()
            try:
                check(name, run())
            except core.ShockError as error:
                results.append(f"{name}: {error}".replace(str(path), path.name))
            else:
                seconds.append(f"{name} {time.perf_counter() - start:.2f}")
    except core.ShockError as error:
        results.append(str(error).replace(str(path), path.name))
    except Exception:  # whatever goes wrong with one file belongs into the table
        results.append(f"**failed**: {traceback.format_exc(limit=-1).strip().splitlines()[-1]}")
        traceback.print_exc()
        well = False
    memory = f"{common.peak_memory() / 1024**2:.0f} MB"
    return [path.name, size, ", ".join(seconds), memory, "; ".join(results) or "all fine"], well


def check(name: str, result: Any) -> None:
    """Raise `ValueError` if a result holds NaN or infinity."""
    for array in result if isinstance(result, tuple) else (result,):
        if not np.isfinite(array).all():
            raise ValueError(f"{name} returned {np.count_nonzero(~np.isfinite(array))} NaN")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--data", type=Path, required=True, help="folder, looked through as a whole"
    )
    parser.add_argument("--only", default="", help="part of the paths of the files to take")
    parser.add_argument("--first", type=int, default=1, help="number of the file to begin with")
    arguments = parser.parse_args()
    files = sorted(
        path
        for path in arguments.data.rglob("*")
        if path.suffix.lower() in (*MESHES, *IMAGES)
        and arguments.only in str(path.relative_to(arguments.data))
    )
    if not 1 <= arguments.first <= len(files):
        parser.error(f"{arguments.data} holds {len(files)} meshes and images of that name")
    rows, all_well = [], True
    for number, path in enumerate(files[arguments.first - 1 :], arguments.first):
        row, well = common.in_own_process(sweep, path)
        rows.append(row)
        all_well &= well
        print(f"{number}/{len(files)} {' | '.join(row)}", flush=True)
    print(f"\n{common.machine()}\n")
    print(table(["file", "size", "seconds", "peak memory", "result"], rows, words=5))
    raise SystemExit(not all_well)


if __name__ == "__main__":
    main()
