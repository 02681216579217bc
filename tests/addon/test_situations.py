# SPDX-License-Identifier: GPL-3.0-or-later
"""The table in docs/situations.md: each row has a test, here or in another file."""

import ast
import re
from functools import partial
from pathlib import Path

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from shock_filter.core.host.inputs import MirrorPlane
from shock_filter.shock_addon.data import arrays
from shock_filter.shock_addon.data.mesh import shape_keys
from shock_filter.shock_addon.data.mesh.meshes import (
    read_corner_vertices,
    read_positions,
    write_positions,
)
from shock_filter.shock_addon.operators import base as operators

ROOT = Path(__file__).parents[2]

sharpen = bpy.ops.shock_filter.sharpen_geometry
denoise = bpy.ops.shock_filter.denoise
sharpen_colors = bpy.ops.shock_filter.sharpen_colors

BOTH = pytest.mark.parametrize(
    "operator",
    [sharpen, partial(denoise, method="beltrami")],  # else what is clean stays
    ids=["sharpen", "denoise"],
)

ELSEWHERE = {
    # Modes
    "object-mode": "test_masks.py::test_object_mode_ignores_the_selection",
    "edit-mode": "test_masks.py::test_edit_mode_moves_the_selection_and_stays_in_edit_mode",
    "edit-mode-all": "test_masks.py::test_edit_mode_can_move_all_that_is_not_hidden",
    "edit-mode-objects": "test_masks.py::test_edit_mode_on_two_objects",
    "edit-mode-faces": "test_color_masks.py::test_selected_faces_leave_the_corners_of_others_alone",
    "sculpt-mask": "test_masks.py::test_the_sculpt_mask_protects_in_sculpt_mode_only",
    "paint-mask-colors": "test_color_masks.py::test_the_paint_mask_of_faces",
    "paint-mask-vertices": "test_color_masks.py::test_the_paint_mask_of_vertices",
    "paint-hidden": "test_color_masks.py::test_hidden_parts_stay",
    "texture-paint": "test_sharpen_texture.py::test_the_paint_mask_of_texture_paint_mode_protects",
    "all-modes-colors": "test_sharpen_colors.py::test_all_modes_go_through_and_are_kept",
    # Masks
    "vertex-group": "test_masks.py::test_weight_zero_is_exactly_unmoved",
    "vertex-group-weights": "test_masks.py::test_lower_weights_move_less",
    "vertex-group-missing": "test_masks.py::test_a_missing_group_is_named",
    "nothing-free": "test_masks.py::test_an_empty_group_is_named",
    "mask-at-seams": "test_masks.py::test_of_welded_vertices_the_most_protected_counts",
    "mask-image": "test_sharpen_texture.py::test_a_mask_image_protects",
    "mask-image-bad": "test_sharpen_texture.py::test_bad_masks_are_named",
    # Shape keys
    "key-active": "test_shape_keys.py::test_the_active_key_is_sharpened",
    "key-basis": "test_shape_keys.py::test_keys_move_along_with_the_basis",
    "key-edit-mode": "test_shape_keys.py::test_edit_mode_writes_the_active_key",
    "key-locked": "test_shape_keys.py::test_a_locked_key_is_named",
    "key-absolute": "test_shape_keys.py::test_absolute_keys_are_named",
    "key-new": "test_shape_keys.py::test_a_new_key_holds_the_result_and_the_mesh_stays",
    "key-new-mix": "test_shape_keys.py::test_a_new_key_sharpens_what_is_seen",
    "key-mix": "test_shape_keys.py::test_the_mix_is_the_one_that_blender_shows",
    # Normals and edges
    "normals-mark-creases": (
        "test_creases.py::test_sharp_marks_that_would_turn_custom_normals_are_refused"
    ),
    # Symmetry and modifiers
    "symmetry": "test_symmetry.py::test_a_symmetric_mesh_stays_symmetric",
    "symmetry-mask": "test_symmetry.py::test_an_asymmetric_mask_is_respected",
    "new-object": "test_new_object.py::test_it_holds_what_is_seen_and_the_original_stays",
    "new-object-mode": "test_new_object.py::test_it_is_refused_outside_object_mode",
    # Objects
    "shared-mesh": "test_sharpen_geometry.py::test_a_mesh_with_two_users_is_sharpened_once",
    "linked-mesh": "test_sharpen_geometry.py::test_linked_meshes_are_skipped",
    "bad-among-good": "test_sharpen_geometry.py::test_a_bad_mesh_does_not_stop_the_good_one",
    "nothing-selected": "test_sharpen_geometry.py::test_nothing_selected_greys_the_button_out",
    "scale": "test_uneven_scale.py::test_both_kinds_at_once_become_what_they_become_without_scale",
    "scale-uniform": "test_sharpen_geometry.py::test_uniform_scale_changes_nothing",
    "scale-zero": "test_sharpen_geometry.py::test_a_scale_of_zero_is_named",
    # Meshes
    "no-faces": "test_sharpen_geometry.py::test_no_faces_is_named",
    "loose": "test_sharpen_geometry.py::test_loose_vertices_and_edges_stay",
    "n-gons": "test_sharpen_geometry.py::test_n_gons_go_through",
    "quads": "test_sharpen_geometry.py::test_suzanne_of_quads_and_triangles_keeps_its_faces",
    "split-seams": "test_sharpen_geometry.py::test_seams_of_split_meshes_stay_closed_if_welded",
    "nan": "test_sharpen_geometry.py::test_a_nan_is_named_and_nothing_changes",
    "time-zero": "test_sharpen_geometry.py::test_time_zero_changes_no_bit",
    # Colors
    "color-kinds": "test_sharpen_colors.py::test_a_blend_becomes_an_edge_within_its_range",
    "color-jumps": "test_sharpen_colors.py::test_jumps_between_corners_stay",
    "color-none": "test_sharpen_colors.py::test_missing_attributes_are_named_with_the_fix",
    "color-active": "test_sharpen_colors.py::test_each_object_uses_its_own_active_attribute",
    "color-named": "test_sharpen_colors.py::test_a_named_attribute_goes_before_the_active_one",
    "color-hdr": "test_sharpen_colors.py::test_high_dynamic_range_is_kept",
    "color-bytes": "test_sharpen_colors.py::test_all_bytes_survive_repeated_runs",
    "color-nan": "test_sharpen_colors.py::test_nan_is_named_and_nothing_changes",
    "color-loose": "test_sharpen_colors.py::test_loose_vertices_keep_their_color",
    # Images
    "image-kinds": "test_sharpen_image.py::test_time_zero_changes_no_bit_of_any_kind",
    "image-refused": (
        "test_sharpen_image.py::test_what_cannot_be_sharpened_is_refused_with_the_reason"
    ),
    "image-linked": "test_sharpen_image.py::test_linked_images_are_refused",
    "image-packed": "test_sharpen_image.py::test_a_packed_image_comes_back_from_the_file",
    "image-editors": "test_sharpen_image.py::test_image_editors_follow_undo_and_redo",
    "image-kept": "test_sharpen_texture.py::test_both_images_come_back_from_the_file",
    "image-new": "test_sharpen_image.py::test_a_new_image_comes_back_from_the_file",
    "image-name": "test_sharpen_image.py::test_new_names_have_no_file_ending_and_one_suffix",
    "texture-paint-new": "test_sharpen_texture.py::"
    "test_texture_paint_mode_paints_on_the_new_image_from_then_on",
    "image-data": "test_sharpen_image.py::test_non_color_data_is_filtered_as_it_is",
    "image-hdr": "test_sharpen_image.py::test_high_dynamic_range_is_kept",
    "image-alpha": "test_sharpen_image.py::test_opacity_stays_and_transparent_pixels_lend_no_color",
    "image-channels": "test_sharpen_image.py::test_packed_channels_are_filtered_alike",
    "image-none": (
        "test_sharpen_image.py::test_no_image_greys_the_button_out_and_unknown_names_are_named"
    ),
    "image-replace": (
        "test_sharpen_image.py::test_redo_of_a_replaced_image_starts_from_the_old_pixels"
    ),
    "image-replace-painted": (
        "test_sharpen_image.py::test_strokes_on_a_replaced_image_outlive_a_redo"
    ),
    "image-repeat": ("test_sharpen_image.py::test_repeating_a_replacement_sharpens_what_is_there"),
    "image-repeat-new": "test_sharpen_image.py::test_strokes_on_a_result_outlive_a_repetition",
    "image-removed": ("test_sharpen_image.py::test_an_image_that_was_removed_meanwhile_is_skipped"),
    # Textures
    "texture-bad": "test_sharpen_texture.py::test_bad_input_is_named_and_nothing_changes",
    "uv-overlap": "test_sharpen_texture.py::test_overlapping_uvs_are_reported",
    "uv-seams": "test_sharpen_texture.py::test_colors_flow_across_a_seam",
    "uv-seams-materials": "test_sharpen_texture.py::test_materials_that_meet_at_a_seam_stay_apart",
    "uv-seams-noise": "test_sharpen_texture.py::test_noise_falls_across_a_seam",
    "texture-objects": "test_sharpen_texture.py::test_two_objects_on_one_image_are_solved_together",
    "texture-others": "test_sharpen_texture.py::test_others_that_show_the_image_are_mentioned",
    "texture-faces": "test_sharpen_texture.py::test_faces_of_other_materials_take_no_part",
    "texture-linked": (
        "test_sharpen_texture.py::test_linked_images_are_refused_and_linked_meshes_are_read"
    ),
    "texture-material": (
        "test_sharpen_texture.py::test_a_linked_material_keeps_its_image_and_says_so"
    ),
    "texture-tiles": "test_sharpen_texture.py::test_tiles_are_sharpened_together",
    "texture-tiles-unsaved": (
        "test_sharpen_texture.py::test_tiles_that_are_not_saved_are_refused_and_missing_ones_left_out"
    ),
    "texture-tiles-full-disk": ("test_sharpen_texture.py::test_tiles_are_not_lost_on_a_full_disk"),
    "texture-outside-tiles": ("test_sharpen_texture.py::test_faces_outside_the_tiles_take_no_part"),
    "gain-one": "test_filter_texture.py::test_a_gain_of_1_changes_nothing_and_the_report_says_why",
    "gain-map": "test_filter_texture.py::test_a_gain_map_says_where_by_its_stored_values",
    "gain-map-bad": "test_filter_texture.py::test_bad_gain_maps_are_named",
    "gain-both": "test_filter_texture.py::test_gain_colors_say_the_same_on_the_mesh",
    "gain-normals": "test_filter_texture.py::test_other_maps_are_filtered_too_and_normals_as_such",
    "normals-node": "test_filter_normals.py::test_what_no_node_says_is_said_by_the_setting",
    "normals-mirrored": "test_filter_normals.py::test_maps_of_both_spaces_are_lit_alike",
    "gain-painting": "test_filter_texture.py::test_painting_ends_with_what_it_is_about",
    "gain-painting-saved": (
        "test_filter_texture.py::test_files_that_were_saved_meanwhile_show_the_texture"
    ),
    "stitch-charts": (
        "test_stitch_textures.py::test_the_step_between_charts_goes_and_the_mean_stays"
    ),
    "stitch-pictures": "test_stitch_textures.py::test_pictures_become_one_where_each_is_known",
    "stitch-seams": "test_stitch_textures.py::test_at_seams_alone_the_rest_stays",
    "stitch-unknown": "test_stitch_textures.py::test_what_no_picture_knows_stays_transparent",
    "flow-folder": "test_visualize_flow.py::test_a_file_that_was_never_saved_needs_a_folder",
    "flow-folder-full": "test_visualize_flow.py::test_what_cannot_be_shown_is_named",
    "flow-cancelled": "test_visualize_flow.py::test_esc_leaves_nothing",
    "flow-redo": "test_visualize_flow.py::"
    "test_undo_takes_the_image_back_and_redo_writes_the_same_folder",
    "flow-missing": "test_visualize_flow.py::test_what_cannot_be_shown_is_named",
    "generate-start": "test_generate.py::test_distance_counts_from_what_is_said",
    "generate-first": ("test_generate.py::test_the_first_press_counts_from_the_lowest_vertices"),
    "generate-nothing": "test_generate.py::test_what_is_missing_is_named",
    "generate-all": "test_generate.py::test_all_selected_is_no_start",
    "generate-island": "test_generate.py::test_parts_that_no_way_leads_to_are_black",
    "generate-attribute": "test_generate.py::test_distance_at_vertices_is_an_attribute",
    "generate-along": "test_generate.py::test_streaks_follow_an_attribute",
    "generate-scale": "test_generate.py::test_a_pattern_grows_and_its_scale_is_painted",
    "generate-material": "test_generate.py::test_an_object_without_a_material_shows_the_image",
    "generate-node": "test_generate.py::test_a_material_gets_a_node_that_waits",
    "generate-replaced": "test_generate.py::test_an_image_is_replaced_at_its_own_size",
    "generate-no-uv": "test_generate.py::test_a_mesh_without_uv_map_is_refused",
    "stitch-bad": "test_stitch_textures.py::test_pictures_that_do_not_fit_are_named",
    # Runs
    "undo": "test_sharpen_geometry.py::test_undo_brings_the_old_shape_back",
    "before-after": "test_before_after.py::test_positions_and_marks",
    "before-after-images": "test_before_after.py::test_replaced_pixels",
    "before-after-changed": "test_before_after.py::test_what_has_changed_since_is_left_alone",
    "before-after-undo": "test_before_after.py::test_undo_and_redo_go_through_swaps",
    "before-after-saved": "test_before_after.py::test_the_panel_and_the_report_say_what_is_shown",
    "redo": "test_sharpen_geometry.py::test_redo_with_other_settings_starts_from_the_old_shape",
    "esc": "test_jobs.py::test_cancelling_the_filter_leaves_the_mesh_alone",
    "render": "test_jobs.py::test_nothing_is_written_while_a_render_reads_the_scene",
    "failed-writing": "test_jobs.py::test_an_unexpected_error_while_writing_can_be_undone",
    "second-run": "test_jobs.py::test_a_second_run_is_refused_meanwhile",
    "changed-meanwhile": "test_jobs.py::test_an_object_that_was_changed_meanwhile_is_skipped",
    "removed-meanwhile": "test_jobs.py::test_an_object_that_was_removed_meanwhile_is_skipped",
    # Preview
    "preview-esc": "test_preview.py::test_cancelling_changes_nothing",
    "preview-before": "test_preview.py::test_a_key_shows_what_was_there_before",
    "preview-modes": "test_preview.py::test_other_modes_see_it_and_are_kept",
    "preview-edit-mode": (
        "test_preview.py::test_edit_mode_previews_the_selection_and_the_key_that_it_shows"
    ),
    "preview-patch": "test_preview.py::test_a_patch_moves_alone_and_its_border_stays",
    "preview-mirror": "test_preview.py::test_a_patch_holds_its_mirror_images",
    "preview-image": "test_preview_images.py::test_the_image_is_not_touched",
    "preview-image-patch": (
        "test_preview_images.py::test_what_is_drawn_is_what_the_operator_makes"
    ),
    "preview-texture": (
        "test_preview_images.py::test_a_texture_needs_an_image_editor_for_its_preview"
    ),
    "preview-texture-model": (
        "test_preview_images.py::test_a_texture_is_shown_on_the_model_and_the_material_comes_back"
    ),
    "preview-generate": (
        "test_preview_fields.py::test_what_is_drawn_is_what_a_run_makes_but_smaller"
    ),
    "preview-handlers": "test_preview.py::test_blenders_handlers_end_it_first",
    "preview-gone": "test_preview.py::test_a_removed_object_ends_the_operator",
    "preview-image-gone": (
        "test_preview_images.py::test_it_ends_when_the_image_is_gone_or_seen_no_more"
    ),
    "live": "test_live.py::test_amounts_go_from_the_mesh_to_the_result_and_beyond",
    "live-multires": "test_live.py::test_multires_is_named_before_anything_is_written",
    "live-others": "test_live.py::test_other_outputs_take_the_live_result_away",
    "modifier-on-top": "test_new_object.py::test_what_is_sharpened_is_what_is_seen",
    # Show Flow
    "flow-mesh": "test_show_flow.py::test_the_mesh_stays_as_it_is",
    "flow-edits": "test_show_flow.py::test_edits_are_drawn_anew",
}
"""Rows that other files test."""


def table_rows():
    text = (ROOT / "docs" / "situations.md").read_text(encoding="utf-8")
    return re.findall(r'^\| <a id="([a-z-]+)"></a>', text, flags=re.MULTILINE)


def names_of_tests(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    functions = [node.name for node in tree.body if isinstance(node, ast.FunctionDef)]
    return {name for name in functions if name.startswith("test_")}


def test_each_row_of_the_table_has_its_test():
    rows = table_rows()
    assert len(rows) == len(set(rows)) > 100
    own = names_of_tests(Path(__file__)) - {"test_each_row_of_the_table_has_its_test"}
    own = {name.removeprefix("test_").replace("_", "-") for name in own}
    assert own.isdisjoint(ELSEWHERE)
    assert set(rows) == own | set(ELSEWHERE)
    for place in ELSEWHERE.values():
        file, name = place.split("::")
        assert name in names_of_tests(Path(__file__).with_name(file)), place


def moved(obj, before):
    """Which vertices have moved; leaves the current mode."""
    if obj.mode != "OBJECT":
        bpy.ops.object.mode_set(mode="OBJECT")
    return (read_positions(obj.data) != before).any(axis=1)


def right_of(obj):
    return read_positions(obj.data)[:, 0] > 0.01


def flag(mesh, name, vertices):
    """Set a flag of vertices, and of the faces that have only such vertices."""
    faces = np.array([vertices[list(polygon.vertices)].all() for polygon in mesh.polygons])
    mesh.vertices.foreach_set(name, np.ascontiguousarray(vertices))
    mesh.edges.foreach_set(name, np.zeros(len(mesh.edges), dtype=bool))
    mesh.polygons.foreach_set(name, faces)
    mesh.update()
    return faces


def seen(obj):
    """The positions that Blender shows."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return read_positions(evaluated.data)


def corner_normals(mesh):
    flat = np.empty(3 * len(mesh.loops), dtype=np.float32)
    mesh.corner_normals.foreach_get("vector", flat)
    return flat.reshape(-1, 3)


def sharp_edges(mesh):
    flags = np.empty(len(mesh.edges), dtype=bool)
    mesh.edges.foreach_get("use_edge_sharp", flags)
    return flags


def edge_vertices(mesh):
    ends = np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.edges.foreach_get("vertices", ends)
    return ends.reshape(-1, 2)


def shade_smooth(mesh):
    mesh.polygons.foreach_set("use_smooth", np.ones(len(mesh.polygons), dtype=bool))
    mesh.update()


def new_mesh(vertices, faces, edges=()):
    mesh = bpy.data.meshes.new("Mesh")
    mesh.from_pydata(vertices, list(edges), faces)
    obj = bpy.data.objects.new("Mesh", mesh)
    bpy.context.collection.objects.link(obj)
    bpy.ops.object.select_all(action="DESELECT")
    obj.select_set(True)
    bpy.context.view_layer.objects.active = obj
    return obj


def sheet(cells=12, size=1.0):
    """A square roof of quads: vertices and faces."""
    line = np.linspace(-size, size, cells + 1)
    x, y = np.meshgrid(line, line)
    z = -0.5 * np.sqrt(x**2 + (0.1 * size) ** 2)
    number = np.arange(x.size).reshape(x.shape)
    corners = (number[:-1, :-1], number[:-1, 1:], number[1:, 1:], number[1:, :-1])
    faces = np.stack(corners, axis=-1).reshape(-1, 4).tolist()
    return np.stack([x, y, z], axis=-1).reshape(-1, 3), faces


# ------------------------------------------------------------------------------------------ modes


def test_edit_mode_hidden(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    flag(box.data, "select", np.ones_like(right))
    flag(box.data, "hide", right)
    bpy.ops.object.mode_set(mode="EDIT")
    assert sharpen(selected_only=False) == {"FINISHED"}
    changed = moved(box, before)
    assert changed[~right].any()
    assert not changed[right].any()


def test_object_mode_hidden(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    flag(box.data, "hide", right)
    sharpen()
    assert moved(box, before)[right].any()


def test_sculpt_hidden(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    hidden = flag(box.data, "hide", right)
    of_hidden = right & ~np.isin(
        np.arange(len(right)), [v for p in box.data.polygons if not p.hide for v in p.vertices]
    )
    assert hidden.any()
    bpy.ops.object.mode_set(mode="SCULPT")
    assert sharpen() == {"FINISHED"}
    assert box.mode == "SCULPT"
    changed = moved(box, before)
    assert changed[~right].any()
    assert not changed[of_hidden].any()
    assert [polygon.hide for polygon in box.data.polygons] == hidden.tolist()


def test_face_sets(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    sets = box.data.attributes.new(".sculpt_face_set", "INT", "FACE")
    numbers = np.where([polygon.center.x > 0 for polygon in box.data.polygons], 2, 1)
    sets.data.foreach_set("value", numbers.astype(np.int32))
    bpy.ops.object.mode_set(mode="SCULPT")
    assert sharpen() == {"FINISHED"}
    changed = moved(box, before)
    assert changed[right].any()
    assert changed[~right].any()
    after = [each.value for each in box.data.attributes[".sculpt_face_set"].data]
    assert after == numbers.tolist()


def test_dyntopo(rounded_box):
    box = rounded_box()
    for layer in list(box.data.uv_layers):
        box.data.uv_layers.remove(layer)
    bpy.ops.object.mode_set(mode="SCULPT")
    bpy.ops.sculpt.dynamic_topology_toggle()
    assert box.use_dynamic_topology_sculpting
    for operator in (sharpen, denoise):
        with pytest.raises(RuntimeError, match="dynamic topology is on; turn Dyntopo off"):
            operator()
    assert box.use_dynamic_topology_sculpting
    bpy.ops.sculpt.dynamic_topology_toggle()
    assert sharpen() == {"FINISHED"}


def with_multires(box):
    modifier = box.modifiers.new("Multires", "MULTIRES")
    bpy.ops.object.multires_subdivide(modifier="Multires", mode="CATMULL_CLARK")
    assert modifier.sculpt_levels == 1


@BOTH
def test_multires_sculpt(rounded_box, operator):
    box = rounded_box(cuts=4)
    with_multires(box)
    before = read_positions(box.data)
    bpy.ops.object.mode_set(mode="SCULPT")
    with pytest.raises(RuntimeError, match="Multiresolution modifier cannot be filtered; apply"):
        operator()
    assert box.mode == "SCULPT"
    assert not moved(box, before).any()


def test_multires_object(rounded_box):
    box = rounded_box()
    with_multires(box)
    before, details = read_positions(box.data), seen(box)
    assert sharpen() == {"FINISHED"}
    assert moved(box, before).any()
    assert (seen(box) != details).any()


@pytest.mark.parametrize("mode", ["VERTEX_PAINT", "WEIGHT_PAINT", "TEXTURE_PAINT"])
@BOTH
def test_paint_mask_geometry(rounded_box, operator, mode):
    box = rounded_box()
    before = read_positions(box.data)
    faces = np.array([polygon.center.x > 0.01 for polygon in box.data.polygons])
    allowed = {v for p in box.data.polygons if faces[p.index] for v in p.vertices}
    box.data.polygons.foreach_set("select", faces)
    box.data.use_paint_mask = True
    bpy.ops.object.mode_set(mode=mode)
    assert operator() == {"FINISHED"}
    assert box.mode == mode
    changed = set(np.flatnonzero(moved(box, before)))
    assert changed
    assert changed <= allowed


def test_paint_mask_weight_vertices(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    flag(box.data, "select", right)
    box.data.use_paint_mask_vertex = True
    bpy.ops.object.mode_set(mode="WEIGHT_PAINT")
    sharpen()
    changed = moved(box, before)
    assert changed.any()
    assert not changed[~right].any()


def test_other_modes():
    bpy.ops.object.armature_add()
    bpy.ops.object.mode_set(mode="POSE")
    assert not sharpen.poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.curve.primitive_bezier_circle_add()
    bpy.ops.object.mode_set(mode="EDIT")
    with pytest.raises(RuntimeError, match=r"Select a mesh object|Convert the object to a mesh"):
        sharpen()


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT"])
def test_undo_modes(rounded_box, mode):
    box = rounded_box()
    name, before = box.name, read_positions(box.data)
    group = box.vertex_groups.new(name="All")
    group.add(range(len(before)), 1.0, "REPLACE")
    bpy.ops.object.mode_set(mode=mode)
    if mode == "EDIT":
        bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.ed.undo_push(message="Before")
    sharpen(vertex_group="All")
    bpy.ops.ed.undo_push(message="After")
    bpy.ops.ed.undo()
    box = bpy.data.objects[name]
    assert box.mode == mode
    assert not moved(box, before).any()


@pytest.mark.parametrize("mode", ["SCULPT", "VERTEX_PAINT"])
def test_undo_strokes(rounded_box, mode):
    name = rounded_box().name

    def values():
        mesh = bpy.data.objects[name].data
        kind = mesh.attributes["position"], mesh.color_attributes.active_color
        return arrays.read_attribute(kind[mode == "VERTEX_PAINT"])

    mesh = bpy.data.objects[name].data
    paint = mesh.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    x = read_positions(mesh)[:, :1]
    arrays.write_attribute(paint, (0.5 + 0.4 * np.tanh(3.0 * x)).repeat(4, axis=1))
    mesh.color_attributes.active_color = paint
    bpy.ops.object.mode_set(mode=mode)
    bpy.ops.ed.undo_push(message="Mode")
    if mode == "SCULPT":  # as strokes, these add steps that hold their changes only
        bpy.ops.paint.mask_flood_fill("EXEC_DEFAULT", True, mode="VALUE", value=0.5)
        run = partial(sharpen, "EXEC_DEFAULT", True)
    else:
        bpy.ops.paint.vertex_color_brightness_contrast("EXEC_DEFAULT", True, brightness=10.0)
        run = partial(bpy.ops.shock_filter.sharpen_colors, "EXEC_DEFAULT", True)
    before = values()
    run()
    after = values()
    assert (after != before).any()
    bpy.ops.shock_filter.before_after("EXEC_DEFAULT", True)
    assert (values() == before).all()
    bpy.ops.ed.undo()
    assert (values() == after).all()
    bpy.ops.ed.undo()
    box = bpy.data.objects[name]
    assert box.mode == mode
    assert (values() == before).all()
    assert (".sculpt_mask" in box.data.attributes) == (mode == "SCULPT")


# ------------------------------------------------------------------------------------------ masks


def test_masks_multiply(rounded_box):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    front = before[:, 1] > 0.01
    box.vertex_groups.new(name="Right").add(np.flatnonzero(right).tolist(), 1.0, "REPLACE")
    mask = box.data.attributes.new(".sculpt_mask", "FLOAT", "POINT")
    mask.data.foreach_set("value", front.astype(np.float32))
    bpy.ops.object.mode_set(mode="SCULPT")
    sharpen(vertex_group="Right")
    changed = moved(box, before)
    assert changed.any()
    assert not changed[~right | front].any()


@pytest.mark.parametrize("name", ["Mask", "position", "material_index", "Größe"])
def test_vertex_group_names(rounded_box, name):
    box = rounded_box()
    right, before = right_of(box), read_positions(box.data)
    box.vertex_groups.new(name="Other").add(range(len(right)), 0.5, "REPLACE")
    box.vertex_groups.new(name=name).add(np.flatnonzero(right).tolist(), 1.0, "REPLACE")
    counts = [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "scenes")]
    sharpen(vertex_group=name)
    changed = moved(box, before)
    assert changed.any()
    assert not changed[~right].any()
    assert counts == [len(getattr(bpy.data, kind)) for kind in ("objects", "meshes", "scenes")]
    assert not bpy.data.node_groups
    assert [group.name for group in box.vertex_groups] == ["Other", name]


# ------------------------------------------------------------------------------------- shape keys


@pytest.fixture
def keyed(rounded_box):
    """A box with a Basis and a key that lifts it, which is active and has the value 0.5."""
    box = rounded_box()
    box.shape_key_add(name="Basis", from_mix=False)
    lifted = box.shape_key_add(name="Lifted", from_mix=False)
    stretched = shape_keys.read(lifted) * np.float32([1, 1, 1.5]) + np.float32([0, 0, 1])
    shape_keys.write(lifted, stretched)
    lifted.value = 0.5
    box.active_shape_key_index = 1
    return box


def test_key_muted(keyed, rounded_box, select):
    lifted = keyed.data.shape_keys.key_blocks["Lifted"]
    lifted.mute = True
    plain = rounded_box()
    sharpen()
    select(keyed)
    assert sharpen(output="SHAPE_KEY") == {"FINISHED"}
    np.testing.assert_allclose(seen(keyed), read_positions(plain.data), atol=1e-6)
    keyed.active_shape_key_index = 1
    before = shape_keys.read(lifted)
    sharpen()
    assert (shape_keys.read(lifted) != before).any()


@pytest.mark.parametrize("group", ["", "Some"])
def test_key_pinned(keyed, group):
    keyed.vertex_groups.new(name="Some").add(range(0, 200), 0.25, "REPLACE")
    lifted = keyed.data.shape_keys.key_blocks["Lifted"]
    lifted.vertex_group = group
    keyed.show_only_shape_key = True
    shown = seen(keyed)
    np.testing.assert_allclose(shape_keys.visible_shape(keyed, "OBJECT"), shown, atol=1e-6)
    assert sharpen(output="SHAPE_KEY", where="everywhere") == {"FINISHED"}
    assert keyed.active_shape_key.name == "Sharpened"
    moves = seen(keyed) - shown
    assert 0.0 < np.abs(moves).max() < 0.3
    if not group:
        assert keyed.active_shape_key.relative_key == lifted
        keyed.show_only_shape_key = False
        lifted.value = 1.0
        np.testing.assert_allclose(seen(keyed), shown + moves, atol=1e-5)


def test_key_new_edit_mode(keyed):
    lifted = shape_keys.read(keyed.active_shape_key)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    assert sharpen(output="SHAPE_KEY") == {"FINISHED"}
    assert keyed.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    new = keyed.active_shape_key
    assert (new.name, new.relative_key.name) == ("Sharpened", "Lifted")
    change = np.abs(shape_keys.read(new) - lifted).max()
    assert 0.0 < change < 0.3
    np.testing.assert_array_equal(shape_keys.read(new.relative_key), lifted)


def test_key_value(keyed, capfd):
    keyed.active_shape_key.value = 0.0
    sharpen()
    assert "The value of the shape key Lifted is 0; raise it to see" in capfd.readouterr().out
    keyed.show_only_shape_key = True
    sharpen()
    assert "shape key Lifted" not in capfd.readouterr().out


def test_key_driven(keyed):
    lifted = keyed.data.shape_keys.key_blocks["Lifted"]
    lifted.driver_add("value").driver.expression = "0.25 * frame"
    bpy.context.scene.frame_set(3)
    shown = seen(keyed)
    expected = shape_keys.read(keyed.data.shape_keys.reference_key)
    expected = expected + 0.75 * (shape_keys.read(lifted) - expected)
    np.testing.assert_allclose(shown, expected, atol=1e-6)
    assert sharpen(output="SHAPE_KEY") == {"FINISHED"}
    basis = shape_keys.read(keyed.data.shape_keys.reference_key)
    change = shape_keys.read(keyed.active_shape_key) - basis
    np.testing.assert_allclose(seen(keyed), shown + change, atol=1e-5)
    assert np.abs(change).max() > 0.0


# ---------------------------------------------------------------------------------------- shading


@pytest.fixture
def with_normals(rounded_box):
    """A smooth box with custom normals that lean to one side."""
    box = rounded_box()
    shade_smooth(box.data)
    leaning = corner_normals(box.data) + np.float32([0.0, 0.0, 0.4])
    box.data.normals_split_custom_set(leaning)
    assert box.data.has_custom_normals
    return box


def turned(mesh):
    """The angle between the corners' normals and those of the surface, in degrees."""
    custom = corner_normals(mesh)
    plain = mesh.copy()
    obj = bpy.data.objects.new("Plain", plain)
    bpy.context.collection.objects.link(obj)
    with bpy.context.temp_override(object=obj, active_object=obj, mesh=plain):
        bpy.ops.mesh.customdata_custom_splitnormals_clear()
    cosine = (custom * corner_normals(plain)).sum(axis=1)
    bpy.data.objects.remove(obj)
    bpy.data.meshes.remove(plain)
    return np.degrees(np.arccos(np.clip(cosine, -1, 1)))


@BOTH
def test_normals_keep(with_normals, operator, capfd):
    before = turned(with_normals.data)
    assert operator(mark_sharp=True, sharp_angle=0.0) == {"FINISHED"}
    assert with_normals.data.has_custom_normals
    assert not sharp_edges(with_normals.data).any()
    np.testing.assert_allclose(turned(with_normals.data), before, atol=6.0)
    assert before.max() > 10
    assert "Custom normals were kept, and no edges marked as sharp; choose Recompute" in (
        capfd.readouterr().out
    )


@BOTH
def test_normals_recompute(with_normals, operator, capfd):
    assert operator(custom_normals="RECOMPUTE") == {"FINISHED"}
    assert with_normals.data.has_custom_normals
    assert turned(with_normals.data).max() < 0.5
    assert "Custom normals were kept" not in capfd.readouterr().out


def test_normals_recompute_masked(with_normals):
    right = right_of(with_normals)
    before = turned(with_normals.data)
    with_normals.vertex_groups.new(name="Right").add(np.flatnonzero(right).tolist(), 1, "REPLACE")
    sharpen(custom_normals="RECOMPUTE", vertex_group="Right")
    at_right = right[read_corner_vertices(with_normals.data)]
    after = turned(with_normals.data)
    assert after[at_right].max() < 0.5
    np.testing.assert_allclose(after[~at_right], before[~at_right], atol=6.0)
    assert after[~at_right].max() > 10


def test_normals_free(rounded_box):
    box = rounded_box()
    shade_smooth(box.data)
    layer = box.data.attributes.new("custom_normal", "FLOAT_VECTOR", "CORNER")
    layer.data.foreach_set("vector", np.tile(np.float32([0, 0, 1]), len(box.data.loops)))
    assert turned(box.data).max() > 90
    assert sharpen(custom_normals="RECOMPUTE") == {"FINISHED"}
    assert box.data.has_custom_normals
    assert turned(box.data).max() < 0.5


@BOTH
def test_normals_clear(with_normals, operator):
    other = bpy.data.objects.new("Other", with_normals.data.copy())
    bpy.context.collection.objects.link(other)
    assert operator(custom_normals="CLEAR") == {"FINISHED"}
    assert not with_normals.data.has_custom_normals
    assert other.data.has_custom_normals


def test_normals_at_sharp_edges(with_normals):
    mesh = with_normals.data
    sharpen(custom_normals="RECOMPUTE", mark_sharp=True)
    assert sharp_edges(mesh).any()
    normals, vertices = corner_normals(mesh), read_corner_vertices(mesh)
    ends = edge_vertices(mesh)[sharp_edges(mesh)]
    counts = np.bincount(ends.reshape(-1), minlength=len(mesh.vertices))
    crease = np.flatnonzero(counts == 2)[0]
    around = normals[vertices == crease]
    assert np.degrees(np.arccos(np.clip((around @ around.T).min(), -1, 1))) > 25


@BOTH
def test_mark_sharp(rounded_box, operator):
    box = rounded_box()
    shade_smooth(box.data)
    assert not sharp_edges(box.data).any()
    options = {"time": 256.0} if operator == sharpen else {"then_sharpen": True}
    angle_to_mark = np.radians(45)  # which only the new shape has
    assert operator(mark_sharp=True, sharp_angle=angle_to_mark, **options) == {"FINISHED"}
    sharp = sharp_edges(box.data)
    faces = {}
    for polygon in box.data.polygons:
        for key in polygon.edge_keys:
            faces.setdefault(key, []).append(polygon.normal)
    for edge, mark in zip(box.data.edges, sharp, strict=True):
        one, other = faces[edge.key]
        angle = np.degrees(one.angle(other))
        assert mark == (angle > 45) or abs(angle - 45) < 5  # as the fit leaves it
    assert 0 < sharp.sum() < len(sharp) / 2


def test_mark_sharp_angle(rounded_box):
    counts = []
    for angle in (0.0, 10.0, 30.0, 180.0):
        box = rounded_box()
        sharpen(mark_sharp=True, sharp_angle=np.radians(angle))
        counts.append(sharp_edges(box.data).sum())
    assert counts[0] >= counts[1] >= counts[2] > counts[3] == 0


def test_mark_sharp_keeps(rounded_box):
    box = rounded_box()
    points = np.abs(read_positions(box.data)[edge_vertices(box.data)])
    flat = int(np.flatnonzero((points[:, :, :2] < 0.4).all(axis=(1, 2)))[0])
    box.data.edges[flat].use_edge_sharp = True
    sharpen(mark_sharp=True)
    marks = sharp_edges(box.data)
    assert marks[flat]
    assert marks.sum() > 10
    sharpen()
    np.testing.assert_array_equal(sharp_edges(box.data), marks)


def test_mark_sharp_masked(rounded_box):
    box = rounded_box()
    right = right_of(box)
    box.vertex_groups.new(name="Right").add(np.flatnonzero(right).tolist(), 1.0, "REPLACE")
    sharpen(mark_sharp=True, sharp_angle=0.1, vertex_group="Right")
    sharp = sharp_edges(box.data)
    inside = right[edge_vertices(box.data)].all(axis=1)
    assert sharp[inside].any()
    assert not sharp[~inside].any()


def test_mark_sharp_key(rounded_box):
    box = rounded_box()
    sharpen(output="SHAPE_KEY", mark_sharp=True, sharp_angle=0.1)
    assert box.data.shape_keys is not None
    assert not sharp_edges(box.data).any()


def test_mark_sharp_flat(rounded_box, capfd):
    box = rounded_box()
    sharpen(mark_sharp=True)
    marked = sharp_edges(box.data).sum()
    assert f"marked as sharp: {marked:,}; that shows on smooth" in capfd.readouterr().out
    shade_smooth(box.data)
    sharpen(mark_sharp=True)
    assert "Shade Smooth" not in capfd.readouterr().out


def test_mark_sharp_borders():
    # Two triangles on one edge, a third one on another, and open borders.
    vertices = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 0), (1, 1, 1)]
    faces = [(0, 1, 2), (1, 0, 3), (2, 1, 4), (1, 2, 5)]
    obj = new_mesh(vertices, faces)
    denoise(mark_sharp=True, time=0.0)
    marks = dict(zip([edge.key for edge in obj.data.edges], sharp_edges(obj.data), strict=True))
    assert marks.pop((0, 1))
    assert not any(marks.values())


def test_mark_sharp_no_angle():
    # A flat square, and a face without area on one of its edges.
    vertices = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0.5, 0, 0)]
    obj = new_mesh(vertices, [(0, 1, 2), (0, 2, 3), (1, 0, 4)])
    denoise(mark_sharp=True, sharp_angle=0.0, time=0.0)
    assert not sharp_edges(obj.data).any()


def test_mark_sharp_creases(rounded_box, select):
    box, everywhere = rounded_box(), rounded_box()
    bpy.ops.mesh.primitive_uv_sphere_add(segments=48, ring_count=24)
    ball = bpy.context.object
    assert sharpen() == {"FINISHED"}
    assert not sharp_edges(ball.data).any()
    select(everywhere)
    assert sharpen(where="everywhere") == {"FINISHED"}
    assert not sharp_edges(everywhere.data).any()
    select(box)
    assert sharpen() == {"FINISHED"}
    marked = edge_vertices(box.data)[sharp_edges(box.data)]
    assert len(marked) > 50
    # Near an edge of the box, two coordinates are near their ends.
    points = np.abs(read_positions(box.data))
    near = points > 0.9 * points.max(axis=0)
    assert (near[marked].sum(axis=2) >= 2).all()


def test_edge_data(rounded_box):
    box = rounded_box()
    mesh = box.data
    rng = np.random.default_rng(0)
    layers = {
        "sharp_edge": ("BOOLEAN", "value", rng.random(len(mesh.edges)) < 0.3),
        "uv_seam": ("BOOLEAN", "value", rng.random(len(mesh.edges)) < 0.3),
        "crease_edge": ("FLOAT", "value", rng.random(len(mesh.edges)).astype(np.float32)),
        "bevel_weight_edge": ("FLOAT", "value", rng.random(len(mesh.edges)).astype(np.float32)),
    }
    for name, (kind, key, values) in layers.items():
        mesh.attributes.new(name, kind, "EDGE").data.foreach_set(key, values)
    for operator in (sharpen, denoise):
        operator(mark_sharp=False)
    for name, (_, key, values) in layers.items():
        after = np.empty_like(values)
        mesh.attributes[name].data.foreach_get(key, after)
        np.testing.assert_array_equal(after, values)


def test_other_data(rounded_box):
    box = rounded_box()
    mesh = box.data
    mesh.materials.append(bpy.data.materials.new("One"))
    mesh.materials.append(bpy.data.materials.new("Two"))
    slots = np.arange(len(mesh.polygons), dtype=np.int32) % 2
    mesh.polygons.foreach_set("material_index", slots)
    values = np.arange(len(mesh.vertices), dtype=np.float32)
    mesh.attributes.new("Height", "FLOAT", "POINT").data.foreach_set("value", values)
    box.vertex_groups.new(name="Group").add([1, 2], 0.75, "REPLACE")
    uv = np.empty(2 * len(mesh.loops), dtype=np.float32)
    mesh.uv_layers.active.uv.foreach_get("vector", uv)
    names = {attribute.name for attribute in mesh.attributes}
    for operator in (sharpen, denoise):
        operator(mark_sharp=False)
    after = np.empty_like(uv)
    mesh.uv_layers.active.uv.foreach_get("vector", after)
    np.testing.assert_array_equal(after, uv)
    after = np.empty_like(values)
    mesh.attributes["Height"].data.foreach_get("value", after)
    np.testing.assert_array_equal(after, values)
    assert [polygon.material_index for polygon in mesh.polygons] == slots.tolist()
    assert [material.name for material in mesh.materials] == ["One", "Two"]
    assert box.vertex_groups["Group"].weight(2) == 0.75
    assert {attribute.name for attribute in mesh.attributes} == names


# ------------------------------------------------------------------------- symmetry and modifiers


def half_roof():
    """Half of a rounded ridge with noise, whose border lies on the plane x = 0."""
    vertices, faces = sheet()
    rng = np.random.default_rng(3)
    vertices = vertices + 0.01 * rng.normal(size=vertices.shape)
    vertices[:, 0] = (vertices[:, 0] + 1.0) / 2.0
    border = vertices[:, 0] < 0.03
    vertices[border, 0] = 0.0
    return new_mesh(vertices.tolist(), faces), border


@BOTH
def test_mirror_modifier(operator):
    roof, border = half_roof()
    start = read_positions(roof.data)
    operator()
    assert (read_positions(roof.data)[border, 0] != 0.0).any()
    write_positions(roof.data, start)
    mirror = roof.modifiers.new("Mirror", "MIRROR")
    operator()
    after = read_positions(roof.data)
    assert (after[border, 0] == 0.0).all()
    assert (after[border] != start[border]).any()
    assert (after[~border, 0] != start[~border, 0]).any()
    write_positions(roof.data, start)
    mirror.use_mirror_merge = False
    operator()
    assert (read_positions(roof.data)[border, 0] != 0.0).any()


def test_mirror_object():
    roof, border = half_roof()
    shift = Matrix.Translation((3, 0, 0)) @ Matrix.Rotation(0.3, 4, "Y")
    roof.data.transform(shift)
    target = bpy.data.objects.new("Center", None)
    bpy.context.collection.objects.link(target)
    target.matrix_world = Matrix.Translation((2, 1, 0)) @ Matrix.Rotation(0.5, 4, "Z")
    roof.matrix_world = target.matrix_world @ shift.inverted()
    modifier = roof.modifiers.new("Mirror", "MIRROR")
    modifier.mirror_object = target
    bpy.context.view_layer.update()
    start = read_positions(roof.data)
    sharpen()
    after = read_positions(roof.data)
    across = np.array(shift.inverted())[0]
    assert np.abs(after[border] @ across[:3] + across[3]).max() < 1e-6
    assert (after[border] != start[border]).any()


def test_mirror_threshold():
    plane = MirrorPlane(np.array([2.0, 0.0, 0.0]), -2.0, 0.1)
    points = np.array([[1.0, 0, 0], [1.04, 0, 0], [1.06, 0, 0], [-1.0, 0, 0]])
    moves = np.ones((4, 3))
    held = plane.hold(moves, points)
    np.testing.assert_array_equal(held, [[0, 1, 1], [0, 1, 1], [1, 1, 1], [1, 1, 1]])
    np.testing.assert_array_equal(moves, np.ones((4, 3)))


def test_modifiers(rounded_box, capfd):
    box = rounded_box()
    before = read_positions(box.data)
    tree = bpy.data.node_groups.new("Nodes", "GeometryNodeTree")
    box.modifiers.new("Subdivision", "SUBSURF")
    box.modifiers.new("Nodes", "NODES").node_group = tree
    box.modifiers.new("Armature", "ARMATURE").object = bpy.data.objects.new("Bones", None)
    assert sharpen() == {"FINISHED"}
    assert moved(box, before).any()
    assert [each.type for each in box.modifiers] == ["SUBSURF", "NODES", "ARMATURE"]
    assert "Modifiers were left in place and act on the new shape." in capfd.readouterr().out


# ---------------------------------------------------------------------------------------- objects


def test_several_objects(rounded_box, select, capfd):
    boxes = [rounded_box(), rounded_box()]
    empty = [bpy.data.objects.new(f"Empty {k}", bpy.data.meshes.new("None")) for k in range(5)]
    for obj in empty:
        bpy.context.collection.objects.link(obj)
    bpy.ops.object.text_add()
    text = bpy.context.object
    bpy.ops.object.camera_add()
    select(*boxes, *empty, text, bpy.context.object)
    assert sharpen() == {"FINISHED"}
    out = [line for line in capfd.readouterr().out.splitlines() if "Sharpened" in line]
    assert len(out) == 1
    assert re.search(r"Sharpened 2 meshes: [\d,]+ vertices, moved [\d,]+, .* s\.", out[0])
    assert "Skipped Text: it is no mesh; convert it first (Object > Convert > Mesh)." in out[0]
    assert (
        "Skipped 5 objects (Empty 0, Empty 1, Empty 2 and 2 more), each because it has no faces;"
        in out[0]
    )
    assert "Camera" not in out[0]
    assert operators.summaries["geometry"].replace("\n", " ") in out[0]


@pytest.mark.parametrize(
    "add",
    [
        lambda: bpy.ops.curve.primitive_bezier_circle_add(),
        lambda: bpy.ops.object.text_add(),
        lambda: bpy.ops.object.metaball_add(),
        lambda: bpy.ops.surface.primitive_nurbs_surface_sphere_add(),
    ],
    ids=["curve", "text", "metaball", "surface"],
)
def test_no_mesh(rounded_box, select, capfd, add):
    box = rounded_box()
    add()
    other = bpy.context.object
    with pytest.raises(RuntimeError, match=r"Convert the object to a mesh|Select a mesh"):
        sharpen()
    select(box, other)
    assert sharpen() == {"FINISHED"}
    assert f"Skipped {other.name}: it is no mesh; convert it first" in capfd.readouterr().out


def test_instances(rounded_box, select, capfd):
    box = rounded_box()
    source = rounded_box()
    collection = bpy.data.collections.new("Parts")
    collection.objects.link(source)
    bpy.ops.object.collection_instance_add(collection="Parts")
    instance, before = bpy.context.object, read_positions(source.data)
    select(box, instance)
    assert sharpen() == {"FINISHED"}
    assert "it shows instances of a collection; make them real" in capfd.readouterr().out
    assert not moved(source, before).any()


def test_ignored_objects(rounded_box, select, capfd):
    box = rounded_box()
    bpy.ops.object.light_add()
    light = bpy.context.object
    bpy.ops.object.empty_add()
    select(box, light, bpy.context.object)
    assert sharpen() == {"FINISHED"}
    assert "Skipped" not in capfd.readouterr().out


def test_overrides(rounded_box, select, tmp_path):
    rounded_box().name = "Source"
    library = str(tmp_path / "library.blend")
    bpy.data.libraries.write(library, {bpy.data.objects["Source"]})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.objects = ["Source"]
    linked = wanted.objects[0]
    bpy.context.collection.objects.link(linked)
    override = linked.override_create(remap_local_usages=True)
    select(override)
    with pytest.raises(RuntimeError, match="its mesh is linked from another file; make it local"):
        sharpen()
    override.data.override_create(remap_local_usages=True)
    assert override.data.override_library is not None
    with pytest.raises(RuntimeError, match=r"its mesh is a library override, .* make it local"):
        sharpen()
    bpy.ops.object.make_local(type="SELECT_OBDATA")  # what the reason says
    assert sharpen() == {"FINISHED"}


def test_hidden_objects(rounded_box, select):
    box, hidden = rounded_box(), rounded_box()
    select(box, hidden)
    hidden.hide_set(True)
    before = read_positions(hidden.data)
    assert sharpen() == {"FINISHED"}
    assert not moved(hidden, before).any()


def test_locked_objects(rounded_box):
    box = rounded_box()
    box.lock_location = box.lock_rotation = box.lock_scale = (True, True, True)
    before = read_positions(box.data)
    assert sharpen() == {"FINISHED"}
    assert moved(box, before).any()


def test_unselectable_objects(rounded_box):
    box, locked = rounded_box(), rounded_box()
    locked.hide_select = True
    before = read_positions(locked.data)
    with pytest.raises(RuntimeError, match="Select a mesh object"):
        sharpen()
    box.select_set(True)
    assert sharpen() == {"FINISHED"}
    assert not moved(locked, before).any()


def test_other_mode(rounded_box, capfd):
    bpy.context.scene.tool_settings.lock_object_mode = False
    box, sculpted = rounded_box(), rounded_box()
    box.select_set(True)
    bpy.ops.object.mode_set(mode="SCULPT")
    bpy.context.view_layer.objects.active = box
    assert (bpy.context.mode, sculpted.mode) == ("OBJECT", "SCULPT")
    before = read_positions(sculpted.data)
    assert sharpen() == {"FINISHED"}
    out = capfd.readouterr().out
    assert f"Skipped {sculpted.name}: it is in Sculpt Mode; switch it to Object Mode first." in out
    assert (read_positions(sculpted.data) == before).all()
    bpy.context.view_layer.objects.active = sculpted
    bpy.ops.object.mode_set(mode="OBJECT")


def test_other_mode_shared(rounded_box, select):
    bpy.context.scene.tool_settings.lock_object_mode = False
    box = rounded_box()
    twin = bpy.data.objects.new("Twin", box.data)
    bpy.context.collection.objects.link(twin)
    bpy.ops.object.mode_set(mode="EDIT")
    twin.select_set(True)
    bpy.context.view_layer.objects.active = twin
    box.select_set(False)
    assert (bpy.context.mode, twin.mode, box.mode) == ("OBJECT", "OBJECT", "EDIT")
    with pytest.raises(RuntimeError, match="another object with its mesh is in Edit Mode; switch"):
        sharpen()
    bpy.context.view_layer.objects.active = box
    bpy.ops.object.mode_set(mode="OBJECT")


def test_scale_mirrored(rounded_box, select):
    plain, mirrored = rounded_box(), rounded_box()
    mirrored.scale = (-1.0, 1.0, 1.0)
    bpy.context.view_layer.update()
    select(plain, mirrored)
    sharpen()
    np.testing.assert_allclose(read_positions(mirrored.data), read_positions(plain.data), atol=1e-6)


def test_scale_of_parent(rounded_box, select):
    child, plain = rounded_box(), rounded_box()
    parent = bpy.data.objects.new("Parent", None)
    bpy.context.collection.objects.link(parent)
    parent.scale = (1.0, 3.0, 0.5)
    child.parent = parent
    plain.scale = (1.0, 3.0, 0.5)
    bpy.context.view_layer.update()
    select(child, plain)
    sharpen(feature_threshold=0.0)
    np.testing.assert_allclose(read_positions(child.data), read_positions(plain.data), atol=1e-6)


def test_far_away(rounded_box):
    near, far = rounded_box(), rounded_box(location=(1e6, 0.0, 0.0))
    start = read_positions(near.data)
    bpy.ops.object.select_all(action="SELECT")
    sharpen()
    np.testing.assert_array_equal(read_positions(far.data), read_positions(near.data))
    offset = np.float32([4096.0, 0.0, 0.0])
    write_positions(far.data, start + offset)
    rounded = read_positions(far.data) - offset
    sharpen()
    moves = read_positions(near.data) - start
    assert np.isfinite(read_positions(far.data)).all()
    assert np.abs(read_positions(far.data) - offset - rounded).max() < 3 * np.abs(moves).max()


# ----------------------------------------------------------------------------------------- meshes


@BOTH
def test_empty_mesh(operator):
    new_mesh([], [])
    with pytest.raises(RuntimeError, match="Skipped Mesh: it has no faces; add some"):
        operator()


@BOTH
def test_non_manifold(operator):
    vertices, faces = sheet()
    wall = (np.array([[0, -1, 1], [0, 0, 1]]) + 0.0).tolist()
    count = len(vertices)
    fin = [(78, 91, count + 1, count)]  # a third face on an inner edge
    obj = new_mesh(vertices.tolist() + wall, faces + fin)
    before = read_positions(obj.data)
    assert operator() == {"FINISHED"}
    after = read_positions(obj.data)
    assert np.isfinite(after).all()
    assert (after != before).any()


@BOTH
def test_winding(operator):
    vertices, faces = sheet()
    mixed = [face[::-1] if k % 5 == 0 else face for k, face in enumerate(faces)]
    results = []
    for each in (faces, mixed):
        obj = new_mesh(vertices.tolist(), each)
        assert operator(mark_sharp=True) == {"FINISHED"}
        results.append(read_positions(obj.data))
    assert (results[0] != vertices.astype(np.float32)).any()
    np.testing.assert_allclose(results[1], results[0], atol=0.01)
    assert [list(polygon.vertices) for polygon in obj.data.polygons] == mixed
    assert sharp_edges(obj.data).sum() > 10


@BOTH
def test_zero_area(operator):
    vertices, faces = sheet()
    vertices[40] = vertices[41]
    vertices[54] = vertices[41]
    obj = new_mesh(vertices.tolist(), faces)
    before = read_positions(obj.data)
    assert operator(mark_sharp=True) == {"FINISHED"}
    after = read_positions(obj.data)
    assert np.isfinite(after).all()
    assert (after != before).any()


@BOTH
def test_no_area(operator):
    obj = new_mesh([(0, 0, 0), (1, 0, 0), (2, 0, 0)], [(0, 1, 2)])
    before = read_positions(obj.data)
    try:
        operator()
    except RuntimeError as error:
        assert "Skipped Mesh: " in str(error)
    np.testing.assert_array_equal(read_positions(obj.data), before)


# ------------------------------------------------------------------------------------------ colors


def test_color_alpha(painted_sheet):
    obj = painted_sheet("BYTE_COLOR", opacity=0.25)
    data = obj.data.color_attributes["Paint"].data
    before = np.empty(4 * len(data), dtype=np.float32)
    data.foreach_get("color_srgb", before)
    assert sharpen_colors(time=256.0) == {"FINISHED"}
    after = np.empty_like(before)
    data.foreach_get("color_srgb", after)
    assert (after != before).any()
    np.testing.assert_array_equal(after.reshape(-1, 4)[:, 3], before.reshape(-1, 4)[:, 3])


# ---------------------------------------------------------------------------------------- textures


def textured_roof(select, mirrored=False):
    """A roof whose material shows an image with a soft edge."""
    vertices, faces = sheet(cells=4)
    obj = new_mesh(vertices.tolist(), faces)
    uv = obj.data.uv_layers.new(name="Layout").uv
    for corner, vertex in enumerate(read_corner_vertices(obj.data)):
        u, v = 0.1 + 0.4 * (vertices[vertex, :2] + 1.0)
        uv[corner].vector = (1.0 - u if mirrored else u), v
    image = bpy.data.images.new("Wood", 32, 32)
    place = (np.arange(32) + 0.5) / 32
    step = 0.5 + 0.4 * np.tanh((place - 0.4) / 0.1)
    step = step[::-1] if mirrored else step
    pixels = np.ones((32, 32, 4), dtype=np.float32)
    pixels[..., :3] = step[None, :, None]
    image.pixels.foreach_set(pixels.reshape(-1))
    material = bpy.data.materials.new("Paint")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    material.node_tree.nodes.new("ShaderNodeTexImage").image = image
    obj.data.materials.append(material)
    select(obj)
    return obj, image


def pixels_of(image):
    flat = np.empty(len(image.pixels), dtype=np.float32)
    image.pixels.foreach_get(flat)
    return flat.reshape(image.size[1], image.size[0], 4)


def test_uv_none(select, rounded_box, capfd):
    roof, image = textured_roof(select)
    bare = rounded_box()
    bare.data.uv_layers.remove(bare.data.uv_layers[0])
    bare.data.materials.append(roof.active_material)
    select(roof, bare)
    assert bpy.ops.shock_filter.sharpen_texture(time=64.0) == {"FINISHED"}
    out = capfd.readouterr().out
    assert f"Skipped {bare.name}: it has no UV map; unwrap it in Edit Mode (UV > Unwrap)." in out
    select(bare)
    with pytest.raises(RuntimeError, match="Unwrap the mesh in Edit Mode"):
        bpy.ops.shock_filter.sharpen_texture(image=image.name)


def test_uv_mirrored(select):
    results = []
    for mirrored in (False, True):
        _, image = textured_roof(select, mirrored)
        before = pixels_of(image)
        assert bpy.ops.shock_filter.sharpen_texture(time=1e4, output="REPLACE") == {"FINISHED"}
        after = pixels_of(image)
        assert np.abs(after - before).max() > 0.05
        results.append(after[:, ::-1] if mirrored else after)
    np.testing.assert_allclose(results[0][8:-8, 8:-8], results[1][8:-8, 8:-8], atol=2 / 255)


def test_texture_dyntopo(select):
    _, image = textured_roof(select)
    before = pixels_of(image)
    bpy.ops.object.mode_set(mode="SCULPT")
    bpy.ops.sculpt.dynamic_topology_toggle()
    with pytest.raises(RuntimeError, match="Skipped Wood: dynamic topology is on; turn Dyntopo"):
        bpy.ops.shock_filter.sharpen_texture(output="REPLACE")
    assert bpy.context.object.use_dynamic_topology_sculpting
    np.testing.assert_array_equal(pixels_of(image), before)
