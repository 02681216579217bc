# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that a newer version has written."""

import bpy
from shock_filter.shock_addon.modes import choices


def kept(group):
    """Return what Blender keeps of a group's properties; since 5.0 apart from custom ones."""
    return group.bl_system_properties_get() if hasattr(group, "bl_system_properties_get") else group


def choices_of(group):
    rows = [row for row in group.bl_rna.properties if row.type == "ENUM" and not row.is_skip_save]
    return [row for row in rows if not row.is_enum_flag]


def test_choices_that_are_not_known_are_set_back(rounded_box, tmp_path):
    rounded_box()
    scene = bpy.context.scene.copy()
    scene.name, scene.use_fake_user = "Other", True
    for each in bpy.data.scenes:
        settings = each.shock_filter
        for group in (settings, *(getattr(settings, mode.key) for mode in choices())):
            for row in choices_of(group):
                if row.identifier != "custom_normals":
                    setattr(group, row.identifier, row.default)  # so that it is kept
                    kept(group)[row.identifier] = 99
        settings.geometry.custom_normals = "CLEAR"
    path = str(tmp_path / "newer.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path)
    bpy.ops.wm.open_mainfile(filepath=path)
    assert len(bpy.data.scenes) == 2
    for each in bpy.data.scenes:
        settings = each.shock_filter
        for group in (settings, *(getattr(settings, mode.key) for mode in choices())):
            wanted = {row.identifier: row.default for row in choices_of(group)}
            if group == settings.geometry:
                wanted["custom_normals"] = "CLEAR"
            assert {name: getattr(group, name) for name in wanted} == wanted
    assert bpy.ops.shock_filter.sharpen_geometry() == {"FINISHED"}
