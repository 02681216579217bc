# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and menu entries, drawn on a layout that checks each call against Blender's own."""

import time
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core import GeometrySettings, ImageSettings, ShockSettings, TextureSettings
from shock_filter.core.settings import describe
from shock_filter.shock_addon.data.mesh import shape_keys
from shock_filter.shock_addon.flow import showing as flow_shown
from shock_filter.shock_addon.live import updating
from shock_filter.shock_addon.modes import DEFAULTS, JOBS, choices, find, modes_of
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import choosing, generating, keeping, linking, statistics
from shock_filter.shock_addon.running import jobs, kernels
from shock_filter.shock_addon.ui import menus, panels

ABOUT = describe(GeometrySettings)
MODES = {
    "geometry": GeometrySettings,
    "colors": ShockSettings,
    "image": ImageSettings,
    "texture": TextureSettings,
}
CHOICES = {"mode", "image_mode", "selected_only"}
WIDEST = 14
"""Letters that Blender's sidebar shows of a name at its default width."""
FUNCTIONS = bpy.types.UILayout.bl_rna.functions
ICONS = FUNCTIONS["label"].parameters["icon"].enum_items.keys()


class Layout:
    """Records what is drawn; refuses what Blender's layout would refuse."""

    unfolds = False

    def __init__(self, above=None):
        for name, value in (("drawn", []), ("enabled", []), ("usable", True), ("gray", [])):
            super().__setattr__(name, getattr(above, name) if above else value)

    def _below(self):
        return Layout(self)

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name
        if name == "enabled":
            self.enabled.append(value)
            super().__setattr__("usable", self.usable and value)

    def __getattr__(self, function):
        known = FUNCTIONS[function].parameters.keys()

        def call(*arguments, **options):
            assert set(options) <= set(known), (function, options)
            assert options.get("icon", "NONE") in ICONS
            if function in {"prop", "prop_search"}:
                is_input = arguments[1].startswith('["')  # of a modifier
                assert is_input or arguments[1] in arguments[0].bl_rna.properties
                self.drawn.append((function, arguments[1]))
                return self._below()
            text = options.get("text", arguments[1] if len(arguments) > 1 else arguments[:1])
            text = options.get("panel", text)
            self.drawn.append((function, text))
            if not self.usable:
                self.gray.append(text)
            if function == "panel":
                assert options["default_closed"]
                body = self._below() if self.unfolds else None
                return self._below(), body
            if function == "operator":
                operator = SimpleNamespace()
                self.drawn.append(("set", operator))
                return operator
            return self._below()

        return call


def context_in(space="VIEW_3D", image=None, width=280):
    return SimpleNamespace(
        space_data=SimpleNamespace(type=space, image=image),
        scene=bpy.context.scene,
        view_layer=bpy.context.view_layer,
        object=bpy.context.object,
        mode=bpy.context.mode,
        selected_objects=bpy.context.selected_objects,
        objects_in_mode=bpy.context.objects_in_mode,
        tool_settings=bpy.context.tool_settings,
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
        region=SimpleNamespace(width=width),
    )


def draw(panel, image=None, layout=None, width=280):
    layout = Layout() if layout is None else layout
    context = context_in(panel.bl_space_type, image, width)
    registered = bpy.types.Panel.bl_rna_get_subclass_py(panel.__name__)
    chosen = {name: getattr(panel, name) for name in ("choice", "job", "own", "mode", "settings")}
    self = SimpleNamespace(layout=layout, **chosen)
    assert registered.poll(context) if "poll" in dir(panel) else True
    registered.draw(self, context)
    return layout.drawn


def words(drawn, function):
    return [text for name, text in drawn if name == function]


def settings_of(drawn):
    """List the properties that are drawn; a number behind its switch counts once."""
    names = words(drawn, "prop") + words(drawn, "prop_search")
    names += ["output"] * ("output" in words(drawn, "prop_enum"))
    behind = [name.removesuffix("_auto") for name in names if name.endswith("_auto")]
    return [name for name in names if not name.endswith("_auto") and name not in behind] + behind


def report_of(drawn):
    """List the lines that are below the settings."""
    lines = words(drawn, "label")
    fixed = [n for n, line in enumerate(lines) if str(line).startswith("Will ")]
    return lines[fixed[0] + 1 :]


OF_CREASES = [
    ("shock_filter.mark_creases",),
    ("shock_filter.crisp_low_poly",),
    ("shock_filter.show_creases",),
]


def test_the_main_panel_shows_the_mode_then_the_main_settings():
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    main = [name for name, (_, _, about) in ABOUT.items() if not about.advanced]
    assert words(drawn, "prop_enum") == ["Geometry", "Denoise", "Colors", "Texture"]
    assert sorted(settings_of(drawn)) == sorted(main)
    assert words(drawn, "operator") == [
        ("shock_filter.sharpen_geometry",),
        ("shock_filter.preview",),
        ("shock_filter.before_after",),
        *OF_CREASES,
    ]
    functions = [name for name, _ in drawn]
    assert functions.index("operator") < functions.index("prop")  # buttons keep their places


def test_the_closed_panels_show_the_rest(rounded_box):
    shown = []
    for panel in (
        bpy.types.SHOCK_FILTER_PT_mask,
        bpy.types.SHOCK_FILTER_PT_output,
        bpy.types.SHOCK_FILTER_PT_advanced,
    ):
        assert panel.bl_options == {"DEFAULT_CLOSED"}
        drawn = draw(panel)
        shown += settings_of(drawn)
    assert ("shock_filter.show_flow",) in words(drawn, "operator")
    advanced = [name for name, (_, _, about) in ABOUT.items() if about.advanced]
    where = ["vertex_group", "invert_mask", "output", "weld"]
    where += ["custom_normals", "mark_sharp", "sharp_angle"]
    assert sorted(shown) == sorted([*where, *advanced, "steady_state"])
    rounded_box()
    assert "vertex_group" in words(draw(bpy.types.SHOCK_FILTER_PT_mask), "prop_search")
    bpy.ops.object.mode_set(mode="EDIT")
    assert "selected_only" in words(draw(bpy.types.SHOCK_FILTER_PT_mask), "prop")
    bpy.ops.object.mode_set(mode="SCULPT")
    assert any("sculpt mask" in str(text) for text in words(
        draw(bpy.types.SHOCK_FILTER_PT_mask), "label"))  # fmt: skip


def test_the_button_carries_the_panels_settings():
    settings = bpy.context.scene.shock_filter.geometry
    settings.repeat = 7
    settings.output = "SHAPE_KEY"
    for menu, drawn in enumerate((draw(panels.SHOCK_FILTER_PT_main), filters_menu("SCULPT"))):
        carried = words(drawn, "set")[-1 if menu else 0]
        assert carried.repeat == 7
        assert carried.output == "SHAPE_KEY"
        assert carried.time == pytest.approx(ABOUT["time"][1])


class Unfolded(Layout):
    """With all sections open."""

    unfolds = True


def after_run(name, layout, **parameters):
    """Draw what Adjust Last Operation shows."""
    properties = bpy.context.window_manager.operator_properties_last(f"shock_filter.{name}")
    for key, value in parameters.items():
        setattr(properties, key, value)
    operator = bpy.types.Operator.bl_rna_get_subclass_py(f"SHOCK_FILTER_OT_{name}")
    context = context_in()
    self = SimpleNamespace(layout=layout, properties=properties, row=operator.row)
    operator.draw(self, context)
    return [about.identifier for about in properties.bl_rna.properties if not about.is_hidden]


def test_the_main_settings_come_first_after_a_run_and_the_others_are_folded():
    layout = Layout()
    after_run("sharpen_geometry", layout)
    main = [name for name, (_, _, about) in ABOUT.items() if not about.advanced]
    assert sorted(settings_of(layout.drawn)) == sorted(main)
    assert words(layout.drawn, "label") == ["Mask", "Output", "Advanced"]


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("sharpen_geometry", {}),
        ("sharpen_colors", {}),
        ("sharpen_texture", {}),
        ("dilate_texture", {}),
        ("filter_texture", {}),
        ("stitch_textures", {"image_2": "Coat", "image_3": "Coat"}),
        ("sharpen_image", {}),
        ("denoise_image", {}),
        ("denoise_texture", {}),
        ("denoise", {"target": "geometry"}),
        ("denoise", {"target": "colors"}),
        ("denoise", {"target": "both"}),
    ],
)
def test_all_parameters_can_be_changed_after_a_run(rounded_box, name, parameters):
    rounded_box()
    layout = Unfolded()
    known = after_run(name, layout, **parameters)
    shown = settings_of(layout.drawn)
    assert len(set(shown)) == len(shown)
    if "target" in parameters:
        known = find(name).names_for(SimpleNamespace(**parameters))
    assert set(known) - set(shown) <= {"selected_only", "rna_type", "target"}
    assert set(shown) <= set(known)


def test_a_selection_can_be_changed_after_a_run_in_edit_mode(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    layout = Unfolded()
    after_run("sharpen_colors", layout)
    assert "selected_only" in words(layout.drawn, "prop")


def filters_menu(mode="EDIT_MESH", space="VIEW_3D"):
    """Draw the menu of filters."""
    layout = Layout()
    context = SimpleNamespace(
        mode=mode, scene=bpy.context.scene, space_data=SimpleNamespace(type=space, image=None)
    )
    menus.SHOCK_FILTER_MT_filters.draw(SimpleNamespace(layout=layout), context)
    return layout.drawn


def entry(menu):
    """Draw what stands in one of Blender's menus."""
    layout = Layout()
    menus.ENTRIES[menu](SimpleNamespace(layout=layout), bpy.context)
    return words(layout.drawn, "menu")


@pytest.mark.parametrize("mode", MODES)
def test_each_mode_draws_its_settings_and_its_button(mode, rounded_box):
    rounded_box()
    main, others = panels_of(mode)
    drawn = draw(main)
    operators = [(f"shock_filter.sharpen_{mode}",)]
    operators += [("shock_filter.preview",), ("shock_filter.before_after",)]
    operators += OF_CREASES * (mode == "geometry")
    assert words(drawn, "operator") == operators
    for panel in others:
        drawn += draw(panel)
    shown = set(settings_of(drawn)) - CHOICES
    assert shown == kept(getattr(bpy.context.scene.shock_filter, mode))


def kept(settings):
    """Name the settings that a panel is to show."""
    names = {each.identifier for each in settings.bl_rna.properties if not each.is_hidden}
    return names - {"rna_type", "name", "selected_only"}


@pytest.mark.parametrize("mode", ["denoise", "denoise_image"])
def test_denoising_has_its_settings_and_its_button(mode, rounded_box):
    rounded_box()
    main, others = panels_of(mode)
    settings = getattr(bpy.context.scene.shock_filter, mode)
    settings.then_sharpen = True
    settings.iterations = 5
    below = {"alpha"} if mode == "denoise_image" else {"vertex_group", "weld"}
    drawn = draw(main)
    assert words(drawn, "operator")[0].endswith(", then Sharpen")
    carried, *_ = words(drawn, "set")
    assert (carried.then_sharpen, carried.iterations) == (True, 5)
    own = {"method", "strength", "bump_size", "keep_creases"}
    if mode == "denoise_image":
        own = {"time", "beta", "iterations"}
    assert set(settings_of(drawn)) == own | {"then_sharpen", "sharpen_time"}
    for panel in others:
        drawn += draw(panel)
    shown = set(settings_of(drawn)) - CHOICES
    assert below <= shown
    every = kept(settings) - {"attribute", "target"}
    every -= {name for name in every if name.startswith("color_")}
    assert shown == every


@pytest.mark.parametrize("mode", ["denoise", "denoise_image", *MODES])
def test_the_panel_names_the_preset_and_opens_the_list(mode):
    main, _ = panels_of(mode)
    settings = getattr(bpy.context.scene.shock_filter, mode)
    for preset in (DEFAULTS, *find(mode).presets):
        bpy.ops.shock_filter.use_preset(mode=mode, name=preset.name)
        assert words(draw(main), "popover") == [preset.name]
    name = next(n for n in find(mode).filter_names if n in ("amount", "iterations"))
    setattr(settings, name, 0.37 if name == "amount" else 17)
    assert words(draw(main), "popover") == ["Custom"]


def is_seen(panel, context):
    return not hasattr(panel, "poll") or panel.poll(context)


def panels_of(mode):
    """Choose the mode; return its main panel, and those below it that are seen then."""
    scene = bpy.context.scene
    in_image_editor = mode in ("image", "denoise_image")
    if in_image_editor:
        scene.shock_filter.image_mode = mode.upper()
    else:
        scene.shock_filter.mode = mode.upper()
    name = "SHOCK_FILTER_PT_image_main" if in_image_editor else "SHOCK_FILTER_PT_main"
    below = [panel for panel in panels.CLASSES if getattr(panel, "bl_parent_id", "") == name]
    context = context_in("IMAGE_EDITOR" if in_image_editor else "VIEW_3D")
    return getattr(panels, name), [panel for panel in below if is_seen(panel, context)]


def test_colors_have_some_of_the_outputs_of_shapes(rounded_box):
    rounded_box()
    layout = Unfolded()
    after_run("denoise", layout, target="colors")
    assert words(layout.drawn, "prop_enum") == ["output"] * 3  # of five


def test_vertex_paint_mode_mentions_its_mask(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    drawn = draw(bpy.types.SHOCK_FILTER_PT_mask)
    assert any("paint mask" in str(text) for text in words(drawn, "label"))


def test_the_image_editor_says_why_an_image_cannot_be_sharpened():
    tiled = bpy.data.images.new("Tiles", 4, 4, tiled=True)
    lines = words(draw(panels.SHOCK_FILTER_PT_image_main, image=tiled), "label")
    assert "Tiles: it has UDIM tiles" in " ".join(lines)
    plain = bpy.data.images.new("Plain", 4, 4)
    drawn = draw(panels.SHOCK_FILTER_PT_image_main, image=plain)
    assert "Will sharpen: Plain" in words(drawn, "label")
    assert not any("Plain" in str(text) for text in report_of(drawn))


@pytest.mark.parametrize(
    ("mode", "space", "modes"),
    [
        ("OBJECT", "VIEW_3D", ["geometry", "colors", "texture"]),
        ("EDIT_MESH", "VIEW_3D", ["geometry"]),
        ("SCULPT", "VIEW_3D", ["geometry"]),
        ("PAINT_VERTEX", "VIEW_3D", ["colors"]),
        ("OBJECT", "IMAGE_EDITOR", ["image", "texture"]),
        ("EDIT_MESH", "IMAGE_EDITOR", ["image", "texture"]),
    ],
)
def test_the_menu_has_the_modes_filters(mode, space, modes):
    drawn = words(filters_menu(mode, space), "operator")
    wanted = ["Denoise Image" if "image" in modes else "Denoise"]
    wanted += ["Denoise Texture"] * ("texture" in modes)
    wanted += [(f"shock_filter.sharpen_{mode}",) for mode in modes]
    of_textures = [
        ("shock_filter.filter_texture",),
        ("shock_filter.stitch_textures",),
        ("shock_filter.fill_texture",),
        ("shock_filter.repair_texture",),
        ("shock_filter.enlarge_texture",),
        ("shock_filter.dilate_texture",),
    ]
    wanted += of_textures[:-1] * ("texture" in modes)
    if "image" in modes:
        wanted += [("shock_filter.make_tileable",), ("shock_filter.remove_blocks",)]
    wanted += [("shock_filter.generate",)] * (
        space == "VIEW_3D" and mode in {"OBJECT", "EDIT_MESH"}
    )
    if mode == "OBJECT" or space == "IMAGE_EDITOR":
        wanted.append(("shock_filter.visualize_flow",))
    assert drawn == wanted + of_textures[-1:] * ("texture" in modes)


def test_the_menu_stands_in_blenders_own():
    for menu in ("object", "edit_mesh", "sculpt", "paint_vertex"):
        assert entry(f"VIEW3D_MT_{menu}") == [("SHOCK_FILTER_MT_filters",)]
    assert entry("IMAGE_MT_image") == [("SHOCK_FILTER_MT_filters",)]


def test_the_panel_says_what_is_wrong(monkeypatch, rounded_box):
    rounded_box()
    monkeypatch.setattr(kernels, "problem", lambda: "numba cannot be found: mend it thus.")
    monkeypatch.setattr(operators, "summaries", {})
    text = " ".join(report_of(draw(panels.SHOCK_FILTER_PT_main)))
    assert text == "numba cannot be found: mend it thus."


def test_the_panel_says_what_was_done(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    text = " ".join(report_of(draw(panels.SHOCK_FILTER_PT_main)))
    assert text == operators.summaries["geometry"]


def test_the_panel_says_nothing_of_other_objects(rounded_box, select):
    first = rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    second = rounded_box()
    assert report_of(draw(panels.SHOCK_FILTER_PT_main)) == []
    select(first, second)
    assert report_of(draw(panels.SHOCK_FILTER_PT_main)) != []


def test_the_image_editor_says_nothing_of_other_images(rounded_box):
    rounded_box()
    bpy.context.scene.shock_filter.image_mode = "IMAGE"
    for name in ("Photo", "Other"):
        bpy.data.images.new(name, 8, 8)
    bpy.ops.shock_filter.sharpen_image(image="Photo")
    main = panels.SHOCK_FILTER_PT_image_main
    text = " ".join(report_of(draw(main, bpy.data.images["Photo"])))
    assert text == operators.summaries["image"]
    assert report_of(draw(main, bpy.data.images["Other"])) == []


def test_the_panel_shows_the_progress(monkeypatch):
    job = SimpleNamespace(fraction=0.5, message="Tracing flow-lines", quiet_until=0.0)
    monkeypatch.setattr(jobs, "current", lambda: job)
    layout = Layout()
    drawn = draw(panels.SHOCK_FILTER_PT_main, layout=layout)
    assert words(drawn, "progress") == ["Tracing flow-lines"]
    _, *others = words(drawn, "operator")  # the first one cancels
    assert set(others) <= set(layout.gray)
    assert not {name for (name,) in others} & {"shock_filter.sharpen_geometry"}
    job.quiet_until = time.monotonic() + 60.0
    layout = Layout()
    drawn = draw(panels.SHOCK_FILTER_PT_main, layout=layout)
    assert not words(drawn, "progress") and ("shock_filter.sharpen_geometry",) in layout.gray


def test_the_flow_button_hides_what_is_shown(monkeypatch, rounded_box):
    box = rounded_box()
    monkeypatch.setattr(
        flow_shown, "shown_object", lambda kind="flow": box.name if kind == "flow" else None
    )
    assert words(draw(panels.SHOCK_FILTER_PT_main), "operator")[-1] == ("shock_filter.hide_flow",)
    rounded_box(location=(4, 0, 0))
    assert words(draw(panels.SHOCK_FILTER_PT_main), "operator")[-1] == ("shock_filter.hide_flow",)


def test_the_button_of_creases_hides_what_is_shown(monkeypatch, rounded_box):
    box = rounded_box()
    of_creases = lambda kind="flow": box.name if kind == "creases" else None  # noqa: E731
    monkeypatch.setattr(flow_shown, "shown_object", of_creases)
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "operator")
    assert shown[-1] == ("shock_filter.hide_creases",)
    assert ("shock_filter.show_creases",) not in shown
    rounded_box(location=(4, 0, 0))
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "operator")
    assert shown[-2:] == [("shock_filter.show_creases",), ("shock_filter.hide_creases",)]


@pytest.mark.parametrize("mode", ["GEOMETRY", "COLORS", "TEXTURE", "DENOISE"])
def test_the_flow_can_be_hidden_in_each_mode_whatever_is_selected(monkeypatch, rounded_box, mode):
    box = rounded_box()
    box.select_set(False)
    box.data.clear_geometry()
    monkeypatch.setattr(
        flow_shown, "shown_object", lambda kind="flow": box.name if kind == "flow" else None
    )
    bpy.context.scene.shock_filter.mode = mode
    layout = Layout()
    shown = words(draw(panels.SHOCK_FILTER_PT_main, layout=layout), "operator")
    assert ("shock_filter.hide_flow",) in shown
    assert ("shock_filter.hide_flow",) not in layout.gray
    assert ("shock_filter.preview",) in layout.gray
    assert bpy.ops.shock_filter.hide_flow.poll()


def test_preview_is_offered_in_other_modes(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="SCULPT")
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "operator")
    assert ("shock_filter.preview",) in shown
    advanced = draw(bpy.types.SHOCK_FILTER_PT_advanced)
    assert ("shock_filter.show_flow",) in words(advanced, "operator")


def test_no_name_is_wider_than_the_sidebar():
    for mode in choices():
        group = getattr(bpy.context.scene.shock_filter, mode.key)
        for name in mode.names:
            assert len(group.bl_rna.properties[name].name) <= WIDEST, name


def reason(panel=panels.SHOCK_FILTER_PT_main, image=None):
    """Draw the panel; return what it says, and whether its buttons can be pressed."""
    layout = Layout()
    drawn = draw(panel, image, layout)
    main = words(drawn, "operator")[0]
    return " ".join(map(str, report_of(drawn))), main not in layout.gray


def test_the_panel_says_why_nothing_can_be_run(rounded_box, monkeypatch):
    monkeypatch.setattr(operators, "summaries", {})
    scene = bpy.context.scene.shock_filter
    assert reason() == ("Select a mesh object.", False)
    bpy.ops.curve.primitive_bezier_circle_add()
    said, can_run = reason()
    assert ("Object > Convert > Mesh" in said, can_run) == (True, False)
    box = rounded_box()
    assert reason() == ("", True)
    scene.mode = "COLORS"
    assert reason() == ("The mesh has no colors; paint some in Vertex Paint Mode.", False)
    scene.mode = "DENOISE"
    assert reason() == ("", True)
    scene.denoise.target = "both"
    assert reason()[1] is False
    box.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    assert reason() == ("", True)
    scene.mode = "GEOMETRY"
    box.data.clear_geometry()
    assert reason() == ("The mesh has no faces; add some, or select another object.", False)


def test_the_panel_says_that_the_mesh_is_linked(rounded_box, tmp_path, monkeypatch):
    monkeypatch.setattr(operators, "summaries", {})
    box = rounded_box()
    path = str(tmp_path / "library.blend")
    bpy.data.libraries.write(path, {box.data})
    with bpy.data.libraries.load(path, link=True) as (found, wanted):
        wanted.meshes = found.meshes
    box.data = wanted.meshes[0]
    for mode in ("GEOMETRY", "DENOISE"):
        bpy.context.scene.shock_filter.mode = mode
        said, can_run = reason()
        assert said.startswith("Cube: its mesh is linked from another file; make it local first")
        assert not can_run
    rounded_box(location=(4, 0, 0)).select_set(True)
    box.select_set(True)
    assert reason() == ("", True)


def test_the_image_editor_asks_for_a_mesh_with_the_texture():
    image = bpy.data.images.new("Plain", 4, 4)
    bpy.context.scene.shock_filter.image_mode = "TEXTURE"
    said, can_run = reason(panels.SHOCK_FILTER_PT_image_main, image)
    assert (said, can_run) == ("Select a mesh object that shows this image.", False)


def test_the_panel_says_what_failed_and_what_was_left_out(rounded_box, select):
    good, bad = rounded_box(), rounded_box(location=(4, 0, 0))
    bad.name = "Bad"
    bad.data.vertices[0].co.x = float("nan")
    good.modifiers.new("Bent", "SIMPLE_DEFORM")
    select(good, bad)
    bpy.ops.shock_filter.sharpen_geometry(output="MESH")
    text = operators.summaries["geometry"]
    assert text.startswith("Sharpened 1 mesh: ")
    assert "Modifiers were left in place" in text
    assert "Skipped Bad: " in text
    assert text.split() == " ".join(report_of(draw(panels.SHOCK_FILTER_PT_main))).split()
    assert text.splitlines()[-1].startswith("Skipped Bad: ")  # a line of its own
    select(bad)
    with pytest.raises(RuntimeError, match="Skipped Bad"):
        bpy.ops.shock_filter.sharpen_geometry()
    assert operators.summaries["geometry"].startswith("Skipped Bad: Vertex 0 has no valid position")


def test_a_new_object_is_said_before_the_press(rounded_box):
    box = rounded_box()
    box.modifiers.new("Voxels", "REMESH")
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    said = " ".join(words(drawn, "label"))
    assert "New Object: Voxels is the last modifier, so the visible shape is filtered" in said
    bpy.context.scene.shock_filter.geometry.output = "LIVE"
    said = " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    assert "Live copy: Voxels is the last modifier" in said
    bpy.context.scene.shock_filter.geometry.output = "MESH"
    assert "New Object" not in " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))


def test_the_state_of_weighted_shape_keys_is_not_read_while_drawing(rounded_box, monkeypatch):
    box = rounded_box()
    box.vertex_groups.new(name="Some").add([0, 1], 0.5, "REPLACE")
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    box.shape_key_add(name="Basis")
    box.shape_key_add(name="Key").vertex_group = "Some"

    def refuse(*_):
        raise AssertionError("this makes data")

    monkeypatch.setattr(shape_keys, "group_weights", refuse)
    box.data.shape_keys.key_blocks["Key"].value = 0.5
    assert ("shock_filter.update_live",) in words(draw(panels.SHOCK_FILTER_PT_main), "operator")


def test_painting_where_says_what_to_paint_with(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    hint = "paint with 0 where the mesh"
    assert hint not in " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    bpy.ops.shock_filter.paint_live()
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    assert hint in " ".join(words(drawn, "label"))
    assert ("operator", "Done Painting") in drawn
    assert ("shock_filter.paint_live",) not in words(drawn, "operator")
    bpy.context.object.vertex_groups.new(name="Other")
    bpy.context.object.vertex_groups.active_index = 1
    assert hint not in " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    bpy.ops.object.mode_set(mode="OBJECT")


def test_a_live_texture_has_its_amount_and_says_what_to_paint_with(wood):
    kept, amounts = bpy.context.scene.shock_filter, ("prop", "default_value")
    for mode in ("TEXTURE", "GEOMETRY"):
        kept.mode = mode
        assert amounts not in draw(panels.SHOCK_FILTER_PT_main)
        bpy.ops.shock_filter.sharpen_texture(output="LIVE", image=wood.name)
        drawn = draw(panels.SHOCK_FILTER_PT_main)
        assert (amounts in drawn) == (mode == "TEXTURE")
        buttons = [each[0] for each in words(drawn, "operator") if isinstance(each, tuple)]
        own = {"shock_filter.update_live", "shock_filter.paint_live_texture"}
        assert own & set(buttons) == (own if mode == "TEXTURE" else set())
    kept.mode = "TEXTURE"
    hint = "White shows the result"
    assert hint not in " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    bpy.ops.shock_filter.paint_live_texture()
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    assert hint in " ".join(words(drawn, "label"))
    assert "Will sharpen: Wood" in words(drawn, "label")  # not the mask
    done = words(drawn, "set")[words(drawn, "operator").index("Done Painting")]
    assert done.mode == "OBJECT"
    bpy.ops.object.mode_set(mode="OBJECT")


def test_selected_to_active_says_why_it_is_gray(rounded_box, select):
    bake = bpy.ops.shock_filter.bake_maps
    one, other = rounded_box(), rounded_box(location=(4, 0, 0))
    for objects in ([one], [one, other]):
        select(*objects)
        with bpy.context.temp_override(**{generating.FROM_SELECTED: bpy.context.scene}):
            assert bake.poll() == (len(objects) == 2)
            if len(objects) == 1:
                with pytest.raises(RuntimeError, match="and last the one to bake onto"):
                    bake(from_selected=True)
        assert bake.poll()  # scripts and Bake 3 Maps


def test_link_is_offered_while_a_generated_image_waits(rounded_box, monkeypatch):
    rounded_box()
    assert "into" not in words(draw(panels.SHOCK_FILTER_PT_main), "operator_menu_enum")
    for waiting in (True, False):
        monkeypatch.setattr(linking, "is_waiting", lambda context, found=waiting: found)
        drawn = draw(panels.SHOCK_FILTER_PT_generate)
        assert words(drawn, "operator_menu_enum") == ["into"] * waiting
        is_plain = ("shock_filter.link_map",) in words(drawn, "operator")  # its tooltip says why
        assert is_plain == (not waiting)


def test_maps_have_a_panel_of_their_own_with_their_reports(rounded_box, monkeypatch):
    """What is folded of a report is behind a header; a run's bar stands in place of the buttons."""
    cls = panels.SHOCK_FILTER_PT_maps
    assert not getattr(cls, "bl_parent_id", "") and "DEFAULT_CLOSED" in cls.bl_options
    rounded_box()
    bpy.context.object.data.uv_layers.new()
    monkeypatch.setattr(operators, "summary_of", lambda _, key, image="": f"Report of {key}.")
    monkeypatch.setattr(operators, "details_of", lambda _, key, image="": f"Folded of {key}.")
    drawn = draw(cls)
    assert words(drawn, "operator") == ["Bake 3 Maps", "Selected to Active"]
    said = words(drawn, "label")
    assert "Report of maps." in said and "Details" in said and "Folded of maps." not in said
    unfolded = Layout()
    monkeypatch.setattr(Layout, "unfolds", True)
    assert "Folded of maps." in words(draw(cls, layout=unfolded), "label")
    monkeypatch.setattr(
        jobs,
        "current",
        lambda: SimpleNamespace(fraction=0.5, message="Baking maps", quiet_until=0.0),
    )
    assert "Bake 3 Maps" not in words(draw(cls), "operator")


def test_the_report_of_generate_is_below_its_button_not_below_its_settings(
    rounded_box, monkeypatch
):
    rounded_box()
    bpy.context.object.data.uv_layers.new()
    monkeypatch.setattr(operators, "summary_of", lambda _, key, image="": f"Report of {key}.")
    drawn = draw(panels.SHOCK_FILTER_PT_generate)
    report = drawn.index(("label", "Report of generate."))
    button = drawn.index(("operator", ("shock_filter.generate",)))
    settings = min(n for n, (name, _) in enumerate(drawn) if name == "prop")
    assert button < report < settings


def test_the_image_editor_says_why_nothing_can_be_run(monkeypatch):
    monkeypatch.setattr(operators, "summaries", {})
    main = panels.SHOCK_FILTER_PT_image_main
    assert reason(main) == ("Open an image in the Image Editor.", False)
    image = bpy.data.images.new("Plain", 4, 4)
    assert reason(main, image) == ("", True)
    image.source = "FILE"
    image.filepath = "//missing.png"
    assert reason(main, image) == (
        "Plain: it has no pixels; check that its file exists.",
        False,
    )


def test_statistics_count_and_say_how_fast_the_last_run_was(rounded_box):
    statistics.forget()
    rounded_box()
    drawn = words(draw(bpy.types.SHOCK_FILTER_PT_statistics), "label")
    assert drawn == ["Meshes", "1", "Vertices", "866", "Faces", "864"]
    bpy.ops.shock_filter.sharpen_geometry()
    drawn = words(draw(bpy.types.SHOCK_FILTER_PT_statistics), "label")[6:]
    assert drawn[::2] == ["Last Run", "Speed"]
    assert drawn[1].endswith((" s", " min"))
    assert drawn[3].endswith(" a second")


def test_statistics_say_whether_modifiers_count(rounded_box):
    box = rounded_box(cuts=1)
    box.modifiers.new("Fine", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    drawn = words(draw(bpy.types.SHOCK_FILTER_PT_statistics), "label")
    assert drawn[3] == "98" and "Counted with modifiers" in " ".join(drawn[6:])


def test_texture_paint_mode_has_the_menu_in_its_header(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    assert entry("VIEW3D_MT_editor_menus") == [("SHOCK_FILTER_MT_filters",)]
    assert words(filters_menu("PAINT_TEXTURE"), "operator") == [
        "Denoise Texture",
        ("shock_filter.sharpen_texture",),
        ("shock_filter.filter_texture",),
        ("shock_filter.stitch_textures",),
        ("shock_filter.fill_texture",),
        ("shock_filter.repair_texture",),
        ("shock_filter.enlarge_texture",),
        ("shock_filter.dilate_texture",),
    ]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert entry("VIEW3D_MT_editor_menus") == []


def test_long_sentences_are_wrapped(monkeypatch, rounded_box):
    rounded_box()
    sentence = "One sentence that is much longer than a narrow sidebar can show on a line."
    monkeypatch.setattr(kernels, "problem", lambda: sentence)
    monkeypatch.setattr(operators, "summaries", {})
    lines = report_of(draw(panels.SHOCK_FILTER_PT_main))
    assert len(lines) > 1
    assert " ".join(lines) == sentence


def texture_panels(editor):
    """Choose textures; return the main panel and those below it that are seen then."""
    scene = bpy.context.scene
    scene.shock_filter.mode = "TEXTURE"
    scene.shock_filter.image_mode = "TEXTURE"
    main = panels.SHOCK_FILTER_PT_image_main if editor else panels.SHOCK_FILTER_PT_main
    below = [p for p in panels.CLASSES if getattr(p, "bl_parent_id", "") == main.__name__]
    return main, [panel for panel in below if is_seen(panel, context_in())]


@pytest.mark.parametrize("editor", [False, True])
def test_both_editors_have_all_settings_of_textures(editor, rounded_box):
    rounded_box()
    main, below = texture_panels(editor)
    drawn = [entry for panel in (main, *below) for entry in draw(panel)]
    shown = set(settings_of(drawn)) - CHOICES
    wanted = kept(bpy.context.scene.shock_filter.texture)
    assert shown == wanted - ({"image"} if editor else set())


def test_the_image_editors_buttons_name_the_image_that_is_seen():
    image = bpy.data.images.new("Seen", 4, 4)
    bpy.context.scene.shock_filter.texture.image = "Other"
    bpy.context.scene.shock_filter.texture.gutter = 3
    for mode in ("TEXTURE", "DILATE"):
        main, _ = texture_panels(editor=True)
        bpy.context.scene.shock_filter.image_mode = mode
        carried, *_ = words(draw(main, image=image), "set")
        assert (carried.image, carried.gutter) == ("Seen", 3)
        main, _ = texture_panels(editor=False)
        bpy.context.scene.shock_filter.mode = mode
        carried, *_ = words(draw(main), "set")
        assert carried.image == "Other"


def test_the_image_editor_takes_tiles_on_the_surface_only():
    tiled = bpy.data.images.new("Tiles", 4, 4, tiled=True)
    main, _ = texture_panels(editor=True)
    assert not any("UDIM" in str(text) for text in words(draw(main, image=tiled), "label"))


def test_the_texture_panel_says_which_image_or_why_none(rounded_box):
    box = rounded_box()
    main, _ = texture_panels(editor=False)
    text = " ".join(map(str, words(draw(main), "label")))
    assert "Add an Image Texture node with an image to the material." in text
    bpy.data.images.new("Of nobody", 4, 4)
    text = " ".join(map(str, words(draw(main), "label")))
    assert "it has no material; add one with an Image Texture node" in text
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    node = material.node_tree.nodes.new("ShaderNodeTexImage")
    node.image = bpy.data.images.new("Wood", 4, 4)
    box.data.materials.append(material)
    assert "Will sharpen: Wood" in words(draw(main), "label")
    bpy.context.scene.shock_filter.texture.image = "Wood"
    assert "Will sharpen: Wood" in words(draw(main), "label")
    bpy.data.images.remove(bpy.data.images["Wood"])
    text = " ".join(map(str, words(draw(main), "label")))
    assert "there is no image named 'Wood'; choose one of the file's images." in text


def heights(width=280):
    """Return how many rows of choices, and lines, are above the main button and Preview."""
    drawn = draw(panels.SHOCK_FILTER_PT_main, width=width)
    last = [text for _, text in drawn].index(("shock_filter.before_after",))
    rows = [name for name, _ in drawn[:last]]
    return rows.count("row") + rows.count("label"), rows.count("operator")


@pytest.mark.parametrize("width", [180, 280, 500])
def test_no_button_moves_as_a_mode_a_selection_or_a_report_changes(rounded_box, width):
    scene = bpy.context.scene.shock_filter
    seen = set()
    for selects in (False, True):
        if selects:
            rounded_box()
        for mode in ("GEOMETRY", "DENOISE", "DENOISE_TEXTURE", "COLORS", "TEXTURE", "DETAIL",
                     "STITCH", "DILATE"):  # fmt: skip
            scene.mode = mode
            seen.add(heights(width))
    scene.mode = "GEOMETRY"
    bpy.ops.shock_filter.sharpen_geometry(where="everywhere")
    seen.add(heights(width))
    assert len(seen) == 1


def test_a_texture_is_announced_even_if_there_is_none():
    bpy.context.scene.shock_filter.mode = "TEXTURE"
    assert "Will sharpen: \u2013" in words(draw(panels.SHOCK_FILTER_PT_main), "label")


def chosen_first(panel=panels.SHOCK_FILTER_PT_main, space="VIEW_3D"):
    return panel.mode(context_in(space)).key


def test_the_panel_opens_on_what_fits_the_selection(rounded_box):
    box = rounded_box()
    assert chosen_first() == "geometry"
    assert chosen_first(panels.SHOCK_FILTER_PT_image_main, "IMAGE_EDITOR") == "image"
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    assert chosen_first() == "colors"
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    assert chosen_first() == "texture"  # Blender's cube has UVs
    bpy.ops.object.mode_set(mode="OBJECT")
    box.data.uv_layers.remove(box.data.uv_layers[0])
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    assert chosen_first() == "geometry"


def test_a_mesh_without_uvs_shows_no_texture_unless_that_is_chosen_for_it(rounded_box):
    rounded_box()
    scene = bpy.context.scene.shock_filter
    for mode in ("TEXTURE", "DETAIL", "DENOISE_TEXTURE"):
        scene.mode = mode
        assert chosen_first() == mode.lower()
        other = rounded_box(location=(4, 0, 0))
        other.data.uv_layers.remove(other.data.uv_layers[0])
        assert chosen_first() == "geometry"
        scene.mode = mode
        assert chosen_first() == mode.lower()
        assert "Unwrap the mesh" in reason()[0]
        rounded_box()


def test_a_click_in_the_first_row_leads_to_its_first_mode(rounded_box):
    rounded_box()
    scene = bpy.context.scene.shock_filter
    for choice, name in (("mode", "job"), ("image_mode", "image_job")):
        for job in JOBS[choice]:
            setattr(scene, name, job.key)
            modes = modes_of(choice, job)
            assert getattr(scene, choice) == modes[0].key.upper()
            for mode in modes:
                setattr(scene, choice, mode.key.upper())
                assert getattr(scene, name) == job.key


def test_denoising_is_one_choice_of_mesh_colors_and_texture(rounded_box):
    rounded_box()
    scene = bpy.context.scene.shock_filter
    scene.job = "DENOISE"
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "prop_enum")
    assert shown[-4:] == ["Mesh", "Colors", "Both", "Texture"]
    for each, mode, target in (("colors", "DENOISE", "colors"), ("texture", "DENOISE_TEXTURE", ""),
                               ("geometry", "DENOISE", "geometry")):  # fmt: skip
        scene.noisy = each
        assert (scene.noisy, scene.mode) == (each, mode)
        assert not target or scene.denoise.target == target


def test_modes_of_scripts_and_old_files_that_have_a_panel_of_their_own(rounded_box):
    rounded_box()
    scene = bpy.context.scene.shock_filter
    for mode in ("GENERATE", "VISUALIZE"):
        scene.mode = mode
        assert scene.mode == mode
        assert chosen_first() == "geometry"
        assert scene.job == "GEOMETRY"


@pytest.mark.parametrize(
    ("name", "operator", "first"),
    [
        ("generate", "generate", {"look", "width", "start_from", "image_size"}),
        ("flow", "visualize_flow", {"step", "streak_frames", "frames", "image_size"}),
    ],
)
def test_generate_and_flow_have_closed_panels_with_few_settings(rounded_box, name, operator, first):
    rounded_box()
    panel = getattr(panels, f"SHOCK_FILTER_PT_{name}")
    assert panel.bl_options == {"DEFAULT_CLOSED"}
    drawn = draw(panel)
    assert words(drawn, "operator")[0] == (f"shock_filter.{operator}",)
    assert set(settings_of(drawn)) == first
    unfolded = Unfolded()
    draw(panel, layout=unfolded)
    settings = getattr(bpy.context.scene.shock_filter, panel.own)
    rest = set(settings_of(unfolded.drawn)) - first
    assert {"gutter", "smoothing"} <= rest or {"contrast", "loop", "in_colors"} <= rest
    assert settings.bl_rna.properties["start_from" if name == "generate" else "step"].name in (
        "From", "Speed")  # fmt: skip


def test_all_settings_of_flows_stand_in_their_panel(rounded_box):
    rounded_box()
    settings = bpy.context.scene.shock_filter.visualize
    settings.target = "attribute"
    layout = Unfolded()
    draw(panels.SHOCK_FILTER_PT_flow, layout=layout)
    shown = {"blending" if n == "streak_frames" else n for n in settings_of(layout.drawn)}
    assert kept(settings) - shown <= {"target", "image", "y_axis"}


def test_add_node_is_shown_only_where_there_are_objects(rounded_box):
    rounded_box()
    bpy.context.scene.shock_filter.visualize.target = "attribute"
    image = bpy.data.images.new("Flow", 8, 8)
    for name, is_shown in (("flow", True), ("image_flow", False)):
        layout = Unfolded()
        draw(getattr(panels, f"SHOCK_FILTER_PT_{name}"), image, layout)
        assert "folder" in settings_of(layout.drawn)
        assert ("add_node" in settings_of(layout.drawn)) == is_shown


def test_length_is_blending_in_frames():
    settings = bpy.context.scene.shock_filter.visualize
    assert settings.streak_frames == pytest.approx(10.0)
    settings.streak_frames = 20.0
    assert settings.blending == pytest.approx(0.05)


def test_from_is_source_and_start():
    settings = bpy.context.scene.shock_filter.generate
    assert settings.start_from == "AUTO"
    for start in ("SELECTED", "LOWEST", "GROUP", "SEAMS", "SHARP", "IMAGE"):
        settings.start_from = start
        assert (settings.source, settings.start, settings.start_from) == ("given", start, start)
    for each, source in (("BORDER", "border"), ("CHARTS", "seams")):
        settings.start_from = each
        assert (settings.source, settings.start_from) == (source, each)
    names = [item.name for item in settings.bl_rna.properties["start_from"].enum_items]
    assert {"Lowest Point", "Marked Edges", "Selection"} <= set(names)


AUTOMATIC = [
    ("geometry", "widest_fillet", 0.0),
    ("colors", "width", 0.0),
    ("image", "width", 0.0),
    ("texture", "width", 0.0),
    ("texture", "time", -1.0),
    ("denoise", "bump_size", 0.0),
    ("denoise_image", "beta", -1.0),
    ("denoise_texture", "beta", -1.0),
    ("generate", "width", 0.0),
]


@pytest.mark.parametrize(("mode", "name", "auto"), AUTOMATIC)
def test_a_switch_says_auto_where_the_value_means_that(mode, name, auto):
    settings = getattr(bpy.context.scene.shock_filter, mode)
    switch = f"{name}_auto"
    assert getattr(settings, name) == auto
    assert getattr(settings, switch)
    is_none = name == "bump_size"  # which leaves nothing to the filter
    assert settings.bl_rna.properties[switch].name == ("None" if is_none else "Auto")
    setattr(settings, switch, False)
    assert getattr(settings, name) > 0
    setattr(settings, name, 3.0)
    assert not getattr(settings, switch)
    setattr(settings, switch, True)
    assert getattr(settings, name) == auto


def test_a_field_is_shown_only_where_it_is_not_auto(rounded_box):
    rounded_box()
    settings = bpy.context.scene.shock_filter.geometry
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "prop")
    assert "widest_fillet_auto" in shown
    assert "widest_fillet" not in shown
    settings.widest_fillet = 2.0
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "prop")
    assert {"widest_fillet_auto", "widest_fillet"} <= set(shown)


def test_every_value_that_means_auto_has_a_switch():
    for mode in choices():
        for target in mode.targets:
            for name, about in target.fields.items():
                measures = any(word in about.description for word in (" measures ", " by itself"))
                if about.minimum < 0 or (measures and not about.choices):
                    assert about.auto is not None, name


def test_low_poly_is_not_cut_off():
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    at = [n for n, (_, text) in enumerate(drawn) if text in OF_CREASES]
    between = [name for name, _ in drawn[at[1] : at[2]]]
    assert "row" in between  # not all in one


def test_reports_of_several_objects_have_a_line_for_each(rounded_box, select):
    box = rounded_box()
    bpy.ops.mesh.primitive_uv_sphere_add(location=(4, 0, 0))
    ball = bpy.context.object
    select(box, ball)
    bpy.ops.shock_filter.sharpen_geometry()
    said = operators.summaries["geometry"].splitlines()
    of_ball = [line for line in said if line.startswith(f"{ball.name}: ")]
    of_box = [line for line in said if line.startswith(f"{box.name}: ")]
    assert (len(of_box), len(of_ball)) == (1, 1)
    assert "Where to Everywhere" in of_ball[0]
    assert "Where to Everywhere" not in of_box[0]
    assert "edge length" in said[0]
    assert " cm (" in said[0] or " m (" in said[0]
    drawn = report_of(draw(panels.SHOCK_FILTER_PT_main, width=2000))
    assert drawn == said  # each on a line of its own


def test_reports_of_many_objects_are_short(rounded_box, select):
    boxes = [rounded_box(location=(6.0 * n, 0.0, 0.0)) for n in range(8)]
    for number, box in enumerate(boxes):
        box.scale = (1.0 + 0.1 * number,) * 3  # each has a width of its own to tell
    select(*boxes)
    bpy.ops.shock_filter.sharpen_geometry()
    said = operators.summaries["geometry"].splitlines()
    assert len([line for line in said if "radius" in line]) == 3
    assert said[4] == "5 further remarks on other objects."


def test_what_auto_chose_is_shown_and_can_be_kept():
    image = bpy.data.images.new("Noisy", 48, 48)
    noise = np.random.default_rng(0).normal(0.5, 0.05, 4 * 48 * 48).astype(np.float32)
    image.pixels.foreach_set(noise)
    scene = bpy.context.scene.shock_filter
    scene.image_mode = "DENOISE_IMAGE"
    main = panels.SHOCK_FILTER_PT_image_main
    assert ("shock_filter.keep_auto",) not in words(draw(main, image), "operator")
    bpy.ops.shock_filter.denoise_image(image="Noisy", alpha="none")
    shown = bpy.data.images["Noisy denoised"]
    drawn = draw(main, shown, width=600)
    assert ("shock_filter.keep_auto",) in words(drawn, "operator")
    assert "" in words(draw(main, shown, width=200), "operator")  # a pin leaves room for the value
    (kept,) = [
        each for each in words(drawn, "set") if hasattr(each, "name") and each.name == "beta"
    ]
    assert (kept.mode, kept.name) == ("denoise_image", "beta")
    chosen = keeping.found_by(context_in("IMAGE_EDITOR", shown), kept.mode, kept.name)
    assert f"Keep Edges {chosen.text}." in operators.summaries["denoise_image"]
    assert keeping.found_by(context_in("IMAGE_EDITOR", image), "image", "width") is None


def test_a_texture_gives_way_while_vertices_are_painted_unless_it_is_chosen_then(rounded_box):
    rounded_box()
    bpy.context.object.data.uv_layers.new()
    bpy.context.object.data.color_attributes.new("Color", "BYTE_COLOR", "CORNER")
    settings = bpy.context.scene.shock_filter

    def shown():
        return choosing.mode(context_in(), "mode").key

    settings.mode = "DENOISE_TEXTURE"
    assert shown() == "denoise_texture"
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    assert shown() == "colors"
    settings.mode = "DENOISE_TEXTURE"
    assert shown() == "denoise_texture"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert shown() == "denoise_texture"
    settings.mode = "GEOMETRY"
    assert shown() == "geometry"
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    assert shown() == "geometry"


def test_keep_puts_lengths_into_the_field_as_the_report_gives_them(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    chosen = keeping.found_by(bpy.context, "geometry", "widest_fillet")
    assert chosen.text.endswith("m")  # in the scene's units
    assert bpy.ops.shock_filter.keep_auto(mode="geometry", name="widest_fillet") == {"FINISHED"}
    settings = bpy.context.scene.shock_filter.geometry
    assert settings.widest_fillet == pytest.approx(chosen.value) != 0.0
    assert f"a radius of up to {chosen.said};" in operators.summaries["geometry"]
    assert chosen.said.startswith(f"{chosen.text} ({settings.widest_fillet:.4g} edge length")
    rounded_box(location=(4, 0, 0))
    with pytest.raises(RuntimeError, match="run the filter first"):
        bpy.ops.shock_filter.keep_auto(mode="geometry", name="widest_fillet")


def test_keep_takes_what_the_field_shows_after_a_live_copy_was_updated():
    """Of a copy whose source has wider fillets by then; a given width is not what Auto chose."""
    bpy.ops.mesh.primitive_cube_add()
    source = bpy.context.object
    bevel = source.modifiers.new("Bevel", "BEVEL")
    bevel.width, bevel.segments = 0.04, 4
    source.modifiers.new("Remesh", "REMESH").mode = "SMOOTH"
    source.modifiers["Remesh"].octree_depth = 4
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    first = keeping.found_by(bpy.context, "geometry", "widest_fillet")
    bevel.width = 0.16
    bpy.context.view_layer.update()
    assert updating.update(bpy.context.object) == {"FINISHED"}
    second = keeping.found_by(bpy.context, "geometry", "widest_fillet")
    assert second.value > first.value
    assert f"a radius of up to {second.said};" in operators.summaries["geometry"]
    bpy.ops.shock_filter.keep_auto(mode="geometry", name="widest_fillet")
    settings = bpy.context.scene.shock_filter.geometry
    assert f"({settings.widest_fillet:.4g} edge length" in second.said
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE", widest_fillet=settings.widest_fillet)
    assert keeping.found_by(bpy.context, "geometry", "widest_fillet") is None


def test_what_auto_chose_stays_while_creases_and_flows_are_shown(rounded_box, select):
    box = rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    chosen = keeping.found_by(bpy.context, "geometry", "widest_fillet")
    select(rounded_box(location=(4, 0, 0)))
    assert bpy.ops.shock_filter.show_creases() == {"FINISHED"}
    assert keeping.found_by(bpy.context, "geometry", "widest_fillet") is None  # of another object
    select(box)
    for show in ("show_creases", "mark_creases", "show_flow"):
        assert getattr(bpy.ops.shock_filter, show)() == {"FINISHED"}
        assert keeping.found_by(bpy.context, "geometry", "widest_fillet") is chosen is not None


def test_every_mode_has_a_button_or_a_panel_of_its_own():
    own = {panel.own for panel in panels.CLASSES if getattr(panel, "own", "")}
    for choice in JOBS:
        led = {mode.key for job in JOBS[choice] for mode in modes_of(choice, job)}
        known = bpy.context.scene.shock_filter.bl_rna.properties[choice].enum_items.keys()
        assert {key.lower() for key in known} == led | own & {key.lower() for key in known}
        assert not led & own
