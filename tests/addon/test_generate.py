# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Generate: images, and attributes, that are made from the shape of objects."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data import chosen
from shock_filter.shock_addon.data.image import images as image_data
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import linking

link_map = bpy.ops.shock_filter.link_map
generate = bpy.ops.shock_filter.generate

SIZE = 256
LENGTH = 2.0
"""Of the sheet's sides."""


def read(name):
    return image_data.read_pixels(bpy.data.images[name])[..., 0]


def add_sheet(left=0.0, width=1.0):
    """A sheet of 64 quads, whose UVs fill columns of the image; nothing is selected."""
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=8, y_subdivisions=8, calc_uvs=True)
    sheet = bpy.context.object
    for loop in sheet.data.uv_layers.active.uv:
        loop.vector = left + width * loop.vector[0], loop.vector[1]
    for elements in (sheet.data.vertices, sheet.data.edges, sheet.data.polygons):
        elements.foreach_set("select", [False] * len(elements))
    return sheet


@pytest.fixture
def sheet():
    """A flat square, 2 by 2."""
    return add_sheet()


def in_column(obj, x):
    """The edges of an object on a line."""
    points = [vertex.co.x for vertex in obj.data.vertices]
    return [e for e in obj.data.edges if all(abs(points[v] - x) < 1e-6 for v in e.vertices)]


def from_left():
    """How far each texel is from the left side."""
    columns = (np.arange(SIZE) + 0.5) / SIZE * LENGTH
    return np.broadcast_to(columns, (SIZE, SIZE))


def select(obj):
    for edge in in_column(obj, -1.0):
        edge.select = True


def mark_seams(obj):
    for edge in in_column(obj, -1.0):
        edge.use_seam = True


def mark_sharp(obj):
    for edge in in_column(obj, -1.0):
        edge.use_edge_sharp = True


def add_group(obj):
    group = obj.vertex_groups.new(name="Left")
    group.add([v.index for v in obj.data.vertices if v.co.x < -0.99], 0.5, "REPLACE")
    group.add([v.index for v in obj.data.vertices if v.co.x > 0.99], 0.4, "REPLACE")


def paint(obj):
    pixels = np.zeros((SIZE, SIZE, 4), dtype=np.float32)
    pixels[:, 0, :3] = pixels[..., 3:] = 1.0
    image = bpy.data.images.new("Start", SIZE, SIZE)
    image.pixels.foreach_set(pixels.reshape(-1))


@pytest.mark.parametrize(
    ("prepare", "words"),
    [
        (select, {}),
        (select, {"start": "SELECTED"}),
        (mark_seams, {"start": "SEAMS"}),
        (mark_sharp, {"start": "SHARP"}),
        (add_group, {"start": "GROUP", "start_group": "Left"}),
        (paint, {"start": "IMAGE", "start_image": "Start"}),
    ],
)
def test_distance_counts_from_what_is_said(sheet, prepare, words):
    prepare(sheet)
    assert generate(look="distance", image_size=str(SIZE), **words) == {"FINISHED"}
    image = bpy.data.images["Grid Distance"]
    assert image.is_float
    assert image.colorspace_settings.name == "Non-Color"
    assert image.packed_file is not None
    off = read("Grid Distance") - from_left()
    assert np.abs(off).max() < 1.1 * LENGTH / SIZE  # painted texels are the start as a whole
    said = operators.summaries["generate"]
    assert "Generated Grid Distance on 1 object: 256 x 256 pixels" in said


def test_distance_counts_from_borders(sheet):
    assert generate(look="distance", source="border", image_size=str(SIZE)) == {"FINISHED"}
    middle = read("Grid Distance")[SIZE // 2]
    np.testing.assert_allclose(middle, np.minimum(from_left(), LENGTH - from_left())[0], atol=0.01)


def test_the_default_is_seen_whatever_the_size_of_the_object(sheet):
    sheet.scale = 100.0, 100.0, 1.0
    select(sheet)
    bpy.context.view_layer.update()
    assert generate(image_size=str(SIZE)) == {"FINISHED"}
    np.testing.assert_allclose(read("Grid Distance"), 1.0 - from_left() / LENGTH, atol=0.01)


def test_distance_at_vertices_is_an_attribute(sheet):
    other = add_sheet()
    other.location.x = 9.0
    for obj in (sheet, other):
        select(obj)
        obj.select_set(True)
    for loop in other.data.uv_layers.active.uv:  # the objects share the image
        loop.vector = 0.5 + 0.5 * loop.vector[0], loop.vector[1]
    for loop in sheet.data.uv_layers.active.uv:
        loop.vector = 0.5 * loop.vector[0], loop.vector[1]
    assert generate(look="distance", into="ATTRIBUTE", image_size=str(SIZE)) == {"FINISHED"}
    assert len(bpy.data.images) == 0
    for obj in (sheet, other):
        values = [each.value for each in obj.data.attributes["Distance"].data]
        wanted = [vertex.co.x + 1.0 for vertex in obj.data.vertices]
        np.testing.assert_allclose(values, wanted, atol=1e-5)
    assert "Generated Distance on 2 objects: 162 vertices" in operators.summaries["generate"]


@pytest.mark.parametrize("into", ["IMAGE", "ATTRIBUTE"])
def test_objects_are_found_again_whatever_their_names(sheet, into):
    """One is renamed during the run, and another takes its name."""
    select(sheet)
    meanwhile = iter([True])

    def rename(*_):
        if next(meanwhile, False):
            name, sheet.name = sheet.name, "Renamed"
            bpy.context.collection.objects.link(bpy.data.objects.new(name, sheet.data.copy()))

    operators.listener = rename
    try:
        assert generate(look="distance", into=into, image_size=str(SIZE)) == {"FINISHED"}
    finally:
        operators.listener = None
    other = bpy.data.objects["Grid"]
    assert other.active_material is None
    assert "Distance" not in other.data.attributes
    if into == "IMAGE":
        nodes = sheet.active_material.node_tree.nodes
        assert [node.image.name for node in nodes if node.type == "TEX_IMAGE"] == ["Grid Distance"]
    else:
        assert "Distance" in sheet.data.attributes


def test_maps_of_the_shape_are_made(sheet):
    """Of a bump on a sheet: it is convex, has a valley around it, and stands in the light's way."""
    for vertex in sheet.data.vertices:
        vertex.co.z = 0.5 * np.exp(-6.0 * (vertex.co.x**2 + vertex.co.y**2))
    for target in ("curvature", "occlusion", "thickness", "wear"):
        assert generate(target=target, image_size=str(SIZE)) == {"FINISHED"}
    curvature, open_sky = read("Grid Curvature"), read("Grid Occlusion")
    assert bpy.data.images["Grid Curvature"].is_float
    middle, valley, far = (SIZE // 2, SIZE // 2), (SIZE // 2, SIZE // 6), (6, 6)
    assert curvature[middle] > 0.8
    assert curvature[valley] < curvature[far] < curvature[middle]
    assert open_sky[valley] < 0.993 < open_sky[middle]
    assert read("Grid Thickness")[far] > 0.99  # rays come out nowhere
    assert read("Grid Wear")[far] == 0
    made = generate(target="wear", wear_kind="dust", wear_breakup=0, into="ATTRIBUTE")
    assert made == {"FINISHED"}
    dust = np.array([each.value for each in sheet.data.attributes["Wear"].data])
    heights = np.array([vertex.co.z for vertex in sheet.data.vertices])
    assert dust[heights < 1e-3].min() > 0.9 > dust[(heights > 0.2) & (heights < 0.3)].max()


def test_other_objects_occlude_by_choice(sheet):
    bpy.ops.mesh.primitive_plane_add(size=50, location=(0.5, 0, 0), rotation=(0, np.pi / 2, 0))
    bpy.context.object.select_set(False)
    bpy.context.view_layer.objects.active = sheet
    sheet.select_set(True)
    words = {"target": "occlusion", "image_size": "256", "occlusion_rays": 32}
    assert bpy.ops.shock_filter.generate(**words) == {"FINISHED"}
    shaded = read(f"{sheet.name} Occlusion")
    assert bpy.ops.shock_filter.generate(occlude=False, **words) == {"FINISHED"}
    assert shaded.min() < 0.7
    assert read(f"{sheet.name} Occlusion.001").min() > 0.99


@pytest.mark.parametrize(
    ("part", "reason"),
    [("position", "Vertex 3 has no valid position"), ("UVMap", "Texture coordinates are NaN")],
)
def test_an_object_with_nan_is_named_and_others_go_on(sheet, part, reason, capfd):
    bad = add_sheet()
    values = bad.data.attributes[part].data
    values[3].vector = [float("nan"), *values[3].vector[1:]]
    bpy.ops.object.select_all(action="SELECT")
    bpy.context.view_layer.objects.active = sheet
    words = {"target": "occlusion", "image_size": str(SIZE), "occlusion_rays": 4}
    assert generate(**words) == {"FINISHED"}
    assert f"Skipped {bad.name}: {reason}" in capfd.readouterr().out
    bad.select_set(False)
    assert generate(occlude=True, **words) == {"FINISHED"}  # it casts no shadow


def test_marked_edges_are_worn_by_choice(sheet):
    """A ridge is worn, unless edges elsewhere are marked alone."""
    for vertex in sheet.data.vertices:
        vertex.co.z = -abs(vertex.co.x)
    words = {"target": "wear", "image_size": "256", "wear_breakup": 0, "wear_rays": 8}
    with pytest.raises(RuntimeError, match="turn Marked Edges off"):
        bpy.ops.shock_filter.generate(marked=True, **words)
    assert bpy.ops.shock_filter.generate(marked=True, wear_kind="dirt", **words) == {"FINISHED"}
    mark_sharp(sheet)
    assert bpy.ops.shock_filter.generate(marked=True, **words) == {"FINISHED"}
    assert bpy.ops.shock_filter.generate(**words) == {"FINISHED"}
    marked, found = (read(f"{sheet.name} Wear.{number}") for number in ("001", "002"))
    ridge = SIZE // 2
    assert found[:, ridge].mean() > 0.3
    assert marked[:, ridge].max() < 0.05


@pytest.mark.parametrize(("along", "axis"), [("X", 1), ("Y", 0), ("AROUND_X", 0), ("AROUND_Y", 1)])
def test_streaks_run_along(sheet, along, axis):
    words = {"along": along, "image_size": str(SIZE)}
    assert generate(target="streaks", **words) == {"FINISHED"}
    values = read("Grid Streaks")
    along_it, across = (np.abs(np.diff(values, axis=each)).mean() for each in (axis, 1 - axis))
    assert along_it < 0.3 * across
    assert values.std() > 0.05
    assert not bpy.data.images["Grid Streaks"].is_float


def test_a_pattern_grows_and_its_scale_is_painted(sheet):
    pixels = np.ones((128, 128, 4), dtype=np.float32)
    pixels[:, :64, :3] = 0.5
    bpy.data.images.new("Scale", 128, 128, is_data=True).pixels.foreach_set(pixels.reshape(-1))
    bpy.data.images.new("Skin", 128, 128, is_data=True)
    words = {"pattern_steps": 600, "pattern_scale": 16.0, "image": "Skin"}
    assert generate(target="pattern", scale_map="Scale", **words) == {"FINISHED"}
    values = read("Skin")
    assert values.min() < 0.1
    assert values.max() > 0.9
    fine, coarse = (np.abs(np.diff(half, axis=0)).mean() for half in np.split(values, 2, axis=1))
    assert fine > 1.15 * coarse


def add_numbers(sheet):
    numbers = sheet.data.attributes.new("Way", "FLOAT", "POINT")
    numbers.data.foreach_set("value", [vertex.co.y for vertex in sheet.data.vertices])


def add_colors(sheet):
    colors = sheet.data.color_attributes.new("Way", "FLOAT_COLOR", "CORNER")
    for loop, color in zip(sheet.data.loops, colors.data, strict=True):
        color.color = (*3 * [sheet.data.vertices[loop.vertex_index].co.y], 1.0)


def add_vectors(sheet):
    vectors = sheet.data.attributes.new("Way", "FLOAT_VECTOR", "FACE")
    vectors.data.foreach_set("vector", [1.0, 0.0, 0.0] * len(sheet.data.polygons))
    sheet.rotation_euler.z = np.pi / 2  # vectors turn with the object


@pytest.mark.parametrize("add", [add_numbers, add_colors, add_vectors])
def test_streaks_follow_an_attribute(sheet, add):
    add(sheet)
    bpy.context.view_layer.update()
    words = {"along": "ATTRIBUTE", "along_attribute": "Way", "image_size": str(SIZE)}
    assert generate(target="streaks", **words) == {"FINISHED"}
    values = read("Grid Streaks")
    rough = [np.abs(np.diff(values, axis=axis)).mean() for axis in (0, 1)]
    calm = 1 if add is add_vectors else 0  # in the object's own frame, which the UVs follow
    assert rough[calm] < 0.5 * rough[1 - calm]


def test_an_object_without_a_material_shows_the_image(sheet):
    generate(source="border", image_size=str(SIZE))
    (material,) = sheet.data.materials
    nodes = material.node_tree.nodes
    (link,) = nodes["Principled BSDF"].inputs["Base Color"].links
    assert link.from_node.image == bpy.data.images["Grid Distance"]
    said = "Grid had no material, and got one that shows Grid Distance."
    assert said in operators.summaries["generate"]
    generate(source="border", image_size=str(SIZE))
    assert "had no material" not in operators.summaries["generate"]


def test_a_node_names_the_uv_map_that_renders_do_not_take(sheet):
    layers = sheet.data.uv_layers
    other = layers.new(name="Other")
    for active, name in ((layers[0], ""), (other, "Other")):
        layers.active = active
        sheet.data.materials.clear()
        assert generate(target="curvature", image_size=str(SIZE)) == {"FINISHED"}
        (node,) = [n for n in sheet.active_material.node_tree.nodes if n.type == "TEX_IMAGE"]
        links = node.inputs["Vector"].links
        assert [link.from_node.uv_map for link in links] == ([name] if name else [])


def test_a_material_gets_a_node_that_waits(sheet):
    material = bpy.data.materials.new("Wood")
    material.use_nodes = True
    sheet.data.materials.append(material)
    links = len(material.node_tree.links)
    for _ in range(2):
        generate(source="border", image_size=str(SIZE), add_node=True)
        assert material.node_tree.nodes.active.image is not None
    assert len(material.node_tree.links) == links
    generate(source="border", image_size=str(SIZE), add_node=False)
    assert sum(node.type == "TEX_IMAGE" for node in material.node_tree.nodes) == 2


@pytest.fixture
def textured(sheet):
    """The sheet with a material whose base color is a texture, the active node."""
    material = bpy.data.materials.new("Wood")
    material.use_nodes = True
    sheet.data.materials.append(material)
    nodes = material.node_tree.nodes
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = bpy.data.images.new("Texture", 8, 8)
    shader = nodes["Principled BSDF"]
    material.node_tree.links.new(texture.outputs["Color"], shader.inputs["Base Color"])
    nodes.active = texture
    return sheet


def node_of(obj, name):
    nodes = obj.active_material.node_tree.nodes
    return next(node for node in nodes if node.type == "TEX_IMAGE" and node.image.name == name)


def source(socket):
    (found,) = socket.links
    return found.from_node


def test_the_texture_stays_the_active_node_and_the_result_waits(textured):
    assert not linking.is_waiting(bpy.context)
    generate(source="border", image_size=str(SIZE))
    nodes = textured.active_material.node_tree.nodes
    assert nodes.active == node_of(textured, "Texture")
    assert chosen.shown_image(bpy.context).name == "Texture"
    said = operators.summaries["generate"]
    assert "Grid Distance is in the material, not linked yet: press Link." in said
    assert linking.is_waiting(bpy.context)


@pytest.mark.parametrize(("into", "socket"), [("COLOR", "Base Color"), ("ROUGHNESS", "Roughness")])
def test_link_puts_it_into_the_shader(textured, over_view, into, socket):
    generate(source="border", image_size=str(SIZE))
    bpy.ops.ed.undo_push(message="Start")
    assert link_map("EXEC_DEFAULT", True, into=into) == {"FINISHED"}
    shader = textured.active_material.node_tree.nodes["Principled BSDF"]
    assert source(shader.inputs[socket]).image.name == "Grid Distance"
    if into == "ROUGHNESS":
        assert source(shader.inputs["Base Color"]).image.name == "Texture"
    assert not linking.is_waiting(bpy.context)
    generate(source="border", image="Grid Distance")
    assert "not linked yet" not in operators.summaries["generate"]


def test_the_button_link_says_why_it_is_gray(textured):
    """In the panel; scripts may link an image by its name at any time."""

    def in_panel():
        with bpy.context.temp_override(**{linking.BUTTON: bpy.context.scene}):
            return link_map.poll()

    assert link_map.poll() and not in_panel()
    with (
        bpy.context.temp_override(**{linking.BUTTON: bpy.context.scene}),
        pytest.raises(RuntimeError, match="press Generate first"),
    ):
        link_map()
    generate(source="border", image_size=str(SIZE))
    assert in_panel()
    link_map(into="COLOR")
    assert link_map.poll() and not in_panel()


@pytest.mark.parametrize("is_linked", [True, False])
def test_link_mixes_by_it(textured, is_linked):
    shader = textured.active_material.node_tree.nodes["Principled BSDF"]
    color = shader.inputs["Base Color"]
    if not is_linked:
        textured.active_material.node_tree.links.remove(color.links[0])
        color.default_value = (0.25, 0.5, 0.75, 1.0)
    generate(source="border", image_size=str(SIZE))
    assert link_map(into="FACTOR") == {"FINISHED"}
    mix = source(color)
    ends = {socket.identifier: socket for socket in mix.inputs}
    assert source(ends["Factor_Float"]).image.name == "Grid Distance"
    if is_linked:
        assert source(ends["A_Color"]).image.name == "Texture"
    else:
        assert tuple(ends["A_Color"].default_value) == (0.25, 0.5, 0.75, 1.0)
    assert tuple(ends["B_Color"].default_value) == (1.0, 1.0, 1.0, 1.0)


def test_what_cannot_be_linked_is_said(textured):
    with pytest.raises(RuntimeError, match="There is no unlinked generated image"):
        link_map()
    with pytest.raises(RuntimeError, match="no image named 'Nothing'"):
        link_map(image="Nothing")
    bpy.data.images.new("Other", 8, 8)
    with pytest.raises(RuntimeError, match="No material of the selected objects holds Other"):
        link_map(image="Other")
    generate(source="border", image_size=str(SIZE))
    tree = textured.active_material.node_tree
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    with pytest.raises(RuntimeError, match="Wood has no Principled BSDF"):
        link_map()


def test_an_image_is_replaced_at_its_own_size(sheet):
    image = bpy.data.images.new("Mask", 64, 48)
    assert generate(source="border", image="Mask", add_node=False) == {"FINISHED"}
    assert tuple(image.size) == (64, 48)
    values = image_data.read_pixels(image)[..., 0]
    assert values[0, 0] > 0.75
    assert values[24, 32] < 0.05
    assert [each.name for each in bpy.data.images] == ["Mask"]


def test_redo_starts_anew(sheet, adjust):
    bpy.ops.ed.undo_push(message="Start")
    generate("EXEC_DEFAULT", True, source="border", image_size=str(SIZE))
    before = read("Grid Distance")
    adjust(look="lines")
    assert [image.name for image in bpy.data.images] == ["Grid Distance"]
    assert (read("Grid Distance") != before).any()


def test_repeated_on_another_object_it_makes_another_image(sheet, repeat):
    generate("EXEC_DEFAULT", True, source="border", image_size=str(SIZE))
    before = read("Grid Distance")
    sheet.select_set(False)
    other = add_sheet(width=0.5)
    other.name = "Other"
    repeat()
    assert (read("Grid Distance") == before).all()
    assert (read("Other Distance") != before).any()


def test_undo_takes_the_image_away(sheet):
    bpy.ops.ed.undo_push(message="Start")
    generate("EXEC_DEFAULT", True, source="border", image_size=str(SIZE))
    bpy.ops.ed.undo()
    assert "Grid Distance" not in bpy.data.images
    assert not bpy.data.objects["Grid"].data.materials


BAD = [
    ({"start": "SELECTED"}, "nothing is selected"),
    ({"start": "GROUP", "start_group": "None"}, "no vertex group named 'None'"),
    ({"start": "SEAMS"}, "no edge is marked as a seam"),
    ({"start": "SHARP"}, "no edge is marked as sharp"),
    ({"start": "IMAGE", "start_image": "None"}, "no image named 'None'"),
    ({"start": "IMAGE", "start_image": "Small"}, "another size; scale it to 256 x 256"),
    ({"image": "None"}, "no image named 'None'"),
    ({"target": "streaks", "along": "ATTRIBUTE", "along_attribute": "None"}, "named 'None'"),
]


@pytest.mark.parametrize(("words", "reason"), BAD)
def test_what_is_missing_is_named(sheet, words, reason):
    bpy.data.images.new("Small", 8, 8)
    with pytest.raises(RuntimeError, match=reason):
        generate(**({"image_size": str(SIZE)} | words))
    assert [image.name for image in bpy.data.images] == ["Small"]
    assert not sheet.data.materials


def test_all_selected_is_no_start():
    bpy.ops.mesh.primitive_grid_add(calc_uvs=True)
    bpy.context.object.data.vertices.foreach_set("select", [True] * 121)
    with pytest.raises(RuntimeError, match="all is selected"):
        generate(start="SELECTED")


@pytest.mark.parametrize("selected", [False, True])
def test_the_first_press_counts_from_the_lowest_vertices(sheet, selected):
    sheet.data.vertices.foreach_set("select", [selected] * len(sheet.data.vertices))
    sheet.rotation_euler.y = -0.5 * np.pi  # the left side is the lowest one
    bpy.context.view_layer.update()
    assert generate(look="distance", image_size=str(SIZE)) == {"FINISHED"}
    assert np.abs(read("Grid Distance") - from_left()).max() < 0.02
    assert "counts from the lowest vertices" in operators.summaries["generate"]
    generate(look="distance", image_size=str(SIZE), start="LOWEST")
    assert "counts from the lowest" not in operators.summaries["generate"]


@pytest.mark.parametrize("selected", [False, True])
def test_without_a_selection_it_counts_from_marked_edges(sheet, selected):
    sheet.data.vertices.foreach_set("select", [selected] * len(sheet.data.vertices))
    x = np.empty(3 * len(sheet.data.vertices), np.float32)
    sheet.data.vertices.foreach_get("co", x)
    at_left = x[::3] <= x[::3].min() + 1e-4
    for edge in sheet.data.edges:
        edge.use_edge_sharp = bool(at_left[list(edge.vertices)].all())
    assert generate(look="distance", image_size=str(SIZE)) == {"FINISHED"}
    assert np.abs(read("Grid Distance") - from_left()).max() < 0.02
    assert "edges that are marked as sharp" in operators.summaries["generate"]


def test_what_is_selected_in_edit_mode_counts_and_the_mode_stays(sheet):
    select(sheet)
    bpy.ops.object.mode_set(mode="EDIT")
    assert generate(look="distance", image_size=str(SIZE)) == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert np.abs(read("Grid Distance") - from_left()).max() < 0.02


def test_a_mesh_without_uv_map_is_refused(sheet):
    sheet.data.uv_layers.remove(sheet.data.uv_layers[0])
    with pytest.raises(RuntimeError, match="Unwrap the mesh"):
        generate(source="border")


def test_parts_that_no_way_leads_to_are_black(sheet):
    island = add_sheet(0.5, 0.5)
    island.location.x = 9.0
    for loop in sheet.data.uv_layers.active.uv:
        loop.vector = 0.5 * loop.vector[0], loop.vector[1]
    select(sheet)
    for obj in (sheet, island):
        obj.select_set(True)
    assert generate(image_size=str(SIZE)) == {"FINISHED"}
    (image,) = bpy.data.images
    values = image_data.read_pixels(image)[..., 0]
    assert values[:, : SIZE // 2 - 2].max() > 0.9
    assert values[:, SIZE // 2 + 2 :].max() == 0.0


def test_esc_leaves_everything(sheet, monkeypatch):
    monkeypatch.setattr(operators, "listener", lambda fraction, message: False)
    assert generate(source="border") == {"CANCELLED"}
    assert len(bpy.data.images) == 0


def test_each_target_has_a_preset():
    mode = find("generate")
    chosen = {preset.values.get("target", mode.targets[0].key) for preset in mode.presets}
    assert chosen == {target.key for target in mode.targets}


def test_an_attribute_of_another_kind_is_kept(sheet):
    sheet.data.attributes.new("Distance", "FLOAT_COLOR", "CORNER")
    with pytest.raises(RuntimeError, match="another attribute named Distance"):
        generate(source="border", into="ATTRIBUTE")
    assert sheet.data.attributes["Distance"].data_type == "FLOAT_COLOR"


def test_what_was_painted_since_is_kept(sheet):
    words = {"source": "border", "image_size": str(SIZE)}
    generate(**words)
    image = bpy.data.images["Grid Distance"]
    image.pixels[0] = 7.0
    generate(**words, result="Grid Distance")
    assert image.pixels[0] == 7.0
    assert len(bpy.data.images) == 2


def test_a_mask_from_sharp_edges_is_narrow_and_says_its_width(sheet):
    mark_sharp(sheet)
    assert generate(image_size=str(SIZE)) == {"FINISHED"}
    from shock_filter.shock_addon.operators.keeping import found

    width = found["generate"]["width"].value
    assert 0 < width < 0.2 * LENGTH
    expected = np.clip(1.0 - from_left() / width, 0.0, 1.0)
    np.testing.assert_allclose(read("Grid Distance"), expected, atol=0.1)
    said = f"The gradient ends at a distance of {found['generate']['width'].text}."
    assert said in operators.summaries["generate"]


@pytest.mark.parametrize("start", ["SHARP", None])
def test_edges_without_faces_do_not_count(sheet, start):
    sheet.rotation_euler.y = -0.5 * np.pi  # the left side is the lowest one
    bpy.context.view_layer.update()
    mesh = sheet.data
    count, edges = len(mesh.vertices), len(mesh.edges)
    mesh.vertices.add(2)
    for vertex, y in zip(mesh.vertices[count:], (-0.5, 0.5), strict=True):
        vertex.co = (-1.0, y, 0.0)
    mesh.edges.add(1)
    mesh.edges[edges].vertices = (count, count + 1)
    mesh.edges[edges].select = mesh.vertices[count].select = mesh.vertices[count + 1].select = False
    if start:
        for edge in in_column(sheet, -1.0):
            edge.use_edge_sharp = True
    words = {"start": start} if start else {}
    assert generate(look="distance", image_size=str(SIZE), **words) == {"FINISHED"}
    assert np.abs(read("Grid Distance") - from_left()).max() < 0.02
