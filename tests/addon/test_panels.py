# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and menu entries, drawn on a layout that checks each call against Blender's own."""

from functools import partial
from types import SimpleNamespace

import bpy
import pytest
from shock_filter.core import GeometrySettings, ImageSettings, ShockSettings, TextureSettings
from shock_filter.core.settings import describe
from shock_filter.shock_addon import jobs, kernels, operators, properties, statistics
from shock_filter.shock_addon.flow import flow_overlay
from shock_filter.shock_addon.panel import menus, panels

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

    def __init__(self, drawn=None, enabled=None):
        super().__setattr__("drawn", [] if drawn is None else drawn)
        super().__setattr__("enabled", [] if enabled is None else enabled)

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name
        if name == "enabled":
            self.enabled.append(value)

    def __getattr__(self, function):
        known = FUNCTIONS[function].parameters.keys()

        def call(*arguments, **options):
            assert set(options) <= set(known), (function, options)
            assert options.get("icon", "NONE") in ICONS
            if function in {"prop", "prop_search"}:
                assert arguments[1] in arguments[0].bl_rna.properties
                self.drawn.append((function, arguments[1]))
                return Layout(self.drawn, self.enabled)
            text = options.get("text", arguments[1] if len(arguments) > 1 else arguments[:1])
            text = options.get("panel", text)
            self.drawn.append((function, text))
            if function == "operator":
                operator = SimpleNamespace()
                self.drawn.append(("set", operator))
                return operator
            return Layout(self.drawn, self.enabled)

        return call


def draw(panel, image=None, layout=None):
    layout = Layout() if layout is None else layout
    context = SimpleNamespace(
        space_data=SimpleNamespace(type=panel.bl_space_type, image=image),
        scene=bpy.context.scene,
        object=bpy.context.object,
        mode=bpy.context.mode,
        selected_objects=bpy.context.selected_objects,
        objects_in_mode=bpy.context.objects_in_mode,
        tool_settings=bpy.context.tool_settings,
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
        region=SimpleNamespace(width=280),
    )
    registered = bpy.types.Panel.bl_rna_get_subclass_py(panel.__name__)
    self = SimpleNamespace(layout=layout, mode=panel.mode, settings=panel.settings)
    for name in ("draw_settings", "draw_choice"):
        if hasattr(panel, name):
            setattr(self, name, partial(getattr(panel, name), self))
    assert registered.poll(context) if "poll" in dir(panel) else True
    registered.draw(self, context)
    return layout.drawn


def words(drawn, function):
    return [text for name, text in drawn if name == function]


def test_the_main_panel_shows_the_mode_then_the_main_settings():
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    main = [name for name, (_, _, about) in ABOUT.items() if not about.advanced]
    assert words(drawn, "prop") == ["mode", main[0], "steady_state", *main[1:]]
    assert words(drawn, "operator") == [
        ("shock_filter.sharpen_geometry",),
        ("shock_filter.preview",),
        "Show Flow",
    ]


def test_the_closed_panels_show_the_rest(rounded_box):
    shown = []
    for panel in (
        panels.SHOCK_FILTER_PT_mask,
        panels.SHOCK_FILTER_PT_output,
        panels.SHOCK_FILTER_PT_advanced,
    ):
        assert panel.bl_options == {"DEFAULT_CLOSED"}
        drawn = draw(panel)
        shown += words(drawn, "prop") + words(drawn, "prop_search")
    advanced = [name for name, (_, _, about) in ABOUT.items() if about.advanced]
    where = ["vertex_group", "invert_mask", "output", "weld"]
    where += ["custom_normals", "mark_sharp", "sharp_angle"]
    assert sorted(shown) == sorted([*where, *advanced])
    rounded_box()
    assert "vertex_group" in words(draw(panels.SHOCK_FILTER_PT_mask), "prop_search")
    bpy.ops.object.mode_set(mode="EDIT")
    assert "selected_only" in words(draw(panels.SHOCK_FILTER_PT_mask), "prop")
    bpy.ops.object.mode_set(mode="SCULPT")
    assert any("sculpt mask" in str(text) for text in words(
        draw(panels.SHOCK_FILTER_PT_mask), "label"))  # fmt: skip


def test_the_button_carries_the_panels_settings():
    settings = bpy.context.scene.shock_filter.geometry
    settings.repeat = 7
    settings.output = "SHAPE_KEY"
    for menu, drawn in enumerate((draw(panels.SHOCK_FILTER_PT_main), entry())):
        carried = words(drawn, "set")[-1 if menu else 0]
        assert carried.repeat == 7
        assert carried.output == "SHAPE_KEY"
        assert carried.time == pytest.approx(ABOUT["time"][1])


def entry(menu="VIEW3D_MT_edit_mesh"):
    layout = Layout()
    menus.ENTRIES[menu](SimpleNamespace(layout=layout), bpy.context)
    return layout.drawn


@pytest.mark.parametrize("mode", MODES)
def test_each_mode_draws_its_settings_and_its_button(mode, rounded_box):
    rounded_box()
    main, others = panels_of(mode)
    drawn = draw(main)
    operators = [(f"shock_filter.sharpen_{mode}",)]
    operators += [("shock_filter.dilate_texture",)] * (mode == "texture")
    if mode in ("geometry", "colors"):
        operators += [("shock_filter.preview",), "Show Flow"]
    assert words(drawn, "operator") == operators
    for panel in others:
        drawn += draw(panel)
    shown = set(words(drawn, "prop") + words(drawn, "prop_search")) - CHOICES
    settings = getattr(bpy.context.scene.shock_filter, mode)
    assert shown == set(settings.bl_rna.properties.keys()) - {"rna_type", "name", "selected_only"}


@pytest.mark.parametrize("mode", ["denoise", "denoise_image"])
def test_denoising_has_its_settings_and_its_button(mode, rounded_box):
    rounded_box()
    main, others = panels_of(mode)
    settings = getattr(bpy.context.scene.shock_filter, mode)
    settings.then_sharpen = True
    settings.iterations = 5
    below = {"window", "alpha", "measure"} if mode == "denoise_image" else {"vertex_group", "weld"}
    drawn = draw(main)
    assert words(drawn, "operator")[0].endswith(", then Sharpen")
    carried, *_ = words(drawn, "set")
    assert (carried.then_sharpen, carried.iterations) == (True, 5)
    first = words(drawn, "prop")
    assert first[-5:] == ["time", "beta", "iterations", "then_sharpen", "sharpen_time"]
    for panel in others:
        drawn += draw(panel)
    shown = set(words(drawn, "prop") + words(drawn, "prop_search")) - CHOICES
    assert below <= shown
    every = set(settings.bl_rna.properties.keys()) - {"rna_type", "name", "selected_only"}
    every -= {name for name in every if name.startswith("color_")} | {"attribute"}
    assert shown == every


@pytest.mark.parametrize("mode", ["denoise", "denoise_image", *MODES])
def test_the_header_offers_presets_of_the_mode(mode):
    main, _ = panels_of(mode)
    layout = Layout()
    context = SimpleNamespace(scene=bpy.context.scene)
    self = SimpleNamespace(layout=layout, mode=main.mode)
    main.draw_header_preset(self, context)
    assert words(layout.drawn, "popover") == [f"SHOCK_FILTER_PT_{mode}_presets"]


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
    context = SimpleNamespace(scene=scene)
    return getattr(panels, name), [panel for panel in below if panel.poll(context)]


def test_the_output_is_not_asked_for_with_colors():
    _, others = panels_of("colors")
    assert panels.SHOCK_FILTER_PT_output not in others
    assert panels.SHOCK_FILTER_PT_mask in others


def test_vertex_paint_mode_mentions_its_mask(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    drawn = draw(panels.SHOCK_FILTER_PT_mask)
    assert any("paint mask" in str(text) for text in words(drawn, "label"))


def test_the_image_editor_says_why_an_image_cannot_be_sharpened():
    tiled = bpy.data.images.new("Tiles", 4, 4, tiled=True)
    lines = words(draw(panels.SHOCK_FILTER_PT_image_main, image=tiled), "label")
    assert "Tiles: it has UDIM tiles" in " ".join(lines)
    plain = bpy.data.images.new("Plain", 4, 4)
    drawn = draw(panels.SHOCK_FILTER_PT_image_main, image=plain)
    assert not any("Plain" in str(text) for text in words(drawn, "label"))


@pytest.mark.parametrize(
    ("menu", "modes"),
    [
        ("VIEW3D_MT_object", ["geometry", "colors", "texture"]),
        ("VIEW3D_MT_edit_mesh", ["geometry"]),
        ("VIEW3D_MT_sculpt", ["geometry"]),
        ("VIEW3D_MT_paint_vertex", ["colors"]),
        ("IMAGE_MT_image", ["image", "texture"]),
    ],
)
def test_each_menu_has_its_entries(menu, modes):
    drawn = words(entry(menu), "operator")
    wanted = ["Denoise Image" if "image" in modes else "Denoise"]
    wanted += [(f"shock_filter.sharpen_{mode}",) for mode in modes]
    assert drawn == wanted + [("shock_filter.dilate_texture",)] * ("texture" in modes)


def test_the_panel_says_what_is_wrong(monkeypatch, rounded_box):
    rounded_box()
    monkeypatch.setattr(kernels, "problem", lambda: "numba cannot be found: mend it thus.")
    monkeypatch.setattr(operators, "summaries", {})
    text = " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    assert text == "numba cannot be found: mend it thus."


def test_the_panel_says_what_was_done(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    text = " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    assert text == operators.summaries["geometry"]


def test_the_panel_shows_the_progress(monkeypatch):
    job = SimpleNamespace(fraction=0.5, message="Tracing flow-lines")
    monkeypatch.setattr(jobs, "current", lambda: job)
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    assert words(drawn, "progress") == ["Tracing flow-lines"]
    assert drawn[-2][0] == "operator"
    assert len(words(drawn, "operator")) == 1  # Cancel


def test_the_flow_button_hides_what_is_shown(monkeypatch, rounded_box):
    box = rounded_box()
    monkeypatch.setattr(flow_overlay, "shown_object", lambda: box.name)
    assert "Hide Flow" in words(draw(panels.SHOCK_FILTER_PT_main), "operator")


def test_preview_is_offered_in_object_mode_only(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="SCULPT")
    shown = words(draw(panels.SHOCK_FILTER_PT_main), "operator")
    assert ("shock_filter.preview",) not in shown
    assert "Show Flow" in shown


def test_no_name_is_wider_than_the_sidebar():
    for mode, names in properties.NAMES.items():
        group = getattr(bpy.context.scene.shock_filter, mode)
        for name in names:
            assert len(group.bl_rna.properties[name].name) <= WIDEST, name


def reason(panel=panels.SHOCK_FILTER_PT_main, image=None):
    """Draw the panel; return what it says, and whether its buttons can be pressed."""
    layout = Layout()
    drawn = draw(panel, image, layout)
    return " ".join(map(str, words(drawn, "label"))), layout.enabled[-1]


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


def test_statistics_count_and_estimate(rounded_box):
    statistics.forget()
    rounded_box()
    drawn = words(draw(panels.SHOCK_FILTER_PT_statistics), "label")
    assert drawn[:6] == ["Meshes", "1", "Vertices", "866", "Faces", "864"]
    assert drawn[6:] == ["Time", "about 0.1 s", "Memory", "about 1 MB"]
    bpy.ops.shock_filter.sharpen_geometry()
    drawn = words(draw(panels.SHOCK_FILTER_PT_statistics), "label")
    assert drawn[-2] == "Last Run"
    assert drawn[-1].endswith((" s", " min"))


def test_texture_paint_mode_has_a_menu_in_its_header(rounded_box):
    rounded_box()
    bpy.ops.object.mode_set(mode="TEXTURE_PAINT")
    assert words(entry("VIEW3D_MT_editor_menus"), "menu") == [("SHOCK_FILTER_MT_texture_paint",)]
    layout = Layout()
    menus.SHOCK_FILTER_MT_texture_paint.draw(SimpleNamespace(layout=layout), bpy.context)
    assert words(layout.drawn, "operator") == [
        ("shock_filter.sharpen_texture",),
        ("shock_filter.dilate_texture",),
    ]
    bpy.ops.object.mode_set(mode="OBJECT")
    assert entry("VIEW3D_MT_editor_menus") == []


def test_long_sentences_are_wrapped(monkeypatch, rounded_box):
    rounded_box()
    sentence = "One sentence that is much longer than a narrow sidebar can show on a line."
    monkeypatch.setattr(kernels, "problem", lambda: sentence)
    monkeypatch.setattr(operators, "summaries", {})
    lines = words(draw(panels.SHOCK_FILTER_PT_main), "label")
    assert len(lines) > 1
    assert " ".join(lines) == sentence


def texture_panels(editor):
    """Choose textures; return the main panel and those below it that are seen then."""
    scene = bpy.context.scene
    scene.shock_filter.mode = "TEXTURE"
    scene.shock_filter.image_mode = "TEXTURE"
    main = panels.SHOCK_FILTER_PT_image_main if editor else panels.SHOCK_FILTER_PT_main
    below = [p for p in panels.CLASSES if getattr(p, "bl_parent_id", "") == main.__name__]
    return main, [panel for panel in below if panel.poll(SimpleNamespace(scene=scene))]


@pytest.mark.parametrize("editor", [False, True])
def test_both_editors_have_all_settings_of_textures(editor, rounded_box):
    rounded_box()
    main, below = texture_panels(editor)
    drawn = [entry for panel in (main, *below) for entry in draw(panel)]
    shown = set(words(drawn, "prop") + words(drawn, "prop_search")) - CHOICES
    wanted = set(bpy.context.scene.shock_filter.texture.bl_rna.properties.keys())
    wanted -= {"rna_type", "name", "selected_only"}
    assert shown == wanted - ({"image"} if editor else set())


def test_the_image_editors_buttons_name_the_image_that_is_seen():
    image = bpy.data.images.new("Seen", 4, 4)
    bpy.context.scene.shock_filter.texture.image = "Other"
    bpy.context.scene.shock_filter.texture.gutter = 3
    main, _ = texture_panels(editor=True)
    for carried in words(draw(main, image=image), "set"):
        assert (carried.image, carried.gutter) == ("Seen", 3)
    main, _ = texture_panels(editor=False)
    for carried in words(draw(main), "set"):
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
    assert "Shown: Wood" in words(draw(main), "label")
    bpy.context.scene.shock_filter.texture.image = "Wood"
    assert "Shown: Wood" not in words(draw(main), "label")
    bpy.data.images.remove(bpy.data.images["Wood"])
    text = " ".join(map(str, words(draw(main), "label")))
    assert "there is no image named 'Wood'; choose one of the file's images." in text
