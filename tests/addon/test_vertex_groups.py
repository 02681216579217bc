# SPDX-License-Identifier: GPL-3.0-or-later
"""Reading the weights of vertex groups."""

import bpy
import numpy as np
import pytest
from shock_filter.shock_addon.data.mesh.vertex_groups import group_weights
from shock_filter.shock_addon.data.skipped import Skipped

KINDS = ("objects", "meshes", "scenes", "node_groups", "shape_keys", "actions")


@pytest.fixture
def weighted(rounded_box):
    """A box with two groups that overlap, and the weights of the second one."""
    box = rounded_box()
    count = len(box.data.vertices)
    box.vertex_groups.new(name="Other").add(range(0, count, 2), 0.5, "REPLACE")
    group = box.vertex_groups.new(name="Mask")
    weights = np.zeros(count)
    for level in range(1, 8):
        members = np.arange(level, count, 11)
        group.add(members.tolist(), level / 7, "REPLACE")
        weights[members] = np.float32(level / 7)
    return box, weights


def counts():
    return {kind: len(getattr(bpy.data, kind)) for kind in KINDS}


def test_weights_are_exact_and_nothing_is_left_behind(weighted):
    box, weights = weighted
    before = counts()
    np.testing.assert_array_equal(group_weights(box, "Mask"), weights)
    assert counts() == before
    assert [group.name for group in box.vertex_groups] == ["Other", "Mask"]
    assert not box.modifiers


def test_shape_keys_with_drivers_do_not_count(weighted):
    box, weights = weighted
    box.shape_key_add(name="Basis")
    box.shape_key_add(name="Key").driver_add("value").driver.expression = "1.0"
    before = counts()
    np.testing.assert_array_equal(group_weights(box, "Mask"), weights)
    assert counts() == before
    assert box.data.shape_keys.animation_data is not None


def test_an_empty_group_has_no_weights(rounded_box):
    box = rounded_box()
    box.vertex_groups.new(name="Mask")
    assert not group_weights(box, "Mask").any()


def test_linked_meshes_can_be_read(weighted, tmp_path):
    box, weights = weighted
    library = str(tmp_path / "library.blend")
    box.name = "Source"
    bpy.data.libraries.write(library, {box})
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(library, link=True) as (_, wanted):
        wanted.objects = ["Source"]
    np.testing.assert_array_equal(group_weights(wanted.objects[0], "Mask"), weights)


def test_a_group_may_have_the_name_that_reading_uses(weighted):
    box, weights = weighted
    box.vertex_groups["Other"].name = "shock_filter group"
    np.testing.assert_array_equal(group_weights(box, "Mask"), weights)
    assert group_weights(box, "shock_filter group").max() == 0.5


def test_a_missing_group_is_named(rounded_box):
    with pytest.raises(Skipped, match="no vertex group named 'Mask'; add it"):
        group_weights(rounded_box(), "Mask")
