# SPDX-License-Identifier: GPL-3.0-or-later
"""Sharpen softened shapes, colors and a photo with Blender's operators; show before and after.

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
import photo
import shapes
import shock_filter
from picture import PAINT, View, render
from shock_filter.core.settings import OF_PAPER

OURS = {"time": 1024.0}
EVERYWHERE = {**OF_PAPER, "time": 1024.0}
PAPER = {**OF_PAPER, "time": 1024.0, "feature_threshold": 0.0, "sampling": "linear"}

FACE = View(rotation=(0, 0, -25), centre=(0.13, 0.0), size=2.65, light=(-0.9, -0.6, 0.9))
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
        pictures += show_colors(options.out, options.pixels)
        pictures += show_photo(options.out)
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
    ours, paper = sharpened(obj, EVERYWHERE), sharpened(obj, PAPER)
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


def show_colors(out: Path, pixels: int) -> list[Path]:
    """Sharpen blurred paint on Suzanne."""
    obj = shapes.suzanne(subdivisions=4)
    shapes.paint(obj, PAINT, passes=30)
    print(f"\nSuzanne with blurred paint: {len(obj.data.vertices):,} vertices")
    blurred = obj.data
    sharp = copied(obj)
    run("sharpen_colors", {})
    slopes = [measure.color_slope(shapes.read_colors(mesh, PAINT), shapes.read_triangles(mesh))
              for mesh in (blurred, sharp.data)]  # fmt: skip
    print(f"  steepest colors: {slopes[0]:.2f} an edge before, {slopes[1]:.2f} after")
    if not slopes[1] > slopes[0]:
        raise DemoFailed("sharpening did not steepen the colors.")
    columns = [("Blurred", blurred), ("Sharpened", sharp.data)]
    return [picture(out / "colors.png", FACE, columns, pixels)]


def show_photo(out: Path) -> list[Path]:
    """Sharpen a blurred photograph with the operator of the Image Editor."""
    original, blurred = photo.blurred_photo()
    image = photo.to_blender("Photo", blurred)
    print(f"\nPhotograph, blurred: {image.size[0]} x {image.size[1]} pixels")
    run("sharpen_image", {"image": image.name})
    sharp = photo.from_blender(bpy.data.images[f"{image.name} sharpened"])
    for name, pixels in (("original", original), ("blurred", blurred), ("sharpened", sharp)):
        print(f"  {name:10} steepest edges: {photo.slope(pixels):.3f} a pixel")
    beyond = photo.overshoot(blurred, sharp)
    print(f"  values outside the blurred photo's range nearby: {beyond:.4f} at most")
    # Blender keeps the image in steps of 1 / 255.
    if not photo.slope(sharp) > photo.slope(blurred) or beyond > 1 / 255:
        raise DemoFailed("sharpening did not steepen the photo's edges, or overshot.")
    return [photo.side_by_side(out / "photo.png", [blurred, sharp])]


def copied(obj: bpy.types.Object) -> bpy.types.Object:
    """Copy an object with its mesh; the copy alone is selected."""
    copy = bpy.data.objects.new(obj.name, obj.data.copy())
    bpy.context.collection.objects.link(copy)
    for other in bpy.context.selected_objects:
        other.select_set(False)
    copy.select_set(True)
    bpy.context.view_layer.objects.active = copy
    return copy


def run(name: str, settings: dict[str, float | str]) -> None:
    """Call an operator of the extension, or say why it failed."""
    start = time.perf_counter()
    try:
        result = getattr(bpy.ops.shock_filter, name)(**settings)
    except RuntimeError as error:  # the operator's error report
        raise DemoFailed(str(error).strip().removeprefix("Error: ")) from error
    if result != {"FINISHED"}:
        raise DemoFailed(f"the operator {name} returned {result}.")
    words = ", ".join(f"{key} {value}" for key, value in settings.items())
    print(f"  {name}({words}): {time.perf_counter() - start:.2f} s")


def sharpened(obj: bpy.types.Object, settings: dict[str, float | str]) -> bpy.types.Mesh:
    """Sharpen the geometry of a copy of the object; returns the copy's mesh."""
    copy = copied(obj)
    run("sharpen_geometry", settings)
    if (shapes.read_positions(copy.data) == shapes.read_positions(obj.data)).all():
        raise DemoFailed(f"the operator moved no vertex of {obj.name}.")
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
