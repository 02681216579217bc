# SPDX-License-Identifier: GPL-3.0-or-later
"""Colors with the output Live: a difference in attributes, and nodes that add it."""

import itertools
from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
import shock_filter
from shock_filter.shock_addon.data import DIFFERENCE, LIVE_COLORS, arrays
from shock_filter.shock_addon.data.chosen import live_modifier, live_modifiers
from shock_filter.shock_addon.data.live import graph, stacks
from shock_filter.shock_addon.data.mesh.meshes import read_positions
from shock_filter.shock_addon.live import updating

sharpen = bpy.ops.shock_filter.sharpen_colors
live = shock_filter.live
KINDS = list(itertools.product(("BYTE_COLOR", "FLOAT_COLOR"), ("POINT", "CORNER")))
TIMES = {"time": 16.0}


@pytest.fixture
def painted(rounded_box):
    """Return a function that adds a box with a soft border between two colors."""

    def add(data_type="BYTE_COLOR", domain="POINT", **settings):
        box = rounded_box(**settings)
        colors = box.data.color_attributes.new("Paint", data_type, domain)
        places = read_positions(box.data)
        if domain == "CORNER":
            places = places[arrays.read(box.data.loops, "vertex_index", dtype=np.int32)]
        red = 0.5 + 0.4 * np.tanh(2.0 * places[:, 0] + places[:, 1])
        values = np.stack([red, 0.3 + 0 * red, 1 - red, 0.5 + 0.4 * red], axis=1)
        arrays.write_attribute(colors, values)
        box.data.color_attributes.active_color = colors
        return box

    return add


def stored(mesh):
    return arrays.read_attribute(mesh.color_attributes["Paint"])


def seen(obj):
    bpy.context.view_layer.update()
    return stored(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


def amount(obj, value):
    stacks.write_input(live_modifier(obj, LIVE_COLORS), graph.AMOUNT, value)


def written(obj):
    """Return the colors before and after the output Mesh, and put them back."""
    before = stored(obj.data)
    sharpen(output="MESH", **TIMES)
    after = stored(obj.data)
    arrays.write_attribute(obj.data.color_attributes["Paint"], before)
    obj.data.update()
    return before, after


@pytest.mark.parametrize(("data_type", "domain"), KINDS)
def test_amounts_go_from_the_colors_to_the_result(painted, data_type, domain):
    box = painted(data_type, domain)
    before, after = written(box)
    assert (after != before).any()
    assert sharpen(output="LIVE", **TIMES) == {"FINISHED"}
    np.testing.assert_array_equal(stored(box.data), before)
    shown = box.evaluated_get(bpy.context.evaluated_depsgraph_get()).data.color_attributes["Paint"]
    assert (shown.data_type, shown.domain) == (data_type, domain)
    rounding = 0 if data_type == "BYTE_COLOR" else 1e-7
    np.testing.assert_allclose(seen(box), after, rtol=0, atol=rounding)
    amount(box, 0.0)
    np.testing.assert_array_equal(seen(box), before)
    amount(box, 0.5)
    half = seen(box)
    assert (half != before).any() and (half != after).any()
    low, high = np.minimum(before, after), np.maximum(before, after)
    assert (half >= low - rounding).all() and (half <= high + rounding).all()
    np.testing.assert_array_equal(half[:, 3], before[:, 3])


def test_masks_say_where(painted):
    box = painted()
    before, after = written(box)
    sharpen(output="LIVE", **TIMES)
    bpy.ops.shock_filter.paint_live()
    bpy.ops.object.mode_set(mode="OBJECT")
    np.testing.assert_array_equal(seen(box), after)
    top = read_positions(box.data)[:, 2] > 0
    box.vertex_groups.active.add(np.flatnonzero(~top).tolist(), 0.0, "REPLACE")
    np.testing.assert_array_equal(seen(box)[top], after[top])
    np.testing.assert_array_equal(seen(box)[~top], before[~top])


def test_pressing_again_starts_from_the_colors_and_other_outputs_end_it(painted):
    box = painted()
    _, after = written(box)
    for output in ("LIVE", "AUTO", "LIVE"):
        sharpen(output=output, **TIMES)
        assert len(box.modifiers) == 1 and live.state(box) == "fresh"
        np.testing.assert_array_equal(seen(box), after)
    sharpen(output="MESH", **TIMES)
    assert DIFFERENCE not in box.data.attributes and live.state(box) == ""
    np.testing.assert_array_equal(stored(box.data), after)
    np.testing.assert_array_equal(seen(box), after)


def test_auto_replaces_colors_that_are_not_live_whatever_is_on_top(painted):
    box = painted()
    _, after = written(box)
    box.modifiers.new("Remesh", "REMESH").mode = "VOXEL"
    sharpen(**TIMES)
    assert bpy.context.object == box and len(box.modifiers) == 1
    np.testing.assert_array_equal(stored(box.data), after)


def test_paint_that_changes_keeps_the_difference_until_an_update(painted):
    box = painted("FLOAT_COLOR")
    sharpen(output="LIVE", **TIMES)
    difference = seen(box) - stored(box.data)
    brighter = stored(box.data) + np.float32([0.1, 0.1, 0.1, 0.0])
    arrays.write_attribute(box.data.color_attributes["Paint"], brighter)
    box.data.update()
    assert live.state(box) == "moved"
    np.testing.assert_allclose(seen(box), brighter + difference, rtol=0, atol=1e-6)
    live.update(box)
    assert live.state(box) == "fresh"


def subdivided(obj):
    bm = bmesh.new()
    bm.from_mesh(obj.data)
    bmesh.ops.subdivide_edges(bm, edges=list(bm.edges)[:4], cuts=1)
    bm.to_mesh(obj.data)
    bm.free()
    obj.data.update()


def removed(obj):
    obj.data.attributes.remove(obj.data.attributes["Paint"])


@pytest.mark.parametrize("edit", [subdivided, removed])
def test_stale_colors_are_not_shown(painted, edit):
    box = painted()
    sharpen(output="LIVE", **TIMES)
    edit(box)
    assert live.state(box) == "stale"
    if edit is subdivided:
        np.testing.assert_array_equal(seen(box), stored(box.data))
        live.update(box)
        assert live.state(box) == "fresh" and (seen(box) != stored(box.data)).any()
    else:
        bpy.context.view_layer.update()
        shown = box.evaluated_get(bpy.context.evaluated_depsgraph_get()).data
        assert "Paint" not in shown.attributes
        with pytest.raises(RuntimeError, match="color attribute"):
            live.update(box)


def test_shape_and_colors_are_live_beside_each_other(painted):
    box = painted()
    before, after = written(box)
    positions = read_positions(box.data)
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    sharpen(output="LIVE", **TIMES)
    assert len(live_modifiers(box)) == 2
    np.testing.assert_array_equal(seen(box), after)
    graph_of = bpy.context.evaluated_depsgraph_get()
    assert (read_positions(box.evaluated_get(graph_of).data) != positions).any()
    amount(box, 0.0)
    np.testing.assert_array_equal(seen(box), before)
    subdivided(box)
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    amount(box, 1.0)
    assert live.state(box) == "stale"  # the colors are, although the shape is not
    np.testing.assert_array_equal(seen(box), stored(box.data))
    live.update(box)
    assert live.state(box) == "fresh"


def both_live(painted):
    box = painted()
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    sharpen(output="LIVE", **TIMES)
    bpy.ops.ed.undo_push(message="Live")
    return box


@pytest.mark.parametrize("failing", [0, 1])
def test_an_update_of_both_stops_where_one_is_cancelled(painted, monkeypatch, failing):
    box, runs, steps = both_live(painted), [], []

    def run(step, how, is_undoable):
        runs.append((how, is_undoable))
        return {"CANCELLED"} if len(runs) == failing + 1 else {"FINISHED"}

    push = SimpleNamespace(undo_push=lambda message: steps.append(message))
    monkeypatch.setattr(updating, "_run", run)
    monkeypatch.setattr(updating.bpy.ops, "ed", push)
    assert updating.update(box, is_undoable=True) == {"CANCELLED"}
    assert runs == [("EXEC_DEFAULT", False), ("EXEC_DEFAULT", True)][: failing + 1]
    assert len(steps) == failing  # if the colors have changed


@pytest.mark.parametrize("outcome", ["FINISHED", "CANCELLED"])
def test_an_update_of_both_goes_on_when_the_first_run_ends(painted, monkeypatch, outcome):
    box, runs, looks, job = both_live(painted), [], [], SimpleNamespace(outcome=set())

    def run(step, how, is_undoable):
        runs.append((step.objects, step.operator, how))
        return {"RUNNING_MODAL"}

    monkeypatch.setattr(updating, "_run", run)
    monkeypatch.setattr(updating.jobs, "current", lambda: job)
    monkeypatch.setattr(updating, "_start", lambda look: looks.append(look))
    assert updating.update(box, "INVOKE_DEFAULT", True) == {"RUNNING_MODAL"}
    assert len(runs) == len(looks) == 1 and looks[0]() > 0
    monkeypatch.setattr(updating.jobs, "current", lambda: None)
    job.outcome = {outcome}
    assert looks[0]() is None
    names, own = ("sharpen_colors", "sharpen_geometry"), [box.session_uid]
    both = [(own, name, "INVOKE_DEFAULT") for name in names]
    assert runs == (both if outcome == "FINISHED" else both[:1])


def test_applying_leaves_the_colors_and_nothing_else(painted):
    box = painted()
    sharpen(output="LIVE", **TIMES)
    after = seen(box)
    bpy.ops.object.modifier_apply(modifier=live_modifier(box, LIVE_COLORS).name)
    np.testing.assert_array_equal(stored(box.data), after)
    assert not [each.name for each in box.data.attributes if "shock" in each.name]


def test_before_and_after_swap_them(painted):
    box = painted()
    before = stored(box.data)
    sharpen(output="LIVE", **TIMES)
    after = seen(box)
    bpy.ops.shock_filter.before_after()
    np.testing.assert_array_equal(seen(box), before)
    bpy.ops.shock_filter.before_after()
    np.testing.assert_array_equal(seen(box), after)


def test_users_of_a_mesh_have_their_own_amount(painted):
    box = painted()
    before = stored(box.data)
    twin = bpy.data.objects.new("Twin", box.data)
    bpy.context.collection.objects.link(twin)
    sharpen(output="LIVE", **TIMES)
    amount(twin, 0.0)
    np.testing.assert_array_equal(seen(twin), before)
    assert (seen(box) != before).any()


def test_live_copies_have_the_colors_of_their_source(painted):
    box = painted()
    box.modifiers.new("Bevel", "BEVEL").width = 0.01
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    copy = bpy.context.object
    assert copy != box
    with pytest.raises(RuntimeError, match=f"whose colors come from {box.name}"):
        sharpen(output="LIVE", **TIMES)


def test_denoise_makes_a_live_copy_with_both(painted):
    box = painted("FLOAT_COLOR")
    rng = np.random.default_rng(0)
    noisy = stored(box.data) + rng.normal(scale=0.05, size=(len(box.data.vertices), 4))
    arrays.write_attribute(box.data.color_attributes["Paint"], noisy.clip(0, 1))
    box.modifiers.new("Subdivision", "SUBSURF").subdivision_type = "SIMPLE"
    bpy.ops.shock_filter.denoise(target="both", output="LIVE")
    copy = bpy.context.object
    assert copy != box and len(live_modifiers(copy)) == 2 and live.state(copy) == "fresh"
    assert (seen(copy) != stored(copy.data)).any()
    mesh = copy.data
    live.update(copy)
    assert copy.data != mesh and live.state(copy) == "fresh" and len(live_modifiers(copy)) == 2
    amount(copy, 0.0)
    np.testing.assert_array_equal(seen(copy), stored(copy.data))
