# SPDX-License-Identifier: GPL-3.0-or-later
"""Random meshes, data, modes and properties through the operators, as `tests/fuzz` does it."""

import bpy
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from strategies import examples, triangles

pytestmark = pytest.mark.timeout(1800, method="thread")  # a thread can end compiled code, too

OPERATORS = [
    "sharpen_geometry", "sharpen_colors", "denoise", "sharpen_texture", "dilate_texture",
    "sharpen_image", "denoise_image", "show_flow",
]  # fmt: skip
MODES = ["OBJECT", "EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"]
NAMES = {
    "vertex_group": ["", "", "Group", "Group", "no such group"],
    "attribute": ["", "", "Paint", "Corners", "no such attribute"],
    "image": ["", *["Texture"] * 6, "no such image"],
    "mask_image": ["", "", "", "Texture", "no such image"],
}
MOST_COUNT = 4  # of passes and the like: the operators hand them on, no more
LONGEST_TIME = 6.0  # of the schemes that compute the flow anew


@st.composite
def random_objects(draw):
    """Make an object with all that operators look at; select only it."""
    vertices, faces = draw(triangles())
    assume(len(faces) < 400 and 1e-10 < np.abs(vertices).max() < 1e20)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mesh = bpy.data.meshes.new("Random")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.validate()  # Blender itself is not made for faces that name a vertex twice
    obj = bpy.data.objects.new("Random", mesh)
    bpy.context.collection.objects.link(obj)
    for name, domain in (("Paint", "POINT"), ("Corners", "CORNER")):
        if draw(st.integers(0, 3)):
            kind = draw(st.sampled_from(["FLOAT_COLOR", "BYTE_COLOR"]))
            layer = mesh.color_attributes.new(name, kind, domain)
            layer.data.foreach_set("color", rng.random(4 * len(layer.data), np.float32))
    if draw(st.booleans()):
        group = obj.vertex_groups.new(name="Group")
        for vertex in range(0, len(mesh.vertices), 2):
            group.add([vertex], rng.random(), "REPLACE")
    if draw(st.integers(0, 3)):
        layer = mesh.uv_layers.new(name="UVMap")
        size = max(float(np.ptp(vertices, axis=0).max()), 1e-30)
        flat = (vertices[[loop.vertex_index for loop in mesh.loops], :2] - vertices.min()) / size
        rough = draw(st.sampled_from([0.0, 0.0, 0.01, 1.0]))
        places = flat + rough * rng.random(flat.shape)
        layer.uv.foreach_set("vector", places.astype(np.float32).reshape(-1))
    if draw(st.integers(0, 3)) == 0:
        obj.shape_key_add(name="Basis")
        obj.shape_key_add(name="Key")
        obj.active_shape_key_index = draw(st.integers(0, 1))
    obj.scale = draw(
        st.sampled_from([(1, 1, 1), (1, 1, 1), (1, 2, 0.5), (3, 3, 3), (-1, 1, 1), (1, 0, 1)])
    )
    mesh.use_mirror_x = draw(st.booleans())
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    return obj


@st.composite
def random_images(draw):
    """Make an image with random pixels."""
    sizes = st.sampled_from([1, 2, 3, 8, 17])
    width, height = draw(sizes), draw(sizes)
    image = bpy.data.images.new(
        "Texture", width, height, alpha=draw(st.booleans()), float_buffer=draw(st.booleans())
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bright = draw(st.sampled_from([0.0, 1.0, 1e4]))
    image.pixels.foreach_set(bright * rng.random(4 * width * height, np.float32))
    return image


def random_value(draw, about):
    """Draw a value for an operator's property."""
    if about.type == "BOOLEAN":
        return draw(st.booleans())
    if about.type == "ENUM":
        return draw(st.sampled_from(about.enum_items.keys()))
    if about.type == "STRING":
        return draw(st.sampled_from(NAMES.get(about.identifier, ["", "Name"])))
    if about.type == "INT":
        return draw(st.integers(about.hard_min, min(about.hard_max, about.hard_min + MOST_COUNT)))
    soft = st.floats(about.soft_min, about.soft_max, width=32)
    return draw(st.one_of(soft, st.sampled_from([about.hard_min, about.hard_max])))


def random_properties(draw, operator):
    """Draw some of an operator's properties."""
    known = operator.get_rna_type().properties
    names = [
        about.identifier
        for about in known
        if about.identifier not in ("rna_type", "result")
        and not (getattr(about, "is_array", False) or about.type in ("COLLECTION", "POINTER"))
    ]
    chosen = draw(st.lists(st.sampled_from(names), unique=True, max_size=len(names)))
    values = {name: random_value(draw, known[name]) for name in chosen}
    if values.get("scheme", "fixed") != "fixed":
        values["time"] = min(values.get("time", LONGEST_TIME), LONGEST_TIME)
        values.pop("steady_state", None)
    return values


def state(obj):
    """What an operator that does nothing must leave alone."""
    mesh = obj.data
    positions = np.empty(3 * len(mesh.vertices), np.float32)
    mesh.attributes["position"].data.foreach_get("vector", positions)
    kept = [positions]
    for layer in mesh.color_attributes:
        colors = np.empty(4 * len(layer.data), np.float32)
        layer.data.foreach_get("color", colors)
        kept.append(colors)
    for image in bpy.data.images:
        pixels = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(pixels)
        kept.append(pixels)
    return kept


@pytest.mark.parametrize("name", OPERATORS)
def test_operators_do_their_work_or_say_why_not(name):
    examples(15)(given(st.data())(lambda data: run_once(name, data)))()


def run_once(name, data):
    """Run an operator on random data, and look at what it leaves behind."""
    bpy.ops.wm.read_homefile(use_empty=True)
    obj = data.draw(random_objects())
    data.draw(random_images())
    operator = getattr(bpy.ops.shock_filter, name)
    values = random_properties(data.draw, operator)
    if "image" in operator.get_rna_type().properties:
        values["image"] = data.draw(st.sampled_from(NAMES["image"]))
    mode = data.draw(st.sampled_from(MODES))
    bpy.ops.object.mode_set(mode=mode)
    counts = len(obj.data.vertices), len(obj.data.polygons)
    before = state(obj) if mode != "EDIT" else None
    try:
        result = operator(**values)
    except RuntimeError as error:
        result = {"CANCELLED"}
        text = str(error).strip()
        assert "Traceback" not in text
        assert text.endswith((".", "failed, context is incorrect")) or "poll()" in text
    assert bpy.context.mode.startswith(mode.split("_")[-1]) or bpy.context.mode.endswith(mode)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (len(obj.data.vertices), len(obj.data.polygons)) == counts
    after = state(obj)
    assert all(np.isfinite(array).all() for array in after)
    if result == {"CANCELLED"} and before is not None:
        assert [array.tobytes() for array in after] == [array.tobytes() for array in before]
