# SPDX-License-Identifier: GPL-3.0-or-later
"""A factory-fresh Blender (the bpy module) with the add-on registered from the source tree."""

import os
import tempfile

os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="shock_filter_tests_")

import bpy
import numpy as np
import pytest
import shock_filter
import wooden


@pytest.fixture(scope="session", autouse=True)
def addon():
    """Register the add-on once; classes left registered would crash or hang Blender's exit."""
    shock_filter.register()
    yield
    shock_filter.unregister()


@pytest.fixture(autouse=True)
def empty_file():
    """Start each test in an empty file."""
    bpy.ops.wm.read_homefile(use_empty=True)


@pytest.fixture
def rounded_box():
    """Return a function that adds a box of quads with rounded edges, and selects only it."""

    def add(location=(0.0, 0.0, 0.0), cuts=11):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.mesh.primitive_cube_add(location=location)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.subdivide(number_cuts=cuts)
        bpy.ops.mesh.vertices_smooth(factor=0.5, repeat=6)
        bpy.ops.object.mode_set(mode="OBJECT")
        return bpy.context.object

    return add


@pytest.fixture
def select():
    """Return a function that selects the given objects; the first becomes active."""

    def only(*objects):
        bpy.ops.object.select_all(action="DESELECT")
        for obj in objects:
            obj.select_set(True)
        bpy.context.view_layer.objects.active = objects[0]

    return only


@pytest.fixture
def over_view():
    """Return a function that calls an operator as a key does that is pressed over the 3D view."""

    def call(operator):
        window = bpy.context.window_manager.windows[0]
        area = next(area for area in window.screen.areas if area.type == "VIEW_3D")
        region = next(region for region in area.regions if region.type == "WINDOW")
        with bpy.context.temp_override(window=window, area=area, region=region):
            operator()

    return call


@pytest.fixture
def adjust(over_view):
    """Return a function that does what other settings under Adjust Last Operation do."""

    def change(**settings):
        properties = bpy.context.window_manager.operators[-1].properties
        for name, value in settings.items():
            setattr(properties, name, value)
        over_view(bpy.ops.ed.undo_redo)

    return change


@pytest.fixture(params=["Repeat Last", "Repeat History"])
def repeat(over_view, request):
    """Return a function that runs the last operator once more."""

    def run():
        if request.param == "Repeat Last":
            over_view(bpy.ops.screen.repeat_last)
        else:
            last = len(bpy.context.window_manager.operators) - 1
            over_view(lambda: bpy.ops.screen.repeat_history(index=last))

    return run


@pytest.fixture
def painted_sheet():
    """Return a function that adds a flat sheet whose colors blend along x, and selects it."""

    def add(kind="FLOAT_COLOR", domain="POINT", cells=32, opacity=0.5):
        bpy.ops.mesh.primitive_grid_add(x_subdivisions=cells, y_subdivisions=cells)
        obj = bpy.context.object
        attribute = obj.data.color_attributes.new("Paint", kind, domain)
        obj.data.color_attributes.active_color = attribute
        x = np.array([vertex.co.x for vertex in obj.data.vertices])
        if domain == "CORNER":
            x = x[[loop.vertex_index for loop in obj.data.loops]]
        step = 0.5 + 0.5 * np.tanh(4 * x)
        colors = np.stack([step, 1 - step, 0.3 * step, np.full_like(x, opacity)], axis=1)
        attribute.data.foreach_set("color_srgb", colors.astype(np.float32).reshape(-1))
        return obj

    return add


@pytest.fixture
def wood():
    """Return an image with a soft border, on a sheet that shows it by Emission."""
    return wooden.add_wood()
