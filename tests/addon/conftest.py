# SPDX-License-Identifier: GPL-3.0-or-later
"""A factory-fresh Blender (the bpy module) with the add-on registered from the source tree."""

import os
import tempfile

os.environ["BLENDER_USER_RESOURCES"] = tempfile.mkdtemp(prefix="shock_filter_tests_")

import bpy
import pytest
import shock_filter


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
