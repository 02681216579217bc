# SPDX-License-Identifier: GPL-3.0-or-later
"""What the statistics count, and what they say of the last run."""

from types import SimpleNamespace

import bpy
import pytest
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import statistics
from shock_filter.shock_addon.operators.statistics import Counts


@pytest.fixture(autouse=True)
def nothing_learned():
    """Start without a history."""
    statistics.forget()
    yield
    statistics.forget()


def settings_of(mode):
    return getattr(bpy.context.scene.shock_filter, mode)


def count(mode, context=None):
    return statistics.count(context or bpy.context, find(mode), settings_of(mode))


def last_run(mode):
    return statistics.last_run(find(mode), settings_of(mode))


def test_a_mesh_with_several_users_counts_once(rounded_box, select):
    box = rounded_box(cuts=3)
    other = box.copy()
    bpy.context.collection.objects.link(other)
    third = rounded_box(cuts=1)
    assert count("geometry") == Counts(meshes=1, vertices=26, faces=24)
    select(box, other, third)
    assert count("geometry") == Counts(meshes=2, vertices=98 + 26, faces=96 + 24)


def test_empty_meshes_do_not_count(rounded_box, select):
    box, other = rounded_box(cuts=1), rounded_box(cuts=1)
    other.data.clear_geometry()
    other.data.from_pydata([(0, 0, 0)], [], [])
    select(box, other)
    assert count("geometry") == Counts(meshes=1, vertices=26, faces=24)


def basis(mode):
    return statistics.basis(bpy.context, find(mode), settings_of(mode))


def test_what_is_filtered_counts_and_the_panel_says_whether_with_modifiers(rounded_box, select):
    """Auto takes what is seen below a Subdivision; Mesh, and colors, what is below it."""
    box = rounded_box(cuts=1)
    assert basis("geometry") == ""
    box.modifiers.new("Fine", "SUBSURF").levels = 1
    bpy.context.view_layer.update()
    assert count("geometry") == Counts(meshes=1, vertices=98, faces=96)
    assert "with modifiers, as it is seen" in basis("geometry")
    settings_of("geometry").output = "MESH"
    for mode in ("geometry", "colors"):
        assert count(mode) == Counts(meshes=1, vertices=26, faces=24)
        assert "without modifiers" in basis(mode)
    settings_of("geometry").output = "AUTO"
    other = rounded_box(cuts=1)
    other.modifiers.new("Bend", "SIMPLE_DEFORM")
    select(box, other)
    assert count("geometry") == Counts(meshes=2, vertices=98 + 26, faces=96 + 24)
    assert "where new objects are made" in basis("geometry")


def test_a_live_copy_counts_what_its_source_shows(rounded_box):
    box = rounded_box(cuts=1)
    box.modifiers.new("Fine", "SUBSURF").levels = 1
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    assert bpy.context.object != box
    assert count("geometry").vertices == 98
    assert basis("geometry") == ""


def test_images_count_their_pixels():
    image = bpy.data.images.new("Photo", 30, 20)
    editor = SimpleNamespace(type="IMAGE_EDITOR", image=image)
    assert count("image", SimpleNamespace(space_data=editor)) == Counts(pixels=600)


def test_textures_count_the_pixels_of_what_is_shown(rounded_box):
    rounded_box(cuts=1)
    assert count("texture").size == 0
    bpy.data.images.new("Paint", 30, 20)
    settings_of("texture").image = "Paint"
    assert count("texture") == Counts(meshes=1, vertices=26, faces=24, pixels=600)


def test_nothing_counts_as_nothing():
    assert count("geometry") == Counts()


def test_operators_report_how_long_they_took_and_on_how_much(rounded_box):
    box = rounded_box()
    bpy.ops.shock_filter.sharpen_geometry()
    assert last_run("geometry").size == len(box.data.vertices)
    assert last_run("geometry").seconds > 0
    assert last_run("denoise") is None


def test_each_target_of_denoise_has_its_own_last_run(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.denoise()
    assert last_run("denoise").seconds > 0
    settings_of("denoise").target = "colors"
    assert last_run("denoise") is None


def test_operators_without_a_mode_of_their_own_teach_it_nothing(rounded_box):
    rounded_box()
    bpy.ops.shock_filter.show_flow(mode="geometry")
    assert last_run("geometry") is None


class Elements:
    """What can only be asked how many they are: reading millions at each redraw takes too long."""

    def __init__(self, number):
        self.number = number

    def __len__(self):
        return self.number


@pytest.mark.parametrize("mode", ["geometry", "colors", "denoise"])
def test_counting_does_not_read_the_mesh(mode):
    parts = {"vertices": Elements(1_000_000), "polygons": Elements(2_000_000)}
    mesh = SimpleNamespace(session_uid=1, is_editmode=False, **parts)
    obj = SimpleNamespace(type="MESH", data=mesh, modifiers=[])
    context = SimpleNamespace(mode="OBJECT", selected_objects=[obj], object=obj, space_data=None)
    assert count(mode, context) == Counts(meshes=1, vertices=1_000_000, faces=2_000_000)
