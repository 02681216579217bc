# SPDX-License-Identifier: GPL-3.0-or-later
"""Ten jobs, each from a new scene with its object selected, by clicks alone, which are counted."""

from collections.abc import Callable

import bpy
import numpy as np
import scene
from harness import (
    DRAWN,
    Rectangle,
    Steps,
    addon,
    area,
    buttons,
    click,
    click_header,
    colors,
    finished,
    open_own_panel,
    open_tab,
    park,
    picture,
    positions,
    report,
    save,
    tallest,
    widgets,
)

GEOMETRY, DENOISE, COLORS, TEXTURE = range(4)
"""The jobs, in the order of the panel."""

OF_TEXTURE = 4 + 3
"""What is to be denoised comes after the jobs."""

STITCH = 4 + 2
"""What is to be done with a texture comes after the jobs, too."""

ENLARGE = 1
"""Its place among the numbers: a width that is found has none."""


def scenario() -> Steps:
    """Do the jobs one by one; each has a picture."""
    for job in (voxel_part, boolean_stack, scan, noisy_texture, painted, blurred_texture, edges,
                uneven_charts, logo, small_drawing):  # fmt: skip
        seen = report[job.__name__] = {"clicks": 0}
        new_scene()
        yield from job(seen)
        yield from park(seen["editor"])
        picture(f"job-{job.__name__}", area(seen["editor"]), width=1400)
        save()


def new_scene() -> None:
    """Open an empty scene, whose settings are the defaults."""
    bpy.ops.scene.new(type="EMPTY")
    scene.clear()
    for image in list(bpy.data.images):
        if image.type != "RENDER_RESULT":
            bpy.data.images.remove(image)
    if any(each.type == "VIEW_3D" for each in bpy.context.window_manager.windows[0].screen.areas):
        scene.look()


def clicked(seen: dict, place: Rectangle) -> Steps:
    """Click, and count it."""
    seen["clicks"] += 1
    yield from click(place)
    yield DRAWN


def work(seen: dict, kind: str, *choices: int) -> Steps:
    """Choose in the panel, then press the main button."""
    seen["editor"] = kind
    yield from open_tab(kind)
    for number in choices:
        yield from clicked(seen, (yield from widgets("radio", kind))[number])
    places = yield from buttons(kind)
    yield from clicked(seen, tallest(places))
    yield from park(kind)
    yield from finished()
    seen["summaries"] = dict(addon("operators.base").summaries)


def changed_mesh(seen: dict, name: str, read: Callable[[str], str], *choices: int) -> Steps:
    """Do a job that changes a mesh."""
    before = read(name)
    yield from work(seen, "VIEW_3D", *choices)
    seen["changed"] = read(name) != before


def made_image(seen: dict, kind: str, *choices: int) -> Steps:
    """Do a job that makes an image."""
    before = set(bpy.data.images.keys())
    yield from work(seen, kind, *choices)
    seen["made"] = {
        name: list(bpy.data.images[name].size) for name in set(bpy.data.images.keys()) - before
    }


def voxel_part(seen: dict) -> Steps:
    """Sharpen a remeshed part."""
    scene.add_remeshed_part("Part")
    yield from changed_mesh(seen, "Part", positions)


def boolean_stack(seen: dict) -> Steps:
    """Sharpen what a stack of modifiers makes."""
    bpy.ops.mesh.primitive_cube_add(size=1.6)
    part = bpy.context.object
    part.name = "Stack"
    bpy.ops.mesh.primitive_cylinder_add(radius=0.5, depth=4.0, rotation=(0.3, 0.2, 0))
    tool = bpy.context.object
    tool.hide_set(True)
    cut = part.modifiers.new("Cut", "BOOLEAN")
    cut.operation, cut.object = "DIFFERENCE", tool
    voxel = part.modifiers.new("Remesh", "REMESH")
    voxel.mode, voxel.voxel_size = "VOXEL", 0.04
    bpy.context.view_layer.objects.active = part
    part.select_set(True)
    before, start = set(bpy.data.objects.keys()), positions("Stack")
    yield from work(seen, "VIEW_3D")
    seen["new_objects"] = sorted(set(bpy.data.objects.keys()) - before)
    seen["original_is_kept"] = positions("Stack") == start
    seen["modifiers"] = [len(bpy.data.objects[name].modifiers) for name in seen["new_objects"]]


def scan(seen: dict) -> Steps:
    """Denoise a scan."""
    scene.add_monkey("Scan", 3)
    mesh = bpy.data.objects["Scan"].data
    points = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.vertices.foreach_get("co", points)
    points += np.random.default_rng(0).normal(scale=0.004, size=len(points)).astype(np.float32)
    mesh.vertices.foreach_set("co", points)
    mesh.update()
    yield from changed_mesh(seen, "Scan", positions, DENOISE)


def noisy_texture(seen: dict) -> Steps:
    """Denoise a texture."""
    add_textured(noise=0.05)
    yield from made_image(seen, "VIEW_3D", DENOISE, OF_TEXTURE)


def painted(seen: dict) -> Steps:
    """Sharpen painted vertices."""
    scene.add_monkey("Painted", 2)
    area("VIEW_3D").spaces.active.shading.color_type = "VERTEX"
    yield from changed_mesh(seen, "Painted", colors, COLORS)


def blurred_texture(seen: dict) -> Steps:
    """Sharpen a texture."""
    add_textured()
    yield from made_image(seen, "VIEW_3D", TEXTURE)


def uneven_charts(seen: dict) -> Steps:
    """Even out charts of a texture that are brighter or darker than others."""
    image = add_textured()
    size = image.size[0]
    values = np.empty(4 * size * size, np.float32)
    image.pixels.foreach_get(values)
    values = values.reshape(size, size, 4)
    values[: size // 2, :, :3] *= 0.7
    image.pixels.foreach_set(values.ravel())
    image.update()
    yield from made_image(seen, "VIEW_3D", TEXTURE, STITCH)


def edges(seen: dict) -> Steps:
    """Make a mask that rises from marked edges."""
    add_textured()
    for edge in bpy.context.object.data.edges:
        edge.use_edge_sharp = edge.index % 7 == 0
    before = set(bpy.data.images.keys())
    yield from open_tab()
    seen["editor"] = "VIEW_3D"
    seen["clicks"] += 2  # one closes the first panel, below which this one lies
    yield from open_own_panel(-3)
    places = yield from buttons()
    yield from clicked(seen, tallest(places))
    yield from park()
    yield from finished()
    seen["summaries"] = dict(addon("operators.base").summaries)
    seen["made"] = {
        name: list(bpy.data.images[name].size) for name in set(bpy.data.images.keys()) - before
    }
    yield from click_header(0)


def logo(seen: dict) -> Steps:
    """Sharpen a soft logo in the Image Editor."""
    area("VIEW_3D").type = "IMAGE_EDITOR"
    yield DRAWN
    y, x = np.mgrid[:256, :256] - 127.5
    away = 60.0 + 20.0 * np.sin(5 * np.arctan2(y, x)) - np.hypot(x, y)
    values = np.ones((256, 256, 4), np.float32) * (0.8, 0.2, 0.1, 1.0)
    values[..., 3] = 0.5 + 0.5 * np.tanh(away / 3.0)
    show(scene.as_image("Logo", values))
    yield from made_image(seen, "IMAGE_EDITOR")


def small_drawing(seen: dict) -> Steps:
    """Enlarge a small drawing three times."""
    y, x = np.mgrid[:96, :96]
    values = np.ones((96, 96, 4), np.float32)
    for center, radius, color in (
        ((30, 40), 20.5, (0.9, 0.2, 0.1)),
        ((60, 55), 24.3, (0.1, 0.3, 0.8)),
    ):
        inside = np.clip(radius - np.hypot(x - center[0], y - center[1]) + 0.5, 0, 1)[..., None]
        values[..., :3] += inside * (np.array(color) - values[..., :3])
    show(scene.as_image("Drawing", values))
    seen["editor"] = "IMAGE_EDITOR"
    yield from open_tab("IMAGE_EDITOR")
    numbers: list[Rectangle] = []
    while len(numbers) <= ENLARGE:  # a busy Blender draws late; the test has a limit
        numbers = yield from widgets("num", "IMAGE_EDITOR")
    place = numbers[ENLARGE]
    arrow = (place[2] - 10, place[1], place[2] - 2, place[3])
    for _ in range(2):
        yield from clicked(seen, arrow)
    yield from made_image(seen, "IMAGE_EDITOR")


def show(image: bpy.types.Image) -> None:
    """Show an image in the Image Editor."""
    area("IMAGE_EDITOR").spaces.active.image = image


def add_textured(noise: float = 0.0) -> bpy.types.Image:
    """Add a monkey with a texture of soft bands."""
    area("VIEW_3D").spaces.active.shading.color_type = "TEXTURE"
    image = scene.add_texture(scene.add_monkey("Coated", 1))
    if noise:
        values = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(values)
        values += np.random.default_rng(0).normal(scale=noise, size=len(values))
        image.pixels.foreach_set(values.clip(0, 1).astype(np.float32))
        image.update()
    return image
