# SPDX-License-Identifier: GPL-3.0-or-later
"""One Blender process that uses the installed extension and writes down what it saw.

Run as ``python blender_process.py RESOURCES REPORT [ZIP]``: RESOURCES is Blender's folder for the
user's files, REPORT the JSON file to write. With ZIP, the extension is installed first and also
disabled and enabled again at the end.
"""

import importlib.util
import json
import os
import sys
import time
from pathlib import Path
from urllib.parse import urlparse
from urllib.request import url2pathname

RESOURCES, REPORT, *ZIP = sys.argv[1:]
os.environ["BLENDER_USER_RESOURCES"] = RESOURCES  # bpy reads it when it is imported

import bpy  # noqa: E402

# isort: split
import addon_utils  # noqa: E402  (found once bpy is imported)
import bmesh  # noqa: E402
import numpy as np  # noqa: E402

MODULE = "bl_ext.user_default.shock_filter"
HEAVY = ("numba", "llvmlite", "scipy")


def files_below(folder: Path) -> dict[str, list[int]]:
    """Return size and time of change of each file below `folder`."""
    return {
        path.relative_to(folder).as_posix(): [path.stat().st_size, path.stat().st_mtime_ns]
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def add_rounded_cube() -> bpy.types.Object:
    """Make a finely divided cube with softened edges the active object."""
    shape = bmesh.new()
    bmesh.ops.create_cube(shape, size=2.0)
    bmesh.ops.subdivide_edges(shape, edges=shape.edges[:], cuts=20, use_grid_fill=True)
    every_axis = {"use_axis_x": True, "use_axis_y": True, "use_axis_z": True}
    for _ in range(5):
        bmesh.ops.smooth_vert(shape, verts=shape.verts[:], factor=0.5, **every_axis)
    mesh = bpy.data.meshes.new("Rounded Cube")
    shape.to_mesh(mesh)
    shape.free()
    cube = bpy.data.objects.new("Rounded Cube", mesh)
    bpy.context.collection.objects.link(cube)
    bpy.context.view_layer.objects.active = cube
    cube.select_set(True)
    return cube


def positions(cube: bpy.types.Object) -> np.ndarray:
    """Return the vertices' places, one a row."""
    values = np.empty(3 * len(cube.data.vertices), np.float32)
    cube.data.attributes["position"].data.foreach_get("vector", values)
    return values.reshape(-1, 3)


def roundness(cube: bpy.types.Object) -> float:
    """Return the mean angle from the faces' normals to the cube's sides, in degrees."""
    normals = np.empty(3 * len(cube.data.polygons), np.float32)
    cube.data.polygons.foreach_get("normal", normals)
    upright = np.abs(normals.reshape(-1, 3)).max(axis=1)
    return float(np.degrees(np.arccos(np.minimum(upright, 1.0))).mean())


def sharpen() -> dict[str, object]:
    """Run the operator on a fresh cube; return its result, its time and what it changed."""
    cube = add_rounded_cube()
    before, round_before = positions(cube), roundness(cube)
    start = time.perf_counter()
    result = bpy.ops.shock_filter.sharpen_geometry()
    seconds = time.perf_counter() - start
    moved = np.linalg.norm(positions(cube) - before, axis=1)
    return {
        "result": sorted(result),
        "seconds": seconds,
        "farthest": float(moved.max()),
        "roundness": [round_before, roundness(cube)],
    }


def sharpen_colors() -> dict[str, object]:
    """Run the operator on a softly painted cube; return its result and the steepest colors."""
    cube = add_rounded_cube()
    paint = cube.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    cube.data.color_attributes.active_color = paint
    values = np.ones((len(cube.data.vertices), 4), np.float32)
    values[:, 0] = 1 / (1 + np.exp(-positions(cube)[:, 2] / 0.15))
    paint.data.foreach_set("color", values.ravel())
    result = bpy.ops.shock_filter.sharpen_colors(time=1024.0)
    edges = np.empty(2 * len(cube.data.edges), np.int32)
    cube.data.edges.foreach_get("vertices", edges)
    before = values[:, 0]
    cube.data.color_attributes["Paint"].data.foreach_get("color", flat := values.ravel().copy())
    after = flat.reshape(-1, 4)[:, 0]
    steepest = [float(np.abs(np.diff(v[edges.reshape(-1, 2)])).max()) for v in (before, after)]
    return {"result": sorted(result), "steepest": steepest}


def sharpen_image() -> dict[str, object]:
    """Run the operator on an image of a soft edge; return its result and the steepest values."""
    image = bpy.data.images.new("Edge", 64, 16, float_buffer=True)
    values = np.ones((16, 64, 4), np.float32)
    values[..., :3] = (1 / (1 + np.exp(-(np.arange(64) - 31.5) / 3)))[:, None]
    image.pixels.foreach_set(values.ravel())
    result = bpy.ops.shock_filter.sharpen_image(image="Edge", time=1024.0)
    flat = np.empty(values.size, np.float32)
    bpy.data.images["Edge sharpened"].pixels.foreach_get(flat)
    pair = values, flat.reshape(values.shape)
    return {"result": sorted(result), "steepest": [float(np.diff(v[8, :, 0]).max()) for v in pair]}


def sharpen_texture() -> dict[str, object]:
    """Run the operator on a soft edge on a cube; return its result and the steepest values."""
    bpy.ops.mesh.primitive_cube_add()  # it has a UV map
    image = bpy.data.images.new("Around", 64, 64, float_buffer=True)
    values = np.ones((64, 64, 4), np.float32)
    values[..., :3] = (1 / (1 + np.exp(-(np.arange(64) - 31.5) / 3)))[:, None]
    image.pixels.foreach_set(values.ravel())
    result = bpy.ops.shock_filter.sharpen_texture(image="Around", time=4096.0)
    flat = np.empty(values.size, np.float32)
    bpy.data.images["Around sharpened"].pixels.foreach_get(flat)
    around = [v[40, 10:54, 0] for v in (values, flat.reshape(values.shape))]  # inside the chart
    return {"result": sorted(result), "steepest": [float(np.diff(v).max()) for v in around]}


def denoise() -> dict[str, object]:
    """Run the operator on a noisy, painted cube; return its result, and both kinds of noise."""
    cube = add_rounded_cube()
    calm = roundness(cube)
    paint = cube.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    cube.data.color_attributes.active_color = paint
    random = np.random.default_rng(0)
    noisy = positions(cube) + random.normal(scale=0.01, size=(len(cube.data.vertices), 3))
    cube.data.attributes["position"].data.foreach_set("vector", noisy.astype(np.float32).ravel())
    cube.data.update()
    values = np.full((len(noisy), 4), 0.5, np.float32)
    values[:, :3] += random.normal(scale=0.05, size=(len(noisy), 3))
    paint.data.foreach_set("color", values.ravel())
    before = [roundness(cube) - calm, float(values.std())]
    results = [bpy.ops.shock_filter.denoise(target=t) for t in ("geometry", "colors", "both")]
    results.append(bpy.ops.shock_filter.denoise(then_sharpen=True))
    cube.data.color_attributes["Paint"].data.foreach_get("color", flat := values.ravel().copy())
    noises = [before, [roundness(cube) - calm, float(flat.std())]]
    return {"result": sorted(set.union(*results)), "noises": noises}


def denoise_image() -> dict[str, object]:
    """Run the operator on a noisy image; return its result, and the noise."""
    image = bpy.data.images.new("Noise", 48, 48, float_buffer=True)
    values = np.ones((48, 48, 4), np.float32)
    values[..., :3] = 0.5 + np.random.default_rng(0).normal(scale=0.05, size=(48, 48, 3))
    image.pixels.foreach_set(values.ravel())
    result = bpy.ops.shock_filter.denoise_image(image="Noise")
    flat = np.empty(values.size, np.float32)
    bpy.data.images["Noise denoised"].pixels.foreach_get(flat)
    noises = [[float(v[..., :3].std())] for v in (values, flat.reshape(values.shape))]
    return {"result": sorted(result), "noises": noises}


def manual_pages() -> dict[str, str]:
    """Return what a right click opens on a button and on a setting."""
    from bl_operators.wm import WM_OT_doc_view_manual

    names = ("bpy.ops.shock_filter.denoise", "bpy.types.SHOCK_FILTER_PG_geometry.time")
    return {name: WM_OT_doc_view_manual._lookup_rna_url(name, verbose=False) for name in names}


def is_registered() -> bool:
    """Tell whether Blender knows the operator."""
    return hasattr(bpy.types, "SHOCK_FILTER_OT_sharpen_geometry")


def installed_extension() -> Path:
    """Return the folder that Blender keeps the extension's own files in."""
    return Path(sys.modules[MODULE].__file__).parent


report: dict[str, object] = {"found_before": [n for n in HEAVY if importlib.util.find_spec(n)]}
bpy.ops.wm.read_homefile(use_empty=True)
if ZIP:
    bpy.ops.extensions.package_install_files(
        repo="user_default", filepath=ZIP[0], enable_on_install=True
    )
else:
    addon_utils.enable(MODULE, default_set=True)
report["enabled"] = is_registered()
report["imported_by_enabling"] = [name for name in HEAVY if name in sys.modules]
report["extension_before"] = files_below(installed_extension())
report["first"] = sharpen()
report["second"] = sharpen()
report["colors"] = sharpen_colors()
report["image"] = sharpen_image()
report["texture"] = sharpen_texture()
report["denoise"] = denoise()
report["denoise_image"] = denoise_image()
report["manual"] = manual_pages()
report["manual_is_there"] = all(
    Path(url2pathname(urlparse(url).path)).is_file() for url in report["manual"].values()
)
report["extension_after"] = files_below(installed_extension())
compiled = importlib.import_module(f"{MODULE}.core.base.compiled")
report["kernels_at"] = importlib.util.find_spec(compiled.PACKAGE).origin
report["heavy_in_use"] = [name for name in HEAVY if name in sys.modules]
user_folder = Path(bpy.utils.extension_path_user(MODULE))
report["user_folder"] = files_below(user_folder)
if ZIP:
    addon_utils.disable(MODULE, default_set=True)
    report["left_registered"] = is_registered()
    addon_utils.enable(MODULE, default_set=True)
    report["after_enabling_again"] = sharpen()
addon_utils.disable(MODULE, default_set=True)  # classes left at exit crash or hang old versions
Path(REPORT).write_text(json.dumps(report), encoding="utf-8")
sys.stdout.flush()
if bpy.app.version < (4, 5):  # as a module, 4.2 crashes at exit once a class has been registered
    os._exit(0)
