# SPDX-License-Identifier: GPL-3.0-or-later
"""Panels and menu entries, drawn on a layout that checks each call against Blender's own."""

from types import SimpleNamespace

import bpy
import pytest
from shock_filter.core import GeometrySettings
from shock_filter.core.settings import describe
from shock_filter.shock_addon import jobs, kernels, menus, operators, panels

ABOUT = describe(GeometrySettings)
FUNCTIONS = bpy.types.UILayout.bl_rna.functions
ICONS = FUNCTIONS["label"].parameters["icon"].enum_items.keys()


class Layout:
    """Records what is drawn; refuses what Blender's layout would refuse."""

    def __init__(self, drawn=None):
        super().__setattr__("drawn", [] if drawn is None else drawn)

    def __setattr__(self, name, value):
        assert name in bpy.types.UILayout.bl_rna.properties, name

    def __getattr__(self, function):
        known = FUNCTIONS[function].parameters.keys()

        def call(*arguments, **options):
            assert set(options) <= set(known), (function, options)
            assert options.get("icon", "NONE") in ICONS
            if function in {"prop", "prop_search"}:
                assert arguments[1] in arguments[0].bl_rna.properties
            text = options.get("text", arguments[1] if len(arguments) > 1 else arguments[:1])
            self.drawn.append((function, text))
            if function == "operator":
                operator = SimpleNamespace()
                self.drawn.append(("set", operator))
                return operator
            return Layout(self.drawn)

        return call


def draw(panel):
    layout = Layout()
    context = SimpleNamespace(
        scene=bpy.context.scene,
        object=bpy.context.object,
        mode=bpy.context.mode,
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=1.0)),
        region=SimpleNamespace(width=280),
    )
    registered = bpy.types.Panel.bl_rna_get_subclass_py(panel.__name__)
    self = SimpleNamespace(layout=layout)
    if hasattr(panel, "draw_settings"):
        self.draw_settings = lambda *arguments: panel.draw_settings(self, *arguments)
    registered.draw(self, context)
    return layout.drawn


def words(drawn, function):
    return [text for name, text in drawn if name == function]


def test_the_main_panel_shows_the_mode_then_the_main_settings():
    drawn = draw(panels.SHOCK_FILTER_PT_main)
    main = [name for name, (_, _, about) in ABOUT.items() if not about.advanced]
    assert words(drawn, "prop") == ["mode", main[0], "steady_state", *main[1:]]
    assert words(drawn, "operator") == [("shock_filter.sharpen_geometry",)]


def test_the_closed_panels_show_the_rest(rounded_box):
    shown = []
    for panel in panels.CLASSES[1:]:
        assert panel.bl_options == {"DEFAULT_CLOSED"}
        drawn = draw(panel)
        shown += words(drawn, "prop") + words(drawn, "prop_search")
    advanced = [name for name, (_, _, about) in ABOUT.items() if about.advanced]
    assert sorted(shown) == sorted(["vertex_group", "invert_mask", "output", "weld", *advanced])
    rounded_box()
    assert "vertex_group" in words(draw(panels.SHOCK_FILTER_PT_geometry_mask), "prop_search")
    bpy.ops.object.mode_set(mode="EDIT")
    assert "selected_only" in words(draw(panels.SHOCK_FILTER_PT_geometry_mask), "prop")
    bpy.ops.object.mode_set(mode="SCULPT")
    assert any("sculpt mask" in str(text) for text in words(
        draw(panels.SHOCK_FILTER_PT_geometry_mask), "label"))  # fmt: skip


def test_the_button_carries_the_panels_settings():
    settings = bpy.context.scene.shock_filter.geometry
    settings.repeat = 7
    settings.output = "SHAPE_KEY"
    for drawn in (draw(panels.SHOCK_FILTER_PT_main), entry()):
        (carried,) = words(drawn, "set")
        assert carried.repeat == 7
        assert carried.output == "SHAPE_KEY"
        assert carried.time == pytest.approx(ABOUT["time"][1])


def entry():
    layout = Layout()
    menus.draw_entry(SimpleNamespace(layout=layout), bpy.context)
    return layout.drawn


def test_the_panel_says_what_is_wrong(monkeypatch):
    monkeypatch.setattr(kernels, "problem", lambda: "numba cannot be found: mend it thus.")
    monkeypatch.setattr(operators, "last_summary", "")
    text = " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    assert text == "numba cannot be found: mend it thus."


def test_the_panel_says_what_was_done(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    text = " ".join(words(draw(panels.SHOCK_FILTER_PT_main), "label"))
    assert text == operators.last_summary


def test_the_panel_shows_the_progress(monkeypatch):
    job = SimpleNamespace(fraction=0.5, message="Tracing flow-lines")
    monkeypatch.setattr(jobs, "current", lambda: job)
    assert words(draw(panels.SHOCK_FILTER_PT_main), "progress") == ["Tracing flow-lines"]


def test_long_sentences_are_wrapped(monkeypatch):
    sentence = "One sentence that is much longer than a narrow sidebar can show on a line."
    monkeypatch.setattr(kernels, "problem", lambda: sentence)
    monkeypatch.setattr(operators, "last_summary", "")
    lines = words(draw(panels.SHOCK_FILTER_PT_main), "label")
    assert len(lines) > 1
    assert " ".join(lines) == sentence
