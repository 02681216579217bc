# SPDX-License-Identifier: GPL-3.0-or-later
"""The operator Denoise: geometry, colors, and both."""

from functools import partial
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter.core.host.denoising import filter_both
from shock_filter.core.host.inputs import Denoising
from shock_filter.shock_addon.data.mesh import geometry, painted
from shock_filter.shock_addon.data.mesh.meshes import (
    read_corner_vertices,
    read_positions,
    read_targets,
    write_positions,
)
from shock_filter.shock_addon.data.skipped import Skipped
from shock_filter.shock_addon.kinds import DATA
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.operators import base as operators
from shock_filter.shock_addon.operators import properties
from shock_filter.shock_addon.ui import menus

denoise = bpy.ops.shock_filter.denoise

DOMAINS = pytest.mark.parametrize("domain", ["POINT", "CORNER"])


@pytest.fixture
def noisy_cube():
    """Return a function that adds a finely divided cube with noise, and its colors."""

    def add(noise=0.02, name="Cube", domain="POINT", color_noise=0.05):
        bpy.ops.object.select_all(action="DESELECT")
        bpy.ops.mesh.primitive_cube_add()
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.subdivide(number_cuts=15)
        bpy.ops.object.mode_set(mode="OBJECT")
        cube = bpy.context.object
        cube.name = name
        rng = np.random.default_rng(0)
        clean = read_positions(cube.data)
        paint(cube, clean, domain, color_noise * rng.normal(size=clean.shape))
        write_positions(cube.data, clean + noise * rng.normal(size=clean.shape))
        cube.data.update()
        return cube, clean

    return add


def paint(cube, clean, domain, noise):
    """Paint one half red and the other blue, with noise."""
    attribute = cube.data.color_attributes.new("Paint", "FLOAT_COLOR", domain)
    cube.data.color_attributes.active_color = attribute
    right = (clean[:, :1] > 0.01).astype(float)
    colors = right * [0.8, 0.2, 0.1] + (1 - right) * [0.1, 0.3, 0.7] + noise
    colors = np.column_stack([colors, np.full(len(colors), 0.5)])
    if domain == "CORNER":
        colors = colors[read_corner_vertices(cube.data)]
    attribute.data.foreach_set("color", colors.astype(np.float32).reshape(-1))


def colors_of(cube, name="Paint"):
    data = cube.data.color_attributes[name].data
    flat = np.empty(4 * len(data), dtype=np.float32)
    data.foreach_get("color", flat)
    return flat.reshape(-1, 4)


def sides(clean, cube):
    """Which colors lie on the right half, and not beside the edge between both."""
    x = clean[:, 0]
    if cube.data.color_attributes["Paint"].domain == "CORNER":
        x = x[read_corner_vertices(cube.data)]
    return x > 0.2, x < -0.2


def spread(cube, clean):
    """Standard deviation of the colors within each half."""
    return max(colors_of(cube)[side, :3].std(axis=0).max() for side in sides(clean, cube))


def tilt(cube, clean, part="all"):
    """Mean angle between the faces and the cube's sides, in degrees: of "all", or of some."""
    normals = np.array([polygon.normal for polygon in cube.data.polygons])
    upright = np.abs(normals).max(axis=1)
    places = np.sort(np.abs([clean[list(p.vertices)].mean(axis=0) for p in cube.data.polygons]))
    chosen = {"all": places[:, 1] < 2, "creases": places[:, 1] > 0.9, "middle": places[:, 1] < 0.6}
    return np.degrees(np.arccos(np.minimum(upright[chosen[part]], 1.0))).mean()


# --------------------------------------------------------------------------------------- geometry


def test_noise_falls_and_creases_stay(noisy_cube):
    cube, clean = noisy_cube()
    before, edge_before = tilt(cube, clean), tilt(cube, clean, "creases")
    assert before > 8
    assert denoise() == {"FINISHED"}
    assert tilt(cube, clean) < before / 4
    assert tilt(cube, clean, "creases") < edge_before / 3
    text = operators.summaries["denoise"]
    assert text.startswith("Denoised 1 mesh: 1,538 vertices, moved 1,")


def test_positions_may_be_filtered_as_in_the_paper(noisy_cube):
    cube, clean = noisy_cube()
    before = tilt(cube, clean, "middle")
    assert denoise(method="beltrami", filtered="positions", iterations=1) == {"FINISHED"}
    assert tilt(cube, clean, "middle") < before / 2
    assert tilt(cube, clean, "creases") > 10


def test_a_strength_or_time_of_zero_changes_no_bit(noisy_cube):
    cube, _ = noisy_cube()
    points, colors = read_positions(cube.data), colors_of(cube)
    for target in ("geometry", "colors", "both"):
        assert denoise(target=target, strength=0.0, color_time=0.0) == {"FINISHED"}
    assert read_positions(cube.data).tobytes() == points.tobytes()
    assert colors_of(cube).tobytes() == colors.tobytes()


def test_a_run_that_moves_nothing_says_what_to_raise(noisy_cube, capfd):
    noisy_cube()
    denoise(strength=0.0)
    said = capfd.readouterr().out
    assert " vertices, none moved, " in said  # not at all: no length stands beside it
    assert said.strip().endswith("Beltrami raise Time or lower Keep Edges.")
    denoise(strength=1e-3)
    said = capfd.readouterr().out
    assert " vertices, none moved visibly, largest move " in said
    assert "For more noise raise Bump Size; with Beltrami raise Time" in said


def test_advice_for_colors_names_their_settings_only(noisy_cube, capfd):
    noisy_cube()
    denoise(target="colors", color_time=0.0)
    said = capfd.readouterr().out
    assert "(to remove more, raise Time or lower Keep Edges)" in said
    assert "Bump Size" not in said


def test_sharpening_follows_at_creases(noisy_cube):
    from shock_filter import core

    cube, _ = noisy_cube(noise=0.06)
    start = read_positions(cube.data)
    denoise()
    between = read_positions(cube.data)
    bpy.ops.shock_filter.sharpen_geometry(time=64.0)
    apart = read_positions(cube.data)
    write_positions(cube.data, start)
    assert denoise(then_sharpen=True, sharpen_time=64.0) == {"FINISHED"}
    assert np.abs(apart - between).max() > 1e-3
    np.testing.assert_allclose(read_positions(cube.data), apart, atol=5e-5)
    assert operators.summaries["denoise"].startswith("Denoised and sharpened 1 mesh: ")
    default = bpy.ops.shock_filter.denoise.get_rna_type().properties["sharpen_time"].default
    assert default == core.GeometrySettings().time


@pytest.mark.parametrize("target", ["geometry", "colors", "both"])
def test_weight_zero_changes_no_bit(noisy_cube, target):
    cube, clean = noisy_cube()
    group = cube.vertex_groups.new(name="Top")
    top = clean[:, 2] > 0.2
    group.add(np.flatnonzero(top).tolist(), 1.0, "REPLACE")
    points, colors = read_positions(cube.data), colors_of(cube)
    assert denoise(target=target, vertex_group="Top", then_sharpen=True) == {"FINISHED"}
    moved = (read_positions(cube.data) != points).any(axis=1)
    painted = (colors_of(cube) != colors).any(axis=1)
    assert not moved[~top].any()
    assert not painted[~top].any()
    assert moved[top].mean() > 0.9 if target != "colors" else not moved.any()
    assert painted[top].mean() > 0.9 if target != "geometry" else not painted.any()


def test_only_the_selection_changes_in_edit_mode(noisy_cube):
    cube, clean = noisy_cube()
    left = clean[:, 0] < -0.5
    cube.data.vertices.foreach_set("select", left)
    cube.data.edges.foreach_set("select", np.zeros(len(cube.data.edges), dtype=bool))
    cube.data.polygons.foreach_set("select", np.zeros(len(cube.data.polygons), dtype=bool))
    before = read_positions(cube.data)
    bpy.ops.object.mode_set(mode="EDIT")
    assert denoise() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(cube.data) != before).any(axis=1)
    assert moved[left].any()
    assert not moved[~left].any()


def test_a_new_shape_key_holds_the_denoised_shape(noisy_cube):
    cube, _ = noisy_cube()
    before = read_positions(cube.data)
    assert denoise(output="SHAPE_KEY") == {"FINISHED"}
    assert [key.name for key in cube.data.shape_keys.key_blocks] == ["Basis", "Denoised"]
    np.testing.assert_array_equal(read_positions(cube.data), before)


def test_mirror_symmetry_is_kept():
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=16, y_subdivisions=9)
    sheet = bpy.context.object
    points = read_positions(sheet.data)
    height = np.random.default_rng(1).normal(size=len(points)) * 0.02
    partner = [np.abs(points - p * (-1, 1, 1)).sum(axis=1).argmin() for p in points]
    points[:, 2] = (height + height[partner]) / 2
    write_positions(sheet.data, points)
    sheet.data.use_mirror_x = True
    assert denoise(output="MESH") == {"FINISHED"}
    after = read_positions(sheet.data)
    assert (after != points).any()
    np.testing.assert_allclose(after[partner] * (-1, 1, 1), after, atol=1e-6)


def test_several_objects_at_once_and_a_shared_mesh_once(noisy_cube, select):
    one, _ = noisy_cube(name="One")
    other, _ = noisy_cube(name="Other")
    twin = bpy.data.objects.new("Twin", one.data)
    bpy.context.collection.objects.link(twin)
    select(one, other, twin)
    assert denoise(target="both") == {"FINISHED"}
    assert operators.summaries["denoise"].startswith("Denoised 2 meshes and their colors: ")
    np.testing.assert_array_equal(read_positions(one.data), read_positions(other.data))


@pytest.fixture
def counting(monkeypatch):
    """Listen to runs as a command line does, and return what keeps their counts."""

    class Listener:
        counts = None

        def __call__(self, fraction, message):
            return True

    monkeypatch.setattr(operators, "listener", Listener())
    return operators.listener


@pytest.mark.parametrize(("target", "values"), [("geometry", 1), ("colors", 1), ("both", 2)])
def test_a_command_line_hears_how_many_values_have_changed(noisy_cube, counting, target, values):
    cube, _ = noisy_cube()
    assert denoise(target=target, color_time=4096.0) == {"FINISHED"}
    changed, total = counting.counts
    assert total == values * len(cube.data.vertices)
    assert 0.9 * total < changed <= total


def test_what_was_not_written_is_not_counted(noisy_cube, select, counting, monkeypatch):
    objects = [noisy_cube(name=name)[0] for name in ("One", "Other")]
    select(*objects)
    write = geometry.write_geometry

    def write_one(target, result, key_name):
        if target.name == "Other":
            raise Skipped("it was changed meanwhile; run again")
        return write(target, result, key_name)

    monkeypatch.setattr(geometry, "write_geometry", write_one)
    assert denoise() == {"FINISHED"}
    assert counting.counts[1] == len(objects[0].data.vertices)


def test_a_model_that_was_built_in_halves_stays():
    bpy.ops.mesh.primitive_monkey_add()
    mesh = bpy.context.object.data
    before = read_positions(mesh)
    assert denoise() == {"FINISHED"}
    np.testing.assert_array_equal(read_positions(mesh), before)


def test_modifiers_are_named_when_vertices_move():
    obj = SimpleNamespace(modifiers=[SimpleNamespace(type="MIRROR")], data={}, session_uid=1)
    operator = bpy.types.SHOCK_FILTER_OT_denoise
    quiet = {"custom_normals": "CLEAR", "mark_sharp": False, "output": "LIVE"}
    quiet |= {"_replaced_live": [], "_other_live": []}
    of_geometry, of_colors = (
        SimpleNamespace(row=operator.row, target=t, kind=DATA[t], **quiet)
        for t in ("geometry", "colors")
    )
    target = SimpleNamespace(object_uid=1, is_seen=False)
    written = [operators.Written(target, obj, None)]
    assert operator.notes(of_geometry, written).startswith("Modifiers were left in place")
    assert operator.notes(of_colors, written) == ""


def test_undo_brings_the_noise_back(noisy_cube):
    cube, _ = noisy_cube()
    before = read_positions(cube.data)
    bpy.ops.ed.undo_push(message="Before")
    denoise()
    bpy.ops.ed.undo_push(message="Denoise")
    assert (read_positions(bpy.data.objects["Cube"].data) != before).any()
    bpy.ops.ed.undo()
    np.testing.assert_array_equal(read_positions(bpy.data.objects["Cube"].data), before)


# ----------------------------------------------------------------------------------------- colors


@DOMAINS
def test_noise_in_colors_falls_and_the_edge_stays(noisy_cube, domain):
    cube, clean = noisy_cube(domain=domain)
    points, before, noise = read_positions(cube.data), colors_of(cube), spread(cube, clean)
    assert denoise(target="colors") == {"FINISHED"}
    after = colors_of(cube)
    assert spread(cube, clean) < noise / 2
    right, left = sides(clean, cube)
    assert after[right, 0].min() - after[left, 0].max() > 0.55
    np.testing.assert_array_equal(after[:, 3], before[:, 3])
    np.testing.assert_array_equal(read_positions(cube.data), points)
    assert operators.summaries["denoise"].startswith("Denoised the colors of 1 mesh: ")


def test_the_settings_of_colors_are_their_own(noisy_cube):
    cube, clean = noisy_cube()
    before = colors_of(cube)
    denoise(target="colors", time=9.0, iterations=9)
    own = colors_of(cube)
    cube.data.color_attributes["Paint"].data.foreach_set("color", before.reshape(-1))
    denoise(target="colors")
    np.testing.assert_array_equal(colors_of(cube), own)
    smooth = spread(cube, clean)
    cube.data.color_attributes["Paint"].data.foreach_set("color", before.reshape(-1))
    denoise(target="colors", color_time=0.2)
    assert spread(cube, clean) > 1.5 * smooth


@DOMAINS
def test_colors_are_sharpened_afterwards(noisy_cube, domain):
    cube, _ = noisy_cube(domain=domain)
    start = colors_of(cube)
    denoise(target="colors")
    bpy.ops.shock_filter.sharpen_colors(time=16.0)
    apart = colors_of(cube)
    cube.data.color_attributes["Paint"].data.foreach_set("color", start.reshape(-1))
    assert denoise(target="colors", then_sharpen=True, sharpen_time=16.0) == {"FINISHED"}
    np.testing.assert_allclose(colors_of(cube), apart, atol=1e-5)
    assert np.abs(apart - start).max() > 0.05


def test_an_attribute_is_chosen_by_name(noisy_cube):
    cube, _ = noisy_cube()
    other = cube.data.color_attributes.new("Other", "FLOAT_COLOR", "POINT")
    values = np.random.default_rng(2).random(4 * len(other.data)).astype(np.float32)
    other.data.foreach_set("color", values)
    before = colors_of(cube)
    assert denoise(target="colors", attribute="Other", color_beta=0.0) == {"FINISHED"}
    np.testing.assert_array_equal(colors_of(cube), before)
    assert colors_of(cube, "Other")[:, :3].std() < 0.5 * values.reshape(-1, 4)[:, :3].std()


# ------------------------------------------------------------------------------------------- both


@DOMAINS
def test_both_lose_their_noise_together(noisy_cube, domain):
    cube, clean = noisy_cube(domain=domain)
    noise, before = spread(cube, clean), tilt(cube, clean, "middle")
    assert denoise(target="both") == {"FINISHED"}
    assert spread(cube, clean) < noise / 2
    assert tilt(cube, clean, "middle") < before / 2
    text = operators.summaries["denoise"]
    assert text.startswith("Denoised 1 mesh and its colors: 1,538 vertices, moved 1,")
    assert "colors, changed" in text


def test_domains_agree_where_corners_do(noisy_cube):
    vertex, _ = noisy_cube(domain="POINT")
    denoise(target="both")
    corner, _ = noisy_cube(domain="CORNER")
    denoise(target="both")
    points = read_positions(vertex.data)
    np.testing.assert_allclose(read_positions(corner.data), points, atol=1e-5)
    expected = colors_of(vertex)[read_corner_vertices(corner.data)]
    np.testing.assert_allclose(colors_of(corner), expected, atol=1e-5)


@DOMAINS
def test_edges_between_colors_keep_the_shape(noisy_cube, domain):
    # With a strong beta, positions are not averaged across an edge between colors.
    cube, clean = noisy_cube(noise=0.0, domain=domain, color_noise=0.0)
    ridge = clean.copy()
    ridge[:, 1:] *= np.where(clean[:, :1] > 0.01, 1.0, 0.8)
    write_positions(cube.data, ridge)
    inner = (np.abs(clean[:, 1:]) < 0.7).any(axis=1) & (np.abs(clean[:, 0]) < 0.2)
    denoise(target="both", color_beta=0.0)
    blurred = np.abs(read_positions(cube.data) - ridge)[inner].mean()
    write_positions(cube.data, ridge)
    denoise(target="both", color_beta=50.0)
    assert np.abs(read_positions(cube.data) - ridge)[inner].mean() < 0.7 * blurred


@DOMAINS
def test_the_paint_mask_protects_shape_and_colors(noisy_cube, domain):
    cube, clean = noisy_cube(domain=domain)
    mesh = cube.data
    top = np.array([clean[list(p.vertices), 2].min() > 0.2 for p in mesh.polygons])
    mesh.polygons.foreach_set("select", top)
    mesh.use_paint_mask = True
    corners = np.repeat(top, [p.loop_total for p in mesh.polygons])
    reached = np.zeros(len(mesh.vertices), dtype=bool)
    reached[read_corner_vertices(mesh)[corners]] = True
    points, colors = read_positions(mesh), colors_of(cube)
    bpy.ops.object.mode_set(mode="VERTEX_PAINT")
    assert denoise(target="both") == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(mesh) != points).any(axis=1)
    painted = (colors_of(cube) != colors).any(axis=1)
    free = corners if domain == "CORNER" else reached
    assert not moved[~reached].any()
    assert not painted[~free].any()
    assert moved[reached].all()
    assert painted[free].all()


def test_the_sculpt_mask_protects(noisy_cube):
    cube, clean = noisy_cube()
    bpy.ops.object.mode_set(mode="SCULPT")
    attribute = cube.data.attributes.new(".sculpt_mask", "FLOAT", "POINT")
    masked = clean[:, 0] > 0
    attribute.data.foreach_set("value", masked.astype(np.float32))
    before = read_positions(cube.data)
    assert denoise() == {"FINISHED"}
    bpy.ops.object.mode_set(mode="OBJECT")
    moved = (read_positions(cube.data) != before).any(axis=1)
    assert not moved[masked].any()
    assert moved[~masked].mean() > 0.9


def test_corners_that_jump_do_not_crack_the_mesh(noisy_cube):
    cube, _ = noisy_cube(domain="CORNER")
    attribute = cube.data.color_attributes["Paint"]
    one_each = np.random.default_rng(3).random((len(cube.data.polygons), 4))
    colors = np.repeat(one_each, [p.loop_total for p in cube.data.polygons], axis=0)
    attribute.data.foreach_set("color", colors.astype(np.float32).reshape(-1))
    stored, before = colors_of(cube), read_positions(cube.data)
    assert denoise(target="both") == {"FINISHED"}
    np.testing.assert_allclose(colors_of(cube), stored, atol=1e-6)
    assert (read_positions(cube.data) != before).any()
    assert np.isfinite(read_positions(cube.data)).all()


def test_split_vertices_of_other_colors_move_together(noisy_cube):
    cube, _ = noisy_cube()
    bpy.ops.object.mode_set(mode="EDIT")
    bpy.ops.mesh.select_all(action="SELECT")
    bpy.ops.mesh.edge_split()
    bpy.ops.object.mode_set(mode="OBJECT")
    points = read_positions(cube.data)
    colors = np.random.default_rng(4).random((len(points), 4)).astype(np.float32)
    cube.data.color_attributes["Paint"].data.foreach_set("color", colors.reshape(-1))
    place = np.unique(points, axis=0, return_inverse=True)[1].reshape(-1)
    assert place.max() + 1 < len(points)
    assert denoise(target="both") == {"FINISHED"}
    after = read_positions(cube.data)
    assert (after != points).any()
    first = np.unique(place, return_index=True)[1]
    np.testing.assert_array_equal(after, after[first][place])


def test_both_are_sharpened_afterwards(noisy_cube):
    cube, _ = noisy_cube(domain="CORNER")
    start = read_positions(cube.data), colors_of(cube)
    denoise(target="both")
    apart = read_positions(cube.data), colors_of(cube)
    write_positions(cube.data, start[0])
    cube.data.color_attributes["Paint"].data.foreach_set("color", start[1].reshape(-1))
    assert denoise(target="both", then_sharpen=True) == {"FINISHED"}
    assert np.abs(read_positions(cube.data) - apart[0]).max() > 1e-3
    assert np.abs(colors_of(cube) - apart[1]).max() > 1e-3
    assert operators.summaries["denoise"].startswith("Denoised and sharpened 1 mesh and its colors")


# ------------------------------------------------------------------------------ cancelling, errors


def test_nothing_is_written_when_one_of_both_was_changed_meanwhile(noisy_cube):
    cube, _ = noisy_cube()
    (target,), _ = read_targets(bpy.context, painted.read_painted, parameters())
    settings = Denoising(properties_of("both"), None)
    result = filter_both(target.surface, "beltrami_vertex_signal", settings, True, None)
    data = cube.data.color_attributes["Paint"].data
    data[0].color = (0.0, 0.0, 0.0, 1.0)
    points = read_positions(cube.data)
    done, skipped = operators.write_results(
        [target], [result], partial(painted.write_painted, key_name="Denoised")
    )
    assert done == []
    assert skipped == ["Skipped Cube: its colors were changed meanwhile; run again."]
    np.testing.assert_array_equal(read_positions(cube.data), points)


def parameters():
    return SimpleNamespace(
        vertex_group="",
        invert_mask=False,
        selected_only=True,
        output="MESH",
        custom_normals="KEEP",
        mark_sharp=False,
        attribute="",
    )


def properties_of(target):
    row = find("denoise").target(SimpleNamespace(target=target))
    kind, prefix = row.row.settings, row.prefix
    owner = bpy.context.scene.shock_filter.denoise
    return properties.settings_from(kind, owner, prefix)


@pytest.mark.parametrize("target", ["geometry", "colors", "both"])
@pytest.mark.parametrize("then", [False, True])
def test_cancelling_changes_nothing(noisy_cube, monkeypatch, target, then):
    cube, _ = noisy_cube()
    points, colors = read_positions(cube.data), colors_of(cube)
    seen = []

    def stop_late(fraction, message):
        seen.append(fraction)
        return fraction < (0.6 if then else 0.1)

    monkeypatch.setattr(operators, "listener", stop_late)
    assert denoise(target=target, then_sharpen=then) == {"CANCELLED"}
    assert max(seen) == seen[-1] >= (0.6 if then else 0.1)
    np.testing.assert_array_equal(read_positions(cube.data), points)
    np.testing.assert_array_equal(colors_of(cube), colors)


@pytest.mark.parametrize("target", ["colors", "both"])
def test_missing_and_broken_colors_are_named(noisy_cube, target):
    cube, _ = noisy_cube()
    data = cube.data.color_attributes["Paint"].data
    data[3].color = (np.nan, 0.0, 0.0, 1.0)
    points = read_positions(cube.data)
    with pytest.raises(RuntimeError, match="colors hold NaN or infinity; paint over"):
        denoise(target=target)
    data[3].color = (2e30, 0.0, 0.0, 1.0)
    with pytest.raises(RuntimeError, match="colors hold values beyond 1e\\+30; paint over"):
        denoise(target=target)
    cube.data.color_attributes.remove(cube.data.color_attributes["Paint"])
    with pytest.raises(RuntimeError, match="it has no color attribute; add one"):
        denoise(target=target)
    np.testing.assert_array_equal(read_positions(cube.data), points)
    assert denoise(target="geometry") == {"FINISHED"}


def test_a_mesh_object_is_wanted():
    bpy.ops.object.light_add()
    assert not denoise.poll()


# -------------------------------------------------------------------------------- panels and menus


def test_only_the_targets_settings_are_asked_for():
    settings = bpy.context.scene.shock_filter.denoise
    for target, prefix in (("geometry", ""), ("colors", "color_"), ("both", "color_")):
        settings.target = target
        names = list(find("denoise").target(settings).fields)
        assert names[:3] == [prefix + name for name in ("time", "beta", "iterations")]
        assert all(name.startswith("color_") == bool(prefix) for name in names)
        every = find("denoise").names_for(settings)
        assert set(names) < set(every)
        assert "output" in every
        assert ("attribute" in every) == (target != "geometry")
    labels = settings.bl_rna.properties
    assert labels["color_time"].name == "Time"


def test_the_output_is_asked_for():
    scene = bpy.context.scene
    scene.shock_filter.mode = "DENOISE"
    for target in ("geometry", "colors", "both"):
        scene.shock_filter.denoise.target = target
        assert bpy.types.SHOCK_FILTER_PT_output.poll(bpy.context)


def test_the_mode_stands_first_and_geometry_is_the_default():
    modes = bpy.types.Scene.bl_rna.properties["shock_filter"].fixed_type.properties
    assert modes["mode"].enum_items.keys()[0] == "DENOISE"
    assert modes["mode"].default == "GEOMETRY"
    assert modes["image_mode"].enum_items.keys()[0] == "DENOISE_IMAGE"
    assert modes["image_mode"].default == "IMAGE"


class Layout:
    """Takes buttons, and remembers their words and what they set."""

    def __init__(self):
        self.buttons = []

    def separator(self):
        pass

    def operator(self, name, **options):
        button = SimpleNamespace(bl_idname=name, **options)
        self.buttons.append(button)
        return button


@pytest.mark.parametrize(
    ("mode", "target"),
    [
        ("OBJECT", "both"),
        ("EDIT_MESH", "geometry"),
        ("SCULPT", "geometry"),
        ("PAINT_VERTEX", "colors"),
    ],
)
def test_the_menu_denoises_what_the_mode_works_on(mode, target):
    settings = bpy.context.scene.shock_filter.denoise
    settings.target = "both"
    settings.then_sharpen = True
    settings.beta = 0.5
    layout = Layout()
    context = SimpleNamespace(
        mode=mode, scene=bpy.context.scene, space_data=SimpleNamespace(type="VIEW_3D")
    )
    menus.SHOCK_FILTER_MT_filters.draw(SimpleNamespace(layout=layout), context)
    button = layout.buttons[0]
    assert (button.bl_idname, button.text) == ("shock_filter.denoise", "Denoise, then Sharpen")
    assert (button.target, button.then_sharpen, button.beta) == (target, True, 0.5)


@pytest.mark.parametrize("mode", ["denoise", "denoise_image"])
def test_times_arrive_as_they_were_typed(mode):
    """Blender keeps 0.1 as 0.100000001."""
    settings = getattr(bpy.context.scene.shock_filter, mode)
    settings.sharpen_time = 0.1
    settings.then_sharpen = True
    assert properties.settings_of(find(mode), settings).sharpen_time == 0.1
