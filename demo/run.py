# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen softened shapes with the Blender operator and render them before and after.

``python demo/run.py`` writes pictures to demo/out and prints what was measured. Needs Blender as
a Python module (bpy) and the package shock_filter; ``nox -s demo`` brings both.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

import bpy
import measure
import shapes
import shock_filter
from picture import View, render

OURS = {"time": 1024.0}
PAPER = {"time": 1024.0, "feature_threshold": 0.0, "sampling": "linear"}

FACE = View(rotation=(0, 0, -25), centre=(0.12, 0.0), size=2.5, light=(-0.9, -0.6, 0.9))
GEAR = View(rotation=(50, 0, 20), centre=(0.0, 0.2), size=2.2, light=(-0.9, -0.3, 0.7))


class DemoFailed(Exception):
    """A step did not do what it should; the message says which."""


def main() -> int:
    """Run the demo; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--out",
        type=Path,
        default=Path(__file__).resolve().parent / "out",
        help="folder for the pictures (default: demo/out)",
    )
    parser.add_argument("--pixels", type=int, default=400, help="width of one shape (default: 400)")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)

    bpy.ops.wm.read_homefile(use_empty=True)
    shock_filter.register()
    print("The first call of the operator loads the kernels, and compiles them if that is new.")
    try:
        pictures = show_suzanne(options.out, options.pixels)
        pictures += show_gear(options.out, options.pixels)
    except DemoFailed as error:
        print(f"The demo failed: {error}", file=sys.stderr)
        return 1
    finally:
        shock_filter.unregister()  # Blender may hang or crash at exit otherwise
    print("\nPictures:")
    for path in pictures:
        print(f"  {path}")
    return 0


def show_suzanne(out: Path, pixels: int) -> list[Path]:
    """Soften and sharpen Blender's monkey, with our settings and with the paper's."""
    obj = shapes.suzanne(subdivisions=2)
    shapes.soften(obj, passes=2)
    print(f"\nSuzanne, subdivided and softened: {len(obj.data.vertices):,} vertices")
    softened = obj.data
    ours, paper = sharpened(obj, OURS), sharpened(obj, PAPER)
    for name, mesh in (("softened", softened), ("sharpened", ours), ("paper's settings", paper)):
        print(f"  {name:18} {crease_text(mesh)}")
    columns = [("Softened", softened), ("Sharpened", ours), ("With the paper's settings", paper)]
    return [picture(out / "suzanne.png", FACE, columns, pixels)]


def show_gear(out: Path, pixels: int) -> list[Path]:
    """Soften and sharpen a gear, and compare with the gear as it was designed."""
    obj = shapes.gear(spacing=0.02)
    designed = obj.data.copy()
    shapes.soften(obj, passes=5)
    print(f"\nGear, softened: {len(obj.data.vertices):,} vertices")
    softened = obj.data
    ours, paper = sharpened(obj, OURS), sharpened(obj, PAPER)
    named = {
        "as designed": designed,
        "softened": softened,
        "sharpened": ours,
        "paper's settings": paper,
    }
    errors = {}
    for name, mesh in named.items():
        errors[name] = measure.normal_error(
            shapes.read_positions(mesh),
            shapes.read_positions(designed),
            shapes.read_triangles(mesh),
        )
        print(f"  {name:18} {crease_text(mesh)}; normals off by {errors[name]:.1f} degrees")
    if not errors["sharpened"] < errors["softened"]:
        raise DemoFailed("sharpening did not bring the gear's normals closer to the design.")
    columns = [("As designed", designed), ("Softened", softened), ("Sharpened", ours)]
    return [picture(out / "gear.png", GEAR, columns, pixels)]


def sharpened(obj: bpy.types.Object, settings: dict[str, float | str]) -> bpy.types.Mesh:
    """Run the operator on a copy of the object; returns the copy's mesh."""
    copy = bpy.data.objects.new(obj.name, obj.data.copy())
    bpy.context.collection.objects.link(copy)
    for other in bpy.context.selected_objects:
        other.select_set(False)
    copy.select_set(True)
    bpy.context.view_layer.objects.active = copy
    start = time.perf_counter()
    try:
        result = bpy.ops.shock_filter.sharpen_geometry(**settings)
    except RuntimeError as error:  # the operator's error report
        raise DemoFailed(str(error).strip().removeprefix("Error: ")) from error
    if result != {"FINISHED"}:
        raise DemoFailed(f"the operator returned {result} for {obj.name}.")
    if (shapes.read_positions(copy.data) == shapes.read_positions(obj.data)).all():
        raise DemoFailed(f"the operator moved no vertex of {obj.name}.")
    words = ", ".join(f"{name} {value}" for name, value in settings.items())
    print(f"  sharpen_geometry({words}): {time.perf_counter() - start:.2f} s")
    return copy.data


def crease_text(mesh: bpy.types.Mesh) -> str:
    """Say how much of the mesh's bending is in sharp edges."""
    share = measure.crease_share(shapes.read_positions(mesh), shapes.read_triangles(mesh))
    return f"{100 * share:5.1f} % of all bending in edges of more than 20 degrees"


def picture(path: Path, view: View, columns: list[tuple[str, bpy.types.Mesh]], pixels: int) -> Path:
    """Render, and check that the file is there."""
    path.unlink(missing_ok=True)
    try:
        render(path, view, columns, pixels)
    except RuntimeError as error:  # the renderer's error report
        raise DemoFailed(str(error).strip().removeprefix("Error: ")) from error
    if not path.exists():
        raise DemoFailed(f"Cycles wrote no picture to {path}.")
    return path


if __name__ == "__main__":
    sys.exit(main())
