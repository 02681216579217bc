# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Sharpen Colors."""

import re

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.mesh.meshes import read_corner_vertices, read_positions
from shock_filter.shock_addon.operators import base as operators

sharpen = bpy.ops.shock_filter.sharpen_colors

KINDS = ["BYTE_COLOR", "FLOAT_COLOR"]
DOMAINS = ["POINT", "CORNER"]
EACH = pytest.mark.parametrize(
    ("kind", "domain"), [(kind, domain) for kind in KINDS for domain in DOMAINS]
)


def read(obj, name="Paint"):
    """Colors as they are stored: (k, 4)."""
    attribute = obj.data.color_attributes[name]
    flat = np.empty(4 * len(attribute.data), dtype=np.float32)
    stored = "color_srgb" if attribute.data_type == "BYTE_COLOR" else "color"
    attribute.data.foreach_get(stored, flat)
    return flat.reshape(-1, 4)


def write(obj, colors, name="Paint"):
    attribute = obj.data.color_attributes[name]
    stored = "color_srgb" if attribute.data_type == "BYTE_COLOR" else "color"
    attribute.data.foreach_set(stored, np.ascontiguousarray(colors, np.float32).reshape(-1))


def places(obj):
    """Position of each color: (k, 3)."""
    points = read_positions(obj.data)
    if obj.data.color_attributes["Paint"].domain == "CORNER":
        return points[read_corner_vertices(obj.data)]
    return points


def steepness(obj):
    """How far the red channel is from a step of two values: 0 for a step."""
    red = read(obj)[:, 0]
    return np.minimum(red - red.min(), red.max() - red).mean()


def noise(count, seed=0):
    return np.random.default_rng(seed).random((count, 4)).astype(np.float32)


@EACH
def test_a_blend_becomes_an_edge_within_its_range(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain)
    before, blur = read(sheet), steepness(sheet)
    assert sharpen(time=4096.0, smoothing_passes=4) == {"FINISHED"}
    after = read(sheet)
    assert steepness(sheet) < 0.6 * blur
    assert (after >= before.min(axis=0) - 1e-6).all()
    assert (after <= before.max(axis=0) + 1e-6).all()
    np.testing.assert_array_equal(after[:, 3], before[:, 3])


@EACH
def test_a_run_says_how_wide_borders_were_and_are(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain)
    blur = steepness(sheet)
    assert sharpen(what="drawing") == {"FINISHED"}
    assert steepness(sheet) < 0.5 * blur
    said = operators.summaries["colors"]
    before, after = re.search(
        r"Borders (.*) edge lengths wide, closed to (\d+\.\d+)\.", said
    ).groups()
    assert float(before) > 2 * float(after)
    once = read(sheet)
    assert sharpen(what="drawing") == {"FINISHED"}
    again = operators.summaries["colors"]
    assert "Already sharp: borders " in again
    assert "changed 0, largest change 0," in again
    assert "raise Width" not in again
    assert read(sheet).tobytes() == once.tobytes()


@EACH
def test_a_second_run_hardly_changes_anything(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain)
    blur = steepness(sheet)
    assert sharpen() == {"FINISHED"}
    assert steepness(sheet) < 0.5 * blur
    once = read(sheet)
    assert sharpen() == {"FINISHED"}
    assert abs(read(sheet) - once).max() < 1.5 / 255


@EACH
def test_time_zero_changes_no_bit(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain)
    colors = noise(len(read(sheet)))
    if kind == "FLOAT_COLOR":
        colors[0] = (-0.0, 7.5, -2.0, 0.25)
    write(sheet, colors)
    before = read(sheet)
    for _ in range(3):
        assert sharpen(time=0.0) == {"FINISHED"}
    assert read(sheet).tobytes() == before.tobytes()
    assert "changed 0," in operators.summaries["colors"]


def test_all_bytes_survive_repeated_runs(painted_sheet):
    sheet = painted_sheet("BYTE_COLOR", cells=24)
    count = len(read(sheet))
    levels = (np.arange(4 * count) % 256 / 255).reshape(count, 4)
    write(sheet, levels)
    group = sheet.vertex_groups.new(name="Half")
    right = np.flatnonzero(read_positions(sheet.data)[:, 0] > 0)
    group.add(right.tolist(), 1.0, "REPLACE")
    before = read(sheet)
    np.testing.assert_array_equal(np.rint(255 * before), np.rint(255 * levels))
    for _ in range(4):
        sharpen(time=16.0, vertex_group="Half")
    after, left = read(sheet), places(sheet)[:, 0] <= 0
    assert after[left].tobytes() == before[left].tobytes()
    assert (after[~left] != before[~left]).any()


@pytest.mark.parametrize("kind", KINDS)
def test_jumps_between_corners_stay(painted_sheet, kind):
    sheet = painted_sheet(kind, "CORNER")
    colors = read(sheet)
    centers = np.array([p.center.x for p in sheet.data.polygons])
    right = np.repeat(centers > 0, [p.loop_total for p in sheet.data.polygons])
    colors[:, :3] = np.where(right[:, None], (0.8, 0.2, 0.0), (0.2, 0.4, 1.0))
    write(sheet, colors)
    before = read(sheet)
    sharpen(time=1000.0)
    np.testing.assert_array_equal(read(sheet), before)


@pytest.mark.parametrize("kind", KINDS)
def test_jumps_between_split_vertices_stay_and_seams_do_not_show(painted_sheet, select, kind):
    whole, split = painted_sheet(kind, cells=16), painted_sheet(kind, cells=16)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.object.mode_set(mode="OBJECT")
    points = read_positions(split.data)
    _, first, place = np.unique(points, axis=0, return_index=True, return_inverse=True)
    place = place.reshape(-1)
    assert len(first) < len(points)
    start = read(split)
    select(split)
    sharpen(time=64.0)
    sharp = read(split)
    assert (sharp != start).any()
    np.testing.assert_array_equal(sharp, sharp[first][place])
    select(whole)
    sharpen(time=64.0)
    order = np.lexsort(read_positions(whole.data).T)
    seamless = read(whole)[order]
    order = np.lexsort(points[first].T)
    np.testing.assert_allclose(sharp[first][order], seamless, atol=2e-2)

    # Each square in one color: nothing may flow between squares.
    corners = read_corner_vertices(split.data).reshape(-1, 4)
    colors = read(split)
    colors[corners] = noise(len(corners))[:, None, :]
    write(split, colors)
    before = read(split)
    select(split)
    sharpen(time=1000.0)
    np.testing.assert_array_equal(read(split), before)


@EACH
def test_n_gons_go_through(painted_sheet, kind, domain):
    sheet = painted_sheet(kind, domain, cells=24)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_mode(type="FACE")
    bpy.ops.mesh.select_all(action="DESELECT")
    bpy.ops.object.mode_set(mode="OBJECT")
    for polygon in sheet.data.polygons:
        row, column = divmod(polygon.index, 24)
        polygon.select = row % 4 < 2 and column in (10, 11)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.dissolve_faces()
    bpy.ops.object.mode_set(mode="OBJECT")
    assert max(p.loop_total for p in sheet.data.polygons) > 4
    before, blur = read(sheet), steepness(sheet)
    sharpen(time=0.0)
    assert read(sheet).tobytes() == before.tobytes()
    assert sharpen(time=2048.0, smoothing_passes=4) == {"FINISHED"}
    assert steepness(sheet) < 0.9 * blur
    assert (read(sheet) <= before.max(axis=0) + 1e-6).all()
    np.testing.assert_array_equal(read(sheet)[:, 3], before[:, 3])


def test_high_dynamic_range_is_kept(painted_sheet):
    sheet = painted_sheet("FLOAT_COLOR")
    colors = read(sheet)
    colors[:, :3] *= 5.0
    write(sheet, colors)
    sharpen(time=256.0)
    assert read(sheet).max() == pytest.approx(colors.max(), rel=0.05)
    assert (read(sheet) != colors).any()


def test_each_object_uses_its_own_active_attribute(painted_sheet, select):
    one, two = painted_sheet("BYTE_COLOR"), painted_sheet("FLOAT_COLOR", "CORNER")
    two.data.color_attributes["Paint"].name = "Other"
    other = one.data.color_attributes.new("Unused", "FLOAT_COLOR", "POINT")
    before = [read(one), read(two, "Other"), read(one, "Unused")]
    assert one.data.color_attributes.active_color != other
    select(one, two)
    assert sharpen(time=256.0) == {"FINISHED"}
    assert (read(one) != before[0]).any()
    assert (read(two, "Other") != before[1]).any()
    np.testing.assert_array_equal(read(one, "Unused"), before[2])
    assert operators.summaries["colors"].startswith("Sharpened the colors of 2 meshes: ")


def test_a_named_attribute_goes_before_the_active_one(painted_sheet):
    sheet = painted_sheet()
    named = sheet.data.color_attributes.new("Named", "FLOAT_COLOR", "POINT")
    write(sheet, read(sheet), "Named")
    sheet.data.color_attributes.active_color = sheet.data.color_attributes["Paint"]
    before = read(sheet)
    sharpen(attribute=named.name, time=256.0)
    np.testing.assert_array_equal(read(sheet), before)
    assert (read(sheet, "Named") != before).any()


def test_missing_attributes_are_named_with_the_fix(painted_sheet, rounded_box, select):
    box = rounded_box()
    with pytest.raises(RuntimeError, match=r"Skipped Cube: it has no color attribute; add one"):
        sharpen()
    sheet = painted_sheet()
    with pytest.raises(RuntimeError, match=r"named 'Else'; choose one of: Paint"):
        sharpen(attribute="Else")
    before = read(sheet)
    select(box, sheet)
    assert sharpen(time=256.0) == {"FINISHED"}
    assert (read(sheet) != before).any()


def test_a_mesh_with_two_users_is_sharpened_once(painted_sheet, select):
    alone, shared = painted_sheet(), painted_sheet()
    twin = bpy.data.objects.new("Twin", shared.data)
    bpy.context.collection.objects.link(twin)
    select(alone)
    sharpen(time=16.0)
    select(shared, twin)
    sharpen(time=16.0)
    np.testing.assert_array_equal(read(shared), read(alone))


def test_linked_meshes_are_skipped(painted_sheet, select, tmp_path):
    painted_sheet().data.name = "Library Mesh"
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {bpy.data.meshes["Library Mesh"]})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.meshes = ["Library Mesh"]
    linked = bpy.data.objects.new("Linked", wanted.meshes[0])
    bpy.context.collection.objects.link(linked)
    select(linked)
    with pytest.raises(RuntimeError, match=r"Skipped Linked: its mesh is linked .* make it local"):
        sharpen()


def test_lengths_are_measured_after_the_object_scale(painted_sheet, select):
    stretched, applied = painted_sheet(), painted_sheet()
    stretched.scale = (0.2, 1.0, 1.0)
    bpy.context.view_layer.update()
    points = read_positions(applied.data)
    points[:, 0] *= np.float32(0.2)
    applied.data.attributes["position"].data.foreach_set("vector", points.reshape(-1))
    applied.data.update()
    select(stretched, applied)
    sharpen(time=64.0)
    np.testing.assert_allclose(read(stretched), read(applied), atol=1e-5)


def test_nan_is_named_and_nothing_changes(painted_sheet):
    sheet = painted_sheet()
    colors = read(sheet)
    colors[5, 1] = np.nan
    write(sheet, colors)
    with pytest.raises(RuntimeError, match=r"Skipped Grid: The colors hold NaN"):
        sharpen()
    np.testing.assert_array_equal(read(sheet), colors)


def test_loose_vertices_keep_their_color(painted_sheet):
    sheet = painted_sheet()
    sheet.data.vertices.add(2)
    colors = read(sheet)
    colors[-2:] = (0.1, 0.9, 0.4, 1.0)
    write(sheet, colors)
    sharpen(time=256.0)
    np.testing.assert_array_equal(read(sheet)[-2:], colors[-2:])
    assert (read(sheet) != colors).any()


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT"])
def test_all_modes_go_through_and_are_kept(painted_sheet, mode):
    sheet = painted_sheet("BYTE_COLOR", "CORNER")
    before = read(sheet)
    bpy.ops.object.mode_set(mode=mode)
    if mode == "EDIT":
        bpy.ops.mesh.select_all(action="SELECT")
    assert sharpen(time=256.0) == {"FINISHED"}
    assert sheet.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert (read(sheet) != before).any()


def test_undo_brings_the_old_colors_back(painted_sheet):
    sheet = painted_sheet()
    name, before = sheet.name, read(sheet)
    bpy.ops.ed.undo_push(message="Before")
    sharpen(time=256.0)
    bpy.ops.ed.undo_push(message="After")
    assert (read(bpy.data.objects[name]) != before).any()
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(read(bpy.data.objects[name]), before)
