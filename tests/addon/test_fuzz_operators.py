# SPDX-License-Identifier: GPL-3.0-or-later
"""Random meshes, data, modes and properties through the operators, as `tests/fuzz` does it."""

import bmesh
import bpy
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from shock_filter.shock_addon.data.image.tiles import new_tiled_like
from shock_filter.shock_addon.operators import base as operators
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
    "image": [*["Texture"] * 6, "", "no such image"],
    "mask_image": ["", "", "", "Texture", "no such image"],
}
MOSTLY = st.sampled_from([True, True, True, False])
MOST_COUNT = 4  # of passes and the like: the operators hand them on, no more


@st.composite
def random_objects(draw):
    """Make an object with all that operators look at; select only it."""
    vertices, faces = draw(triangles())
    assume(len(faces) < 400 and 1e-10 < np.abs(vertices).max() < 1e20)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    mesh = bpy.data.meshes.new("Random")
    wires = rng.integers(0, len(vertices), (draw(st.sampled_from([0, 0, 3])), 2))
    mesh.from_pydata(vertices.tolist(), wires.tolist(), faces.tolist())
    mesh.validate()  # Blender itself is not made for faces that name a vertex twice
    if draw(st.booleans()):
        join_faces(mesh, rng)
    obj = bpy.data.objects.new("Random", mesh)
    bpy.context.collection.objects.link(obj)
    for name, domain in (("Paint", "POINT"), ("Corners", "CORNER")):
        if draw(MOSTLY):
            kind = draw(st.sampled_from(["FLOAT_COLOR", "BYTE_COLOR"]))
            layer = mesh.color_attributes.new(name, kind, domain)
            layer.data.foreach_set("color", rng.random(4 * len(layer.data), np.float32))
    if draw(st.booleans()):
        group = obj.vertex_groups.new(name="Group")
        for vertex in range(0, len(mesh.vertices), 2):
            group.add([vertex], rng.random(), "REPLACE")
    if draw(MOSTLY):
        layer = mesh.uv_layers.new(name="UVMap")
        size = max(float(np.ptp(vertices, axis=0).max()), 1e-30)
        flat = (vertices[[loop.vertex_index for loop in mesh.loops], :2] - vertices.min()) / size
        rough = draw(st.sampled_from([0.0, 0.0, 0.01, 1.0]))
        across = draw(st.sampled_from([1.0, 1.0, 2.0]))  # tiles
        places = across * flat + rough * rng.random(flat.shape)
        layer.uv.foreach_set("vector", places.astype(np.float32).reshape(-1))
    if not draw(MOSTLY):
        obj.shape_key_add(name="Basis")
        obj.shape_key_add(name="Key")
        obj.active_shape_key_index = draw(st.integers(0, 1))
    obj.scale = draw(
        st.sampled_from([(1, 1, 1), (1, 1, 1), (1, 2, 0.5), (3, 3, 3), (-1, 1, 1), (1, 0, 1)])
    )
    mesh.use_mirror_x = draw(st.booleans())
    adorn(draw, obj, rng)
    bpy.ops.object.select_all(action="DESELECT")
    if not draw(MOSTLY):  # a second user of the mesh, and another mesh
        bpy.context.collection.objects.link(obj.copy())
        bpy.ops.mesh.primitive_cube_add()
        for other in bpy.context.collection.objects:
            other.select_set(True)
    if not draw(MOSTLY):
        spoil(draw, obj)
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    return obj


def join_faces(mesh, rng):
    """Turn some triangles into polygons."""
    shape = bmesh.new()
    shape.from_mesh(mesh)
    chosen = [e for e in shape.edges if len(e.link_faces) == 2 and rng.random() < 0.3]
    bmesh.ops.dissolve_edges(shape, edges=chosen)
    shape.to_mesh(mesh)
    shape.free()


def adorn(draw, obj, rng):
    """Select, hide and mask some of the mesh; add a modifier, sharp edges and custom normals."""
    mesh = obj.data
    for elements in (mesh.vertices, mesh.polygons):
        for flag in ("select", "hide"):
            if not draw(MOSTLY):
                elements.foreach_set(flag, rng.random(len(elements)) < 0.5)
    if not draw(MOSTLY):
        mask = mesh.attributes.new(".sculpt_mask", "FLOAT", "POINT")
        mask.data.foreach_set("value", rng.random(len(mesh.vertices), np.float32))
    if not draw(MOSTLY):
        kind = draw(st.sampled_from(["MIRROR", "MULTIRES", "SUBSURF"]))
        obj.modifiers.new("Modifier", kind)
    if not draw(MOSTLY):
        mesh.edges.foreach_set("use_edge_sharp", rng.random(len(mesh.edges)) < 0.5)
        mesh.normals_split_custom_set_from_vertices(rng.normal(size=(len(mesh.vertices), 3)))


def spoil(draw, obj):
    """Put a NaN or an infinity into one of the object's arrays."""
    mesh = obj.data
    keys = mesh.shape_keys.key_blocks if mesh.shape_keys else []
    arrays = [(mesh.vertices, "co"), *((key.data, "co") for key in keys)]
    arrays += [(layer.data, "color") for layer in mesh.color_attributes]
    arrays += [(layer.uv, "vector") for layer in mesh.uv_layers]
    elements, name = draw(st.sampled_from([pair for pair in arrays if len(pair[0])]))
    element = elements[draw(st.integers(0, len(elements) - 1))]
    getattr(element, name)[0] = draw(st.sampled_from([np.nan, np.inf, 3e38]))


@st.composite
def random_images(draw):
    """Make an image with random pixels, or one of tiles."""
    sizes = st.sampled_from([1, 2, 3, 8, 17])
    width, height = draw(sizes), draw(sizes)
    image = bpy.data.images.new(
        "Texture", width, height, alpha=draw(st.booleans()), float_buffer=draw(st.booleans())
    )
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    bright = draw(st.sampled_from([0.0, 1.0, 1e4]))
    image.pixels.foreach_set(bright * rng.random(4 * width * height, np.float32))
    if not draw(MOSTLY):
        numbers = draw(st.sets(st.sampled_from([1001, 1002, 1011, 1099]), min_size=1))
        tiles = {
            number: bright * rng.random((draw(sizes), draw(sizes), 4), np.float32)
            for number in numbers
        }
        tiled = new_tiled_like(image, "Tiles", tiles)
        bpy.data.images.remove(image)
        tiled.name = "Texture"
    return "Texture"


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
    return {name: random_value(draw, known[name]) for name in chosen}


def state():
    """What an operator that does nothing must leave alone."""
    kept = {}
    for mesh in bpy.data.meshes:
        kept[mesh.name, "positions"] = mesh.attributes["position"].data, "vector", 3
        for layer in mesh.color_attributes:
            kept[mesh.name, layer.name] = layer.data, "color", 4
        for layer in mesh.uv_layers:
            kept[mesh.name, layer.name] = layer.uv, "vector", 2
        for key in mesh.shape_keys.key_blocks if mesh.shape_keys else []:
            kept[mesh.name, key.name] = key.data, "co", 3
    arrays = {}
    for label, (elements, name, width) in kept.items():
        arrays[label] = np.empty(width * len(elements), np.float32)
        elements.foreach_get(name, arrays[label])
    for mesh in bpy.data.meshes:
        arrays[mesh.name, "sharp"] = np.array([edge.use_edge_sharp for edge in mesh.edges], float)
    for image in bpy.data.images:
        arrays[image.name] = np.empty(len(image.pixels), np.float32)
        image.pixels.foreach_get(arrays[image.name])
    return arrays


def same(arrays, others):
    """Whether two states are alike, bit for bit."""
    return arrays.keys() == others.keys() and all(
        array.tobytes() == others[label].tobytes() for label, array in arrays.items()
    )


def of_meshes(arrays):
    """The part of a state that undo brings back."""
    return {label: array for label, array in arrays.items() if isinstance(label, tuple)}


class Impatience:
    """Cancels a run when it reports for the given time, or never."""

    def __init__(self, patience):
        self.patience = patience

    def __call__(self, fraction, message):
        if self.patience is not None:
            self.patience -= 1
        return self.patience is None or self.patience >= 0


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
    for each in (mode, "OBJECT"):  # what Blender itself makes of it on the way
        bpy.ops.object.mode_set(mode=each)
    counts = len(obj.data.vertices), len(obj.data.polygons)
    before = state()
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="Before")
    patience = data.draw(st.sampled_from([None, None, None, 0, 1, 2, 4, 10]))
    result = run(operator, values, patience)
    assert bpy.context.mode.startswith(mode.split("_")[-1]) or bpy.context.mode.endswith(mode)
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (len(obj.data.vertices), len(obj.data.polygons)) == counts
    after = state()
    for label, array in after.items():
        nothing = np.zeros(array.shape)
        old = before.get(label, nothing)
        spoiled = ~np.isfinite(old if old.shape == array.shape else nothing)  # it may be enlarged
        assert (np.isfinite(array) | spoiled).all()
    if result == {"CANCELLED"}:
        assert same(after, before)
    elif mode == "OBJECT":
        bpy.ops.ed.undo_push(message="After")
        bpy.ops.ed.undo()
        assert same(of_meshes(state()), of_meshes(before))
        assert run(operator, values, None) == result
        assert same(of_meshes(state()), of_meshes(after))


def run(operator, values, patience):
    """Run an operator; what fails must say so in a sentence."""
    operators.listener = Impatience(patience)
    try:
        return operator(**values)
    except RuntimeError as error:
        text = str(error).strip()
        assert "Traceback" not in text
        assert text.endswith((".", "failed, context is incorrect")) or "poll()" in text
        return {"CANCELLED"}
    finally:
        operators.listener = None
