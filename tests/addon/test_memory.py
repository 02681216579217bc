# SPDX-License-Identifier: GPL-3.0-or-later
"""Many runs of the operators leave no memory behind, with undo and without."""

import gc

import bpy
import pytest
from memory import assert_flat
from shock_filter.core.host.geometry import Reshaped
from shock_filter.core.host.recolored import Recolored
from shock_filter.core.host.textures import Retextured
from shock_filter.shock_addon.data.image.images import ImageTarget
from shock_filter.shock_addon.data.image.textures import TextureTarget
from shock_filter.shock_addon.data.mesh.targets import MeshTarget

OF_A_RUN = MeshTarget, ImageTarget, TextureTarget, Reshaped, Recolored, Retextured


@pytest.mark.parametrize("undo", [False, pytest.param(True, marks=pytest.mark.slow)])
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


def test_the_history_of_operators_holds_none_of_their_runs(rounded_box):
    """Blender keeps the last operators, with all that they keep, for Repeat Last."""
    obj = rounded_box(cuts=3)
    colors = obj.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    obj.data.color_attributes.active_color = colors
    image = bpy.data.images.new("Around", 16, 16)
    held = of_runs()  # what other tests keep in this process
    before = {id(kept) for kept in held}
    run = bpy.ops.shock_filter
    run.sharpen_geometry("EXEC_DEFAULT", True)
    run.sharpen_colors("EXEC_DEFAULT", True)
    run.denoise("EXEC_DEFAULT", True, target="both", repeat=1, iterations=1)
    run.sharpen_image("EXEC_DEFAULT", True, image=image.name)
    run.denoise_image("EXEC_DEFAULT", True, image=image.name)
    run.sharpen_texture("EXEC_DEFAULT", True, image=image.name)
    assert len(bpy.context.window_manager.operators) >= 6
    assert [type(kept) for kept in of_runs() if id(kept) not in before] == []


def of_runs():
    """Return all objects of runs that are still held."""
    gc.collect()
    # isinstance() would ask what a weak proxy stands for, which may be gone.
    return [kept for kept in gc.get_objects() if issubclass(type(kept), OF_A_RUN)]
