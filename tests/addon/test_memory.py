# SPDX-License-Identifier: GPL-3.0-or-later
"""Many runs of the operators leave no memory behind, with undo and without."""

import bpy
import pytest
from memory import assert_flat


@pytest.mark.parametrize("undo", [False, True])
def test_memory_stays_flat(rounded_box, undo):
    preferences = bpy.context.preferences.edit
    kept = preferences.use_global_undo, preferences.undo_steps
    preferences.use_global_undo = undo
    preferences.undo_steps = 4
    obj = rounded_box(cuts=31)
    image = bpy.data.images.new("Around", 64, 64)
    colors = obj.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    obj.data.color_attributes.active_color = colors

    def run():
        bpy.ops.shock_filter.sharpen_geometry(time=4.0)
        bpy.ops.shock_filter.sharpen_colors(time=4.0)
        bpy.ops.shock_filter.sharpen_image(image=image.name, time=4.0, output="REPLACE")
        bpy.ops.shock_filter.denoise(repeat=1, iterations=1)
        if undo:
            bpy.ops.ed.undo_push(message="Run")

    try:
        if undo:
            bpy.ops.ed.undo_push(message="Start")
        assert_flat(run)
    finally:
        preferences.use_global_undo, preferences.undo_steps = kept
