# SPDX-License-Identifier: GPL-3.0-or-later
"""Meshes with shape keys, and the result as a new one."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.mesh import shape_keys
from shock_filter.shock_addon.data.mesh.meshes import read_positions, write_positions

sharpen = bpy.ops.shock_filter.sharpen_geometry


def seen(obj):
    """The positions that Blender shows."""
    evaluated = obj.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return read_positions(evaluated.data)


def keys_of(obj):
    return {key.name: shape_keys.read(key) for key in obj.data.shape_keys.key_blocks}


@pytest.fixture
def sharpened(rounded_box, select):
    """Return a function: what the operator makes of a plain box at these positions."""

    def of(positions):
        active = bpy.context.object
        plain = rounded_box()
        write_positions(plain.data, positions)
        sharpen()
        result = read_positions(plain.data)
        select(active)
        return result

    return of


@pytest.fixture
def keyed(rounded_box):
    """A box with a Basis and a key that lifts it."""
    box = rounded_box()
    box.shape_key_add(name="Basis", from_mix=False)
    lifted = box.shape_key_add(name="Lifted", from_mix=False)
    shape_keys.write(lifted, shape_keys.read(lifted) + np.float32([0, 0, 1]))
    lifted.value = 0.0  # Blender versions differ
    return box


def test_a_new_key_holds_the_result_and_the_mesh_stays(rounded_box, sharpened):
    box = rounded_box()
    before = read_positions(box.data)
    assert sharpen(output="SHAPE_KEY") == {"FINISHED"}
    assert [key.name for key in box.data.shape_keys.key_blocks] == ["Basis", "Sharpened"]
    assert box.active_shape_key.name == "Sharpened"
    assert box.active_shape_key.value == 1.0
    keys = keys_of(box)
    np.testing.assert_array_equal(keys["Basis"], before)
    expected = sharpened(before)
    np.testing.assert_allclose(keys["Sharpened"], expected, atol=1e-6)
    np.testing.assert_array_equal(read_positions(box.data), before)
    np.testing.assert_allclose(seen(box), expected, atol=1e-6)
    box.active_shape_key.value = 0.0
    np.testing.assert_allclose(seen(box), before, atol=1e-7)


def test_no_key_is_added_where_nothing_has_changed(rounded_box, capfd):
    box = rounded_box()
    sharpen(output="SHAPE_KEY", where="everywhere", time=0.0)
    assert box.data.shape_keys is None
    assert "Nothing has changed, so no shape key was added." in capfd.readouterr().out


@pytest.mark.parametrize("is_pinned", [False, True])
def test_a_muted_key_that_has_changed_is_named(keyed, capfd, is_pinned):
    keyed.active_shape_key_index = 1
    keyed.active_shape_key.mute = True
    keyed.show_only_shape_key = is_pinned
    before = seen(keyed)
    sharpen()
    np.testing.assert_array_equal(seen(keyed), before)
    assert "The shape key Lifted is muted; unmute it to see" in capfd.readouterr().out


def test_a_new_key_sharpens_what_is_seen(keyed, sharpened):
    keyed.data.shape_keys.key_blocks["Lifted"].value = 0.5
    before, shown = keys_of(keyed), shape_keys.visible_shape(keyed, "OBJECT")
    sharpen(output="SHAPE_KEY")
    after = keys_of(keyed)
    for name in before:
        np.testing.assert_array_equal(after[name], before[name])
    np.testing.assert_allclose(seen(keyed), sharpened(shown), atol=1e-6)


def test_the_mix_is_the_one_that_blender_shows(keyed):
    keys = keyed.data.shape_keys.key_blocks
    keyed.vertex_groups.new(name="Some").add(range(0, 100), 0.25, "REPLACE")
    keys["Lifted"].value = 0.75
    keys["Lifted"].vertex_group = "Some"
    other = keyed.shape_key_add(name="Other", from_mix=False)
    shape_keys.write(other, 2 * shape_keys.read(other))
    other.value = 0.5
    other.relative_key = keys["Lifted"]
    muted = keyed.shape_key_add(name="Muted", from_mix=False)
    shape_keys.write(muted, 0 * shape_keys.read(muted))
    muted.value, muted.mute = 1.0, True
    np.testing.assert_allclose(shape_keys.visible_shape(keyed, "OBJECT"), seen(keyed), atol=1e-6)


def test_the_active_key_is_sharpened(keyed, sharpened):
    keyed.active_shape_key_index = 1
    before = keys_of(keyed)
    sharpen()
    after = keys_of(keyed)
    np.testing.assert_array_equal(after["Basis"], before["Basis"])
    np.testing.assert_array_equal(after["Lifted"], sharpened(before["Lifted"]))
    np.testing.assert_array_equal(read_positions(keyed.data), before["Basis"])
    keyed.active_shape_key.value = 1.0
    np.testing.assert_allclose(seen(keyed), after["Lifted"], atol=1e-6)


def test_keys_move_along_with_the_basis(keyed, sharpened):
    keyed.active_shape_key_index = 0
    expected = sharpened(read_positions(keyed.data))
    sharpen()
    after = keys_of(keyed)
    np.testing.assert_array_equal(after["Basis"], expected)
    np.testing.assert_allclose(after["Lifted"], expected + np.float32([0, 0, 1]), atol=1e-6)
    np.testing.assert_array_equal(read_positions(keyed.data), expected)
    np.testing.assert_array_equal(seen(keyed), expected)


def test_keys_move_along_with_those_that_they_rest_on(keyed, sharpened):
    """Over several steps, but not with one that rests on the other."""
    for name, base in (("Second", "Lifted"), ("Third", "Second"), ("Apart", "Basis")):
        key = keyed.shape_key_add(name=name, from_mix=False)
        key.relative_key = keyed.data.shape_keys.key_blocks[base]
    keyed.active_shape_key_index = 1
    before = keys_of(keyed)
    change = sharpened(before["Lifted"]) - before["Lifted"]
    assert (change != 0).any()
    sharpen()
    after = keys_of(keyed)
    for name in ("Lifted", "Second", "Third"):
        np.testing.assert_allclose(after[name], before[name] + change, atol=1e-6)
    for name in ("Basis", "Apart"):
        np.testing.assert_array_equal(after[name], before[name])


def test_edit_mode_writes_the_active_key(keyed):
    keyed.active_shape_key_index = 1
    before = keys_of(keyed)
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    assert sharpen() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    after = keys_of(keyed)
    np.testing.assert_array_equal(after["Basis"], before["Basis"])
    assert (after["Lifted"] != before["Lifted"]).any()


def test_a_locked_key_is_named(keyed):
    keyed.active_shape_key_index = 1
    keyed.active_shape_key.lock_shape = True
    with pytest.raises(RuntimeError, match="shape key 'Lifted' is locked"):
        sharpen()
    assert sharpen(output="SHAPE_KEY") == {"FINISHED"}


def test_absolute_keys_are_named(keyed):
    keyed.data.shape_keys.use_relative = False
    with pytest.raises(RuntimeError, match="shape keys are absolute"):
        sharpen(output="SHAPE_KEY")
    keyed.active_shape_key_index = 1
    before = keys_of(keyed)
    assert sharpen() == {"FINISHED"}
    after = keys_of(keyed)
    np.testing.assert_array_equal(after["Basis"], before["Basis"])
    assert (after["Lifted"] != before["Lifted"]).any()
