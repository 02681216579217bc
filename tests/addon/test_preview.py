# SPDX-License-Identifier: GPL-3.0-or-later
"""The preview: dials, patches, what is shown, and bringing everything back bit for bit."""

import math
import time
from dataclasses import dataclass
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from shock_filter import live
from shock_filter.core import GeometrySettings, InvalidMesh, InvalidSettings
from shock_filter.core.host import colors
from shock_filter.core.host.geometry import filter_shape
from shock_filter.core.host.inputs import Denoising, MirroredSurface
from shock_filter.core.preview.dials import LinearDial, LogarithmicDial, dial_of, turned
from shock_filter.core.preview.patch import Patch, patch_around, seen_vertex, whole_surface
from shock_filter.core.settings import (
    OF_PAPER,
    BeltramiGeometrySettings,
    BeltramiSettings,
    _setting,
    _Settings,
    describe,
)
from shock_filter.shock_addon.data.mesh import shading
from shock_filter.shock_addon.data.mesh.geometry import read_geometry
from shock_filter.shock_addon.data.mesh.meshes import read_active, read_positions, write_positions
from shock_filter.shock_addon.data.mesh.shading import read_marks
from shock_filter.shock_addon.data.skipped import Skipped
from shock_filter.shock_addon.modes import find
from shock_filter.shock_addon.preview import meshes as preview_meshes
from shock_filter.shock_addon.preview import operator as preview_operator
from shock_filter.shock_addon.preview import previewing
from shock_filter.shock_addon.running import jobs

ABOUT = {name: about for name, (_, _, about) in describe(GeometrySettings).items()}


def begun(mode, size=None):
    """Begin a preview of the active object, on a patch if a size is given."""
    row = find(mode)
    parameters = previewing.parameters_of(bpy.context.scene, row)
    read = row.target(parameters).data.read
    (target,), _ = read_active(bpy.context, read, parameters)
    patch = whole_surface(target.surface)
    if size is not None:
        patch = patch_around(target.surface, 0, size)
    stage = preview_meshes.MeshStage(target, patch, "patch of {size:,} vertices")
    return previewing.Preview(row, parameters, stage)


def settle(running):
    """Tick until the newest settings are shown."""
    for _ in range(6000):
        running.tick()
        if running._job is None:
            return
        time.sleep(0.01)
    raise AssertionError("The preview did not settle.")


def stored(obj):
    """All that a preview may touch, as bytes."""
    mesh = obj.data
    found = [read_positions(mesh).tobytes()]
    for key in mesh.shape_keys.key_blocks if mesh.shape_keys else []:
        flat = np.empty(3 * len(mesh.vertices), dtype=np.float32)
        key.points.foreach_get("co", flat)
        found.append((key.name, key.value, flat.tobytes()))
    for attribute in mesh.color_attributes:
        flat = np.empty(4 * len(attribute.data), dtype=np.float32)
        attribute.data.foreach_get("color_srgb", flat)
        found.append(flat.tobytes())
    found.append(sorted(attribute.name for attribute in mesh.attributes))
    found.append((mesh.attributes.active_index, read_marks(mesh).tobytes()))
    return found


def seen(obj):
    """Where the vertices are seen, with shape keys and modifiers."""
    bpy.context.view_layer.update()
    return read_positions(obj.evaluated_get(bpy.context.evaluated_depsgraph_get()).data)


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (1.0, 1.0, 4.0)], ids=["even", "uneven"])
def test_what_is_shown_is_what_the_operator_makes(rounded_box, scale):
    box = rounded_box()
    box.scale = scale
    bpy.context.view_layer.update()
    before = stored(box)
    running = begun("geometry")
    running.drag(-100)
    running.roll(2)
    settle(running)
    shown, marks = read_positions(box.data), read_marks(box.data)
    assert running.parameters.amount == 0.75
    assert running.parameters.widest_fillet == pytest.approx(2.4)
    running.end()
    assert stored(box) == before
    bpy.ops.shock_filter.sharpen_geometry(amount=0.75, widest_fillet=2.4)
    np.testing.assert_array_equal(read_positions(box.data), shown)
    np.testing.assert_array_equal(read_marks(box.data), marks)
    assert shown.tobytes() != before[0]
    assert marks.any()


@pytest.mark.parametrize("size", [None, 400])
def test_creases_are_marked_meanwhile_and_marks_come_back(rounded_box, size):
    """Those that were there, and one that a script takes away meanwhile, which ends it."""
    box = rounded_box(cuts=20)
    box.data.edges[0].use_edge_sharp = box.data.edges[5].use_edge_sharp = True
    before = stored(box)
    running = begun("geometry", size)
    settle(running)
    marks = read_marks(box.data)
    assert marks[[0, 5]].all() and marks.sum() > 20
    moved = (read_positions(box.data) != np.frombuffer(before[0], np.float32).reshape(-1, 3)).any(1)
    new = [edge for edge in box.data.edges if marks[edge.index] and edge.index not in (0, 5)]
    assert np.mean([moved[list(edge.vertices)].any() for edge in new]) > 0.9
    running.end()
    assert stored(box) == before
    running = begun("geometry", size)
    settle(running)
    box.data.edges[5].use_edge_sharp = False
    running.drag(-100)
    with pytest.raises(Skipped):
        settle(running)
    running.end()
    marks = read_marks(box.data)
    assert marks[0] and marks.sum() == 1


@pytest.mark.parametrize("normals", ["KEEP", "RECOMPUTE", "CLEAR"])
def test_custom_normals_are_shown_as_the_button_leaves_them_and_come_back(rounded_box, normals):
    """Where Blender stores them so that they come back bit for bit, since 4.5."""
    box = rounded_box(cuts=20)
    box.data.normals_split_custom_set([(0.6, 0.0, 0.8)] * len(box.data.loops))
    bpy.context.scene.shock_filter.geometry.custom_normals = normals
    before, turns = stored(box), shading.read_turns(box.data)
    running = begun("geometry")
    settle(running)
    is_shown = normals != "KEEP" and turns is not None
    assert read_marks(box.data).any() == is_shown
    if turns is not None:
        assert shading.read_turns(box.data).any() != is_shown
    running.end()
    assert stored(box) == before
    if turns is not None:
        np.testing.assert_array_equal(shading.read_turns(box.data), turns)


@pytest.mark.parametrize(("name", "value"), [("mark_sharp", False), ("output", "SHAPE_KEY")])
def test_nothing_is_marked_where_the_button_marks_nothing(rounded_box, name, value):
    box = rounded_box()
    setattr(bpy.context.scene.shock_filter.geometry, name, value)
    running = begun("geometry")
    settle(running)
    assert not read_marks(box.data).any()
    running.end()


def test_the_wheel_turns_the_bump_size_of_denoising(rounded_box):
    box = rounded_box()
    running = begun("denoise")
    running.roll(2)
    settle(running)
    shown = read_positions(box.data)
    assert running.parameters.bump_size == pytest.approx(4.8)
    assert "Bump Size 4.8 (wheel)" in running.text()
    running.end()
    bpy.ops.shock_filter.denoise(bump_size=4.8)
    np.testing.assert_array_equal(read_positions(box.data), shown)


@pytest.mark.parametrize(
    ("mode", "given", "text"),
    [
        ("geometry", {}, "Amount 1 (move mouse) | Widest Fillet Auto (wheel)"),
        ("geometry", {"where": "everywhere"}, "Amount 1 (move mouse)"),
        ("geometry", {"time": 16.0}, "Time 16 (move mouse) | Amount 1 (wheel)"),
        ("geometry", {"steady_state": True}, "Time Steady State (move mouse) | Amount 1 (wheel)"),
        ("colors", {}, "Amount 1 (move mouse) | Width Auto (wheel)"),
        ("colors", {"width": 2.0}, "Amount 1 (move mouse) | Width 2 (wheel)"),
        ("colors", {"time": 0.0}, "Time 0 (move mouse) | Amount 1 (wheel)"),
        ("denoise", {}, "Strength 1 (move mouse) | Bump Size None (wheel)"),
        ("denoise", {"time": 2.0}, "Strength 1 (move mouse) | Bump Size None (wheel)"),
        ("denoise", {"method": "beltrami"}, "Strength 1 (move mouse)"),
        (
            "denoise",
            {"method": "beltrami", "time": 2.0},
            "Time 2 (move mouse) | Strength 1 (wheel)",
        ),
    ],
)
def test_dials_are_what_the_panel_shows_or_a_time_that_was_given(painted_sheet, mode, given, text):
    painted_sheet()
    settings = getattr(bpy.context.scene.shock_filter, mode)
    for name, value in given.items():
        setattr(settings, name, value)
    running = begun(mode)
    assert running.text() == text
    before = SimpleNamespace(**vars(running.parameters))
    running.drag(-40)
    running.roll(1)
    names = {
        name for name, value in vars(before).items() if getattr(running.parameters, name) != value
    }
    if "steady_state" in given:
        assert names == {"steady_state", "time"}
    elif given.get("time") == 0.0:
        assert names == set()  # at the lower end already, and Amount at the upper one
    else:
        assert running.dial in names <= {running.dial, running.second}
    running.end()


def test_before_and_after(rounded_box):
    box = rounded_box()
    before = stored(box)
    running = begun("geometry")
    settle(running)
    shown = stored(box)
    running.compare()
    assert stored(box) == before
    assert running.text() == "Before"
    running.drag(50)  # the dials stand still
    running.roll(2)
    settle(running)
    assert stored(box) == before
    running.compare()
    assert stored(box) == shown != before
    running.drag(-50)
    running.compare()
    settle(running)  # what is computed meanwhile waits
    assert stored(box) == before
    running.compare()
    assert stored(box) not in (before, shown)
    running.end()
    assert stored(box) == before


def test_the_panel_is_left_alone_meanwhile(rounded_box):
    rounded_box()
    running = begun("geometry")
    running.drag(-100)
    running.roll(3)
    settings = bpy.context.scene.shock_filter.geometry
    assert (settings.amount, settings.widest_fillet) == (1.0, 0.0)
    running.end()


def test_negative_zeros_come_back(rounded_box):
    box = rounded_box()
    positions = read_positions(box.data)
    positions[:5] = -0.0
    write_positions(box.data, positions)
    running = begun("geometry")
    settle(running)
    assert running.updates == 1
    running.end()
    assert read_positions(box.data).tobytes() == positions.tobytes()


@pytest.mark.parametrize("kind", ["FLOAT_COLOR", "BYTE_COLOR"])
@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("size", [None, 200])
def test_colors(painted_sheet, kind, domain, size):
    sheet = painted_sheet(kind, domain)
    before = stored(sheet)
    running = begun("colors", size)
    settle(running)
    shown = stored(sheet)
    assert shown[1] != before[1]
    assert shown[0] == before[0]
    running.end()
    assert stored(sheet) == before
    if size is None:
        bpy.ops.shock_filter.sharpen_colors()
        assert stored(sheet) == shown


@pytest.mark.parametrize("target", ["geometry", "colors", "both"])
@pytest.mark.parametrize("size", [None, 300])
def test_denoising(painted_sheet, target, size):
    sheet = painted_sheet()
    noise = np.random.default_rng(0).normal(scale=0.01, size=(len(sheet.data.vertices), 3))
    write_positions(sheet.data, read_positions(sheet.data) + noise.astype(np.float32))
    before = stored(sheet)
    bpy.context.scene.shock_filter.denoise.target = target
    running = begun("denoise", size)
    running.drag(10)
    running.roll(1)
    settle(running)
    shown = stored(sheet)
    assert (shown[0] != before[0]) == (target != "colors")
    assert (shown[1] != before[1]) == (target != "geometry")
    values = vars(running.parameters)
    running.end()
    assert stored(sheet) == before
    if size is None:
        bpy.ops.shock_filter.denoise(**values)
        assert stored(sheet) == shown


@pytest.fixture
def keyed(rounded_box):
    """A box with shape keys that are mixed."""
    box = rounded_box()
    box.shape_key_add(name="Basis")
    for name, value in (("Wide", 0.5), ("Tall", 0.25)):
        key = box.shape_key_add(name=name)
        key.value = value
        points = read_positions(box.data)
        points[:, 0 if name == "Wide" else 2] *= 1.5
        key.points.foreach_set("co", points.reshape(-1))
    box.data.shape_keys.key_blocks["Tall"].relative_key = box.data.shape_keys.key_blocks["Wide"]
    return box


@pytest.mark.parametrize("output", ["MESH", "SHAPE_KEY"])
@pytest.mark.parametrize("active", [0, 1])
def test_shape_keys(keyed, output, active):
    keyed.active_shape_key_index = active
    before, names = stored(keyed), list(keyed.data.shape_keys.key_blocks.keys())
    bpy.context.scene.shock_filter.geometry.output = output
    running = begun("geometry")
    settle(running)
    shown = seen(keyed)
    assert list(keyed.data.shape_keys.key_blocks.keys()) == names
    running.end()
    assert stored(keyed) == before
    assert keyed.active_shape_key_index == active
    bpy.ops.shock_filter.sharpen_geometry(output=output)
    np.testing.assert_allclose(seen(keyed), shown, atol=1e-6)


def test_a_new_shape_key_is_not_made_meanwhile(rounded_box):
    box = rounded_box()
    before = stored(box)
    bpy.context.scene.shock_filter.geometry.output = "SHAPE_KEY"
    running = begun("geometry")
    settle(running)
    shown = seen(box)
    assert shown.tobytes() != before[0]
    assert box.data.shape_keys is None
    running.end()
    assert stored(box) == before
    bpy.ops.shock_filter.sharpen_geometry(output="SHAPE_KEY")
    np.testing.assert_allclose(seen(box), shown, atol=1e-6)


def test_a_mask_holds(rounded_box):
    box = rounded_box()
    box.vertex_groups.new(name="Some").add(range(200), 1.0, "REPLACE")
    bpy.context.scene.shock_filter.geometry.vertex_group = "Some"
    before = read_positions(box.data)
    running = begun("geometry")
    settle(running)
    after = read_positions(box.data)
    running.end()
    np.testing.assert_array_equal(after[200:], before[200:])
    assert (after[:200] != before[:200]).any()


def test_a_patch_moves_alone_and_its_border_stays(rounded_box):
    box = rounded_box(cuts=20)
    before = read_positions(box.data)
    running = begun("geometry", 400)
    settle(running)
    moved = (read_positions(box.data) != before).any(axis=1)
    assert "patch of" in running.text()
    running.end()
    near = np.linalg.norm(before - before[0], axis=1)
    assert 50 < moved.sum() < 400
    assert near[moved].max() < np.sort(near)[400]
    for edge in box.data.edges:  # at the border of what moves, neighbours stay
        first, second = edge.vertices
        if moved[first] != moved[second]:
            assert near[[first, second]].max() <= np.sort(near)[400]


def test_a_thin_line_is_drawn_around_a_patch_only(rounded_box):
    rounded_box(cuts=20)
    running = begun("geometry")
    assert running.stage._outline._drawing is None
    running.end()
    running = begun("geometry", 400)
    outline = running.stage._outline
    assert outline._drawing is not None
    running.end()
    assert outline._drawing is None


def test_the_line_runs_along_the_border_of_the_patch():
    points, triangles = bumpy_sheet(20, 0.5, 0.0)
    sheet = MirroredSurface(
        positions=points.astype(np.float32),
        triangles=triangles.astype(np.int32),
        mask=None,
        to_world=np.identity(3),
        mirror=(False, False, False),
        planes=(),
    )
    patch = patch_around(sheet, 220, 60)
    ends = {tuple(point) for point in patch.outline.reshape(-1, 3).tolist()}
    still = {tuple(point) for point in patch.surface.positions[patch.surface.mask == 0].tolist()}
    assert ends == still
    assert len(patch.outline) == len(ends)  # a closed line
    assert whole_surface(sheet).outline.size == 0


def test_a_patch_begun_from_a_panel_is_said_to_be_in_the_middle(rounded_box, monkeypatch):
    rounded_box(cuts=20)
    monkeypatch.setattr(preview_meshes, "_QUICK", 400)
    monkeypatch.setattr(preview_meshes, "_pointed_at", lambda *given: 0)
    for over_view, words in ((False, "vertices in the middle of the view"), (True, "vertices")):
        monkeypatch.setattr(preview_meshes, "is_over_view", lambda *given, over=over_view: over)
        running = preview_meshes.begin(bpy.context, None, find("geometry"))
        assert running.stage.note.endswith(words)
        running.end()


def test_a_patch_holds_its_mirror_images(rounded_box):
    box = rounded_box(cuts=20)
    before = np.round(read_positions(box.data), 4)  # symmetric in each bit
    write_positions(box.data, before)
    box.data.use_mirror_x = box.data.use_mirror_z = True
    running = begun("geometry", 400)
    settle(running)
    after = read_positions(box.data)
    running.end()
    moved = (after != before).any(axis=1)
    assert 100 < moved.sum() <= 420
    folded = np.linalg.norm(np.abs(before) - np.abs(before[0]), axis=1) + 9.0 * (before[:, 1] > 0)
    inner = folded < 0.7 * folded[moved].max()  # at its rim, triangles are not symmetric
    assert inner.sum() > 100
    for axis in (0, 2):
        other = after.copy()
        other[:, axis] *= -1
        away = np.linalg.norm(other[inner][:, None] - after[inner], axis=2)
        assert away.min(axis=0).max() < 1e-6
    assert {tuple(signs) for signs in np.sign(before[moved][:, ::2])} >= {
        (-1.0, -1.0), (-1.0, 1.0), (1.0, -1.0), (1.0, 1.0)
    }  # fmt: skip
    assert (before[moved, 1] < 0).all()


def test_the_strength_on_a_patch_is_that_on_the_whole(rounded_box):
    box = rounded_box(cuts=20)
    for name, value in OF_PAPER.items():
        setattr(bpy.context.scene.shock_filter.geometry, name, value)
    positions = read_positions(box.data)
    positions *= 1.0 + 0.5 * (positions[:, :1] > 0)  # edges of several lengths
    write_positions(box.data, positions)
    near = np.argsort(np.linalg.norm(positions - positions[0], axis=1))[:150]

    def moves(running):
        settle(running)
        moved = (read_positions(box.data) - positions)[near]
        running.end()
        return moved

    full = moves(begun("geometry"))
    part = begun("geometry", 600)
    assert part.stage.settings(GeometrySettings(time=1.0)).time > 1.05**4
    error = np.abs(moves(part) - full).max()
    assert error < 0.3 * np.abs(full).max()
    careless = begun("geometry", 600)
    careless.stage.settings = lambda settings: settings
    assert error < 0.9 * np.abs(moves(careless) - full).max()


def test_a_patch_is_sharpened_by_default_nearly_as_the_whole(rounded_box):
    box = rounded_box(cuts=30)
    before = read_positions(box.data)
    moved = []
    for size in (None, 1500):
        running = begun("geometry", size)
        settle(running)
        moved.append(read_positions(box.data) - before)
        running.end()
    near = np.argsort(np.linalg.norm(before - before[0], axis=1))[:700]
    whole = np.linalg.norm(moved[0][near], axis=1)
    apart = np.linalg.norm(moved[0] - moved[1], axis=1)[near]
    moving = whole > 0.2 * whole.max()
    assert moving.sum() > 50
    assert np.median(apart[moving] / whole[moving]) < 0.3
    assert apart.max() < 0.2 * whole.max()


def bumpy_sheet(cells, cell, left, roughness=0.02):
    """A sheet with a rounded crease and some noise: points and triangles."""
    ticks = cell * np.arange(cells + 1)
    x, y = np.meshgrid(ticks, ticks)
    noise = np.random.default_rng(0).standard_normal(x.shape)
    z = -0.5 * np.hypot(x - 0.5 * ticks[-1], 3 * cell) + roughness * cell * noise
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    second, third, fourth = first + 1, first + cells + 2, first + cells + 1
    triangles = np.stack([first, second, third, first, third, fourth], axis=1).reshape(-1, 3)
    return np.stack([x + left, y, z], axis=-1).reshape(-1, 3), triangles


KERNEL = BeltramiGeometrySettings(method="beltrami", repeat=1)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("sharpen_geometry", GeometrySettings.of_paper(time=16.0)),
        ("sharpen_geometry", GeometrySettings.of_paper(time=16.0, screening_radius=1.0)),
        ("sharpen_geometry", GeometrySettings.of_paper(time=16.0, max_displacement=0.01)),
        ("denoise_geometry", Denoising(KERNEL, None)),
    ],
    ids=["time", "radius", "displacement", "denoising"],
)
def test_settings_mean_the_same_on_a_patch_with_shorter_edges(name, settings):
    """The patch is a fine sheet, alone; the whole has a coarse one beside it.

    Sharpened as in the paper, which knows no parts: by default, what is a crease depends on the
    whole part.
    """
    roughness = 0.05 if name == "denoise_geometry" else 0.02
    fine, triangles = bumpy_sheet(20, 0.5, 0.0, roughness)
    coarse, others = bumpy_sheet(20, 1.5, 100.0, roughness)
    whole = MirroredSurface(
        positions=np.concatenate([fine, coarse]).astype(np.float32),
        triangles=np.concatenate([triangles, others + len(fine)]).astype(np.int32),
        mask=None,
        to_world=np.identity(3),
        mirror=(False, False, False),
        planes=(),
    )
    patch = patch_around(whole, 0, len(fine))
    assert patch.lengths == pytest.approx(2.0)

    def moves(surface, chosen):
        found = filter_shape(surface, name, chosen, True, lambda fraction, message: True)
        return found.positions[: len(fine)] - fine

    wanted = moves(whole, settings)
    error = np.abs(moves(patch.surface, patch.settings(settings)) - wanted).max()
    careless = np.abs(moves(patch.surface, settings) - wanted).max()
    assert careless > 0.3 * np.abs(wanted).max()
    assert error < 0.4 * careless


@dataclass(kw_only=True, repr=False, eq=False)
class OtherSettings(_Settings):
    time: float = _setting(3.0, "How long it takes", unit="seconds", maximum=9.0)
    width: float = _setting(2.0, "How wide", length_power=1, counts_in="edges")


def test_only_settings_in_edge_lengths_change_on_a_patch():
    patch = Patch(None, None, lengths=2.0, share=0.5, outline=None)
    assert patch.settings(OtherSettings()) == OtherSettings(time=3.0, width=4.0)
    changed = patch.settings(Denoising(OtherSettings(), 1.0))
    assert changed == Denoising(OtherSettings(width=4.0), 16.0)
    beside = patch.settings(Denoising(BeltramiGeometrySettings(time=0.5, beta=1.0), None))
    assert (beside.kernel.time, beside.kernel.beta) == (2.0, 2.0)


def test_loose_vertices_make_no_patch(rounded_box):
    box = rounded_box()
    box.data.vertices.add(1)
    box.data.vertices[len(box.data.vertices) - 1].co = (100, 0, 0)
    (target,), _ = read_active(
        bpy.context, read_geometry, previewing.parameters_of(bpy.context.scene, find("geometry"))
    )
    patch = patch_around(target.surface, len(box.data.vertices) - 1, 200)
    assert patch.surface.size > 100
    with pytest.raises(InvalidMesh, match="no faces to preview here"):
        patch_around(target.surface, len(box.data.vertices) - 1, 1)


def test_the_vertex_under_the_mouse_is_the_foremost_one():
    points = np.array([[0, 0, 0], [0, 0, -5], [0.9, 0, 0], [0, 0, 9]], dtype=np.float32)
    perspective = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 2], [0, 0, -1, 5.0]])
    assert seen_vertex(points, perspective, (1000, 1000), (500, 500)) in {0, 1}
    foremost = seen_vertex(points, perspective, (1000, 1000), (500, 500))
    depth = (points[:, 2] + 2) / (5 - points[:, 2])
    assert depth[foremost] == min(depth[:2])
    assert seen_vertex(points, perspective, (1000, 1000), (590, 500)) == 2
    assert seen_vertex(points[3:], perspective, (1000, 1000), (500, 500)) == 0


def test_the_newest_settings_win(rounded_box):
    box = rounded_box(cuts=15)
    running = begun("geometry")
    settle(running)
    for pixels in (-40, -40, -200, 30):
        running.drag(pixels)
        running.tick()
    settle(running)
    shown = read_positions(box.data)
    final = running.parameters.amount
    assert 0.0 < final < 1.0
    running.end()
    bpy.ops.shock_filter.sharpen_geometry(amount=final)
    np.testing.assert_array_equal(read_positions(box.data), shown)


def test_old_news_is_cancelled_when_it_takes_long(rounded_box, monkeypatch):
    rounded_box()
    running = begun("geometry")
    running.tick()
    first = running._job
    running.drag(-30)
    monkeypatch.setattr(previewing, "_PATIENCE", -1.0)
    running.tick()
    first.wait()
    settle(running)
    assert running._computing == running.parameters
    running.end()


def test_an_error_is_said_and_the_preview_goes_on(painted_sheet, monkeypatch):
    sheet = painted_sheet()
    before = stored(sheet)
    running = begun("colors")

    def refuse(*_, **__):
        raise InvalidSettings("The sheet is too red; paint it blue.")

    with monkeypatch.context() as patch:
        patch.setattr(colors, "find", refuse)
        running.parameters.time = 200_000.0
        settle(running)
    assert "paint it blue" in running.text()
    assert stored(sheet) == before
    running.parameters.time = 100_000.0
    settle(running)
    assert "paint it blue" not in running.text()
    assert running.updates == 1
    running.end()


def test_a_removed_object_and_a_changed_mesh_end_it(rounded_box):
    box = rounded_box()
    mesh = box.data
    before = read_positions(mesh)
    running = begun("geometry")
    settle(running)
    assert not running.stage.lost()
    bpy.data.objects.remove(box)
    assert running.stage.lost()
    running.end()
    assert read_positions(mesh).tobytes() == before.tobytes()
    bpy.data.meshes.remove(mesh)
    running.end()

    other = rounded_box()
    running = begun("geometry")
    settle(running)
    other.data.vertices.add(1)
    running.end()
    assert len(other.data.vertices) == len(before) + 1


@pytest.mark.parametrize("mode", ["geometry", "colors", "denoise"])
def test_what_something_else_writes_meanwhile_ends_it_and_stays(painted_sheet, mode):
    sheet = painted_sheet()
    bpy.context.scene.shock_filter.denoise.target = "both"
    before, paint = read_positions(sheet.data), sheet.data.color_attributes[0].data
    running = begun(mode)
    settle(running)
    if mode == "colors":
        paint[7].color = (0.25, 0.5, 0.75, 1.0)
    else:
        sheet.data.vertices[7].co = (9, 8, 7)
    running.drag(-50)
    with pytest.raises(Skipped, match="it was changed meanwhile"):
        settle(running)
    running.end()
    after = read_positions(sheet.data)
    if mode == "colors":
        assert tuple(paint[7].color) == (0.25, 0.5, 0.75, 1.0)
        np.testing.assert_array_equal(after, before)
    else:
        assert after[7].tolist() == [9, 8, 7]
        np.testing.assert_array_equal(np.delete(after, 7, axis=0), np.delete(before, 7, axis=0))


def test_a_shape_key_that_a_script_moves_meanwhile_stays(keyed):
    keys = keyed.data.shape_keys.key_blocks
    before = stored(keyed)
    running = begun("geometry")
    settle(running)
    keys["Wide"].points[3].co = (9, 8, 7)
    running.drag(-50)
    with pytest.raises(Skipped, match="it was changed meanwhile"):
        settle(running)
    running.end()
    assert tuple(keys["Wide"].points[3].co) == (9, 8, 7)
    after = stored(keyed)
    assert [one == other for one, other in zip(before, after, strict=True)].count(False) == 1


@pytest.mark.parametrize("mode", ["EDIT", "SCULPT", "VERTEX_PAINT", "WEIGHT_PAINT"])
def test_other_modes_see_it_and_are_kept(rounded_box, mode):
    box = rounded_box()
    box.data.color_attributes.new("Paint", "FLOAT_COLOR", "POINT")
    before = stored(box)
    bpy.ops.object.mode_set(mode=mode)
    running = begun("geometry")
    settle(running)
    assert box.mode == ("OBJECT" if mode == "EDIT" else mode)  # Edit Mode has a mesh of its own
    assert stored(box)[0] != before[0]
    assert running.stage.lost() == ""
    running.end()
    assert box.mode == mode
    bpy.ops.object.mode_set(mode="OBJECT")
    assert stored(box) == before


def test_keys_are_mixed_again_if_another_object_became_active(keyed):
    keyed.active_shape_key_index = 1
    bpy.ops.object.mode_set(mode="EDIT")
    running = begun("geometry")
    bpy.context.view_layer.objects.active = None
    running.end()
    assert not keyed.show_only_shape_key


def test_edit_mode_previews_the_selection_and_the_key_that_it_shows(keyed):
    keyed.active_shape_key_index = 1
    keyed.active_shape_key.value = 0.0
    before, shape = stored(keyed), seen(keyed)
    bpy.ops.object.mode_set(mode="EDIT")
    running = begun("geometry")
    settle(running)
    assert keyed.show_only_shape_key
    assert (seen(keyed) != shape).any()
    running.end()
    assert not keyed.show_only_shape_key
    bpy.ops.object.mode_set(mode="OBJECT")
    assert stored(keyed) == before


def test_an_object_that_goes_while_it_is_previewed_from_edit_mode(rounded_box):
    box = rounded_box()
    bpy.ops.object.mode_set(mode="EDIT")
    running = begun("geometry")
    settle(running)
    bpy.data.objects.remove(box)
    assert running.stage.lost()
    running.end()


def test_leaving_object_mode_ends_it_with_the_old_shape(rounded_box):
    box = rounded_box()
    before = stored(box)
    running = begun("geometry")
    settle(running)
    bpy.ops.object.mode_set(mode="EDIT")
    assert running.stage.lost()
    running.end()
    assert box.mode == "EDIT"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert stored(box)[0] == before[0]


class _Events:
    """The operator without Blender around it."""

    def __init__(self, running, monkeypatch):
        cls = preview_operator.SHOCK_FILTER_OT_preview
        self.reports, self.status, self.ran = [], [], []
        self._mode = find("geometry")
        self._preview = running
        self._arrived, self._last_move, self._ticks = True, math.inf, 0
        for name in ("modal", "cancel", "_step", "_turn", "_follow", "_ended_by", "_apply"):
            setattr(self, name, getattr(cls, name).__get__(self))
        self.report = lambda kind, text: self.reports.append(text)
        manager = SimpleNamespace(
            event_timer_add=lambda seconds, window: "timer", event_timer_remove=lambda timer: None
        )
        self.context = SimpleNamespace(
            window_manager=manager, window=None, area=None, scene=bpy.context.scene
        )
        run = SimpleNamespace(
            sharpen_geometry=lambda *given, **settings: self.ran.append((given, settings))
        )
        fake = SimpleNamespace(
            context=self.context, ops=SimpleNamespace(shock_filter=run), types=bpy.types
        )
        monkeypatch.setattr(preview_operator, "bpy", fake)
        self._session = preview_operator._Session(self, self.context, running)
        self._session._status = SimpleNamespace(
            show=lambda context, text, area: self.status.append(text),
            clear=lambda context: self.status.append(None),
        )

    def send(self, kind, value="PRESS", shift=False, x=0):
        event = SimpleNamespace(
            type=kind, value=value, shift=shift, mouse_x=x, mouse_prev_x=0, mouse_y=0
        )
        return self.modal(self.context, event)


@pytest.fixture
def events(rounded_box, monkeypatch):
    rounded_box()
    running = _Events(begun("geometry"), monkeypatch)
    yield running
    preview_operator.stop()


def shown_by(events):
    while events._preview.updates == 0:
        assert events.send("TIMER") == {"RUNNING_MODAL"}
        time.sleep(0.01)


def test_mouse_and_wheel_turn_the_dials(events):
    events.send("MOUSEMOVE", x=-100)
    assert events._preview.parameters.amount == 0.75
    assert "Amount 0.75 (move mouse) | Widest Fillet Auto (wheel)" in events.status[-1]
    events.send("MOUSEMOVE", x=100, shift=True)
    assert events._preview.parameters.amount == 0.775
    events.send("WHEELUPMOUSE")
    events.send("WHEELDOWNMOUSE", shift=True)
    assert events._preview.parameters.widest_fillet == pytest.approx(2.18)
    assert "Widest Fillet 2.18 (wheel)" in events.status[-1]
    assert "Esc or Right Click: cancel" in events.status[-1]


def test_a_key_shows_what_was_there_before(events):
    box = bpy.context.object
    before = stored(box)
    shown_by(events)
    assert stored(box) != before
    assert "B: before / after" in events.status[-1]
    assert events.send("B") == {"RUNNING_MODAL"}
    assert stored(box) == before
    assert events.status[-1].startswith("Before |")
    events.send("B", value="RELEASE")
    assert stored(box) == before
    events.send("B")
    assert stored(box) != before


def test_live_copies_are_up_to_date_after_a_cancelled_preview(rounded_box, select, monkeypatch):
    box = rounded_box((0.5, 0.5, 0.5))
    bpy.ops.mesh.primitive_cube_add()
    bpy.context.object.modifiers.new("Boolean", "BOOLEAN").object = box
    bpy.ops.shock_filter.sharpen_geometry(output="LIVE")
    copy = bpy.context.object
    select(box)
    events = _Events(begun("geometry"), monkeypatch)
    shown_by(events)
    bpy.context.view_layer.update()
    assert live.state(copy) == "moved"
    assert events.send("ESC") == {"CANCELLED"}
    bpy.context.view_layer.update()
    assert live.state(copy) == "fresh"


def test_values_stay_while_the_mouse_moves_up_or_down(events):
    events._preview.parameters.amount = 0.12345
    events.send("MOUSEMOVE", x=0)
    assert events._preview.parameters.amount == 0.12345


def test_the_way_from_the_button_to_the_view_changes_nothing(events, monkeypatch):
    view = SimpleNamespace(type="WINDOW", x=100, y=-50, width=800, height=600)
    sidebar = SimpleNamespace(type="UI", x=800, y=-50, width=100, height=600)
    events.context.area = SimpleNamespace(x=100, width=800, regions=[sidebar, view])
    events._arrived = False
    monkeypatch.setattr(preview_operator, "_REST", 60.0)
    for x in (850, 810, 790, 500):
        events.send("MOUSEMOVE", x=x)
        events.send("TIMER")
    events.send("WHEELUPMOUSE")
    assert "Amount 1 (move mouse)" in events.status[-1]
    assert events._preview.parameters.widest_fillet == pytest.approx(2.2)
    monkeypatch.setattr(preview_operator, "_REST", -1.0)  # it has rested in the view
    monkeypatch.setattr(preview_operator, "_REST_TICKS", 1)
    events.send("TIMER")
    events.send("MOUSEMOVE", x=-100)
    assert events._preview.parameters.amount == 0.75


def test_a_mouse_that_rests_on_the_button_has_not_come_to_the_view(events, monkeypatch):
    sidebar = SimpleNamespace(type="UI", x=800, y=-50, width=100, height=600)
    events.context.area = SimpleNamespace(x=100, width=800, regions=[sidebar])
    events._arrived = False
    monkeypatch.setattr(preview_operator, "_REST", -1.0)
    monkeypatch.setattr(preview_operator, "_REST_TICKS", 1)
    for x in (850, 810):
        events.send("TIMER")
        events.send("MOUSEMOVE", x=x)
    assert "Amount 1 (move mouse)" in events.status[-1]


@pytest.mark.parametrize("key", ["ESC", "RIGHTMOUSE"])
def test_cancelling_changes_nothing(events, key):
    box = bpy.context.object
    before = stored(box)
    events.send("MOUSEMOVE", x=-100)
    shown_by(events)
    assert stored(box) != before
    assert events.send(key) == {"CANCELLED"}
    assert stored(box) == before
    assert events.status[-1] is None
    assert events.ran == []
    assert bpy.context.scene.shock_filter.geometry.amount == 1.0


@pytest.mark.parametrize("key", ["RET", "LEFTMOUSE"])
def test_applying_runs_the_operator_on_the_old_shape(events, key):
    box = bpy.context.object
    before = stored(box)
    events.send("MOUSEMOVE", x=-100)
    shown_by(events)
    events.send("WHEELUPMOUSE")
    assert events.send(key) == {"FINISHED"}
    assert stored(box) == before
    ((given, settings),) = events.ran
    assert given == ("INVOKE_DEFAULT",)
    assert settings["amount"] == 0.75
    assert settings["widest_fillet"] == pytest.approx(2.2)
    assert settings["time"] == 256.0
    assert bpy.context.scene.shock_filter.geometry.amount == 0.75
    assert jobs.previews == []


def test_what_cannot_be_applied_is_an_error_in_words(events):
    bpy.context.scene.shock_filter.geometry.vertex_group = "Nobody"
    preview_operator.bpy.ops = bpy.ops
    assert events.send("RET") == {"CANCELLED"}
    assert "it has no vertex group named 'Nobody'" in events.reports[-1]
    assert jobs.previews == []


def test_undo_and_clicks_are_held_back_and_the_view_can_be_turned(events):
    assert events.send("Z") == {"RUNNING_MODAL"}
    assert events.send("TAB") == {"RUNNING_MODAL"}
    assert events.send("LEFTMOUSE", "RELEASE") == {"RUNNING_MODAL"}
    assert events.send("MIDDLEMOUSE") == {"PASS_THROUGH"}


def test_blenders_handlers_end_it_first(events):
    box = bpy.context.object
    before = stored(box)
    shown_by(events)
    handlers = bpy.app.handlers
    for before_it in (handlers.undo_pre, handlers.redo_pre, handlers.save_pre, handlers.load_pre):
        assert preview_operator.stop in before_it
    preview_operator.stop()
    assert stored(box) == before
    assert jobs.previews == []
    assert events.send("TIMER") == {"CANCELLED"}


def test_a_removed_object_ends_the_operator(events):
    shown_by(events)
    bpy.data.objects.remove(bpy.context.object)
    assert events.send("TIMER") == {"CANCELLED"}
    assert "the object was removed" in events.reports[-1]


def test_a_bug_leaves_the_old_shape(events, monkeypatch):
    box = bpy.context.object
    before = stored(box)
    shown_by(events)
    monkeypatch.setattr(events._preview, "_take", lambda job: 1 / 0)
    events.send("MOUSEMOVE", x=-50)
    with pytest.raises(ZeroDivisionError):
        for _ in range(1000):
            events.send("TIMER")
            time.sleep(0.01)
    assert stored(box) == before
    assert jobs.previews == []


@pytest.mark.parametrize("step", ["_turn", "_follow"])
def test_any_error_while_it_follows_the_mouse_ends_it(events, monkeypatch, step):
    box = bpy.context.object
    before = stored(box)
    shown_by(events)
    monkeypatch.setattr(events, step, lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        events.send("TIMER" if step == "_follow" else "MOUSEMOVE")
    assert stored(box) == before
    assert not jobs.is_previewing()
    assert events.send("TIMER") == {"CANCELLED"}


class _Freed:
    """Like an operator that Blender has freed."""

    def __getattribute__(self, name):
        raise ReferenceError("StructRNA of type SHOCK_FILTER_OT_preview has been removed")


def test_an_operator_that_blender_has_freed_is_no_preview_under_way(events):
    box = bpy.context.object
    before = stored(box)
    shown_by(events)
    events._session.operator = _Freed()
    assert not jobs.is_previewing()
    assert bpy.ops.shock_filter.preview.poll()
    preview_operator.stop()
    assert stored(box) == before
    assert events.status[-1] is None


def test_no_filter_runs_on_what_it_shows(events):
    shown_by(events)
    assert not bpy.ops.shock_filter.sharpen_geometry.poll()
    events.send("ESC", "PRESS")
    assert bpy.ops.shock_filter.sharpen_geometry.poll()


def test_the_button_says_what_is_missing(rounded_box):
    poll = bpy.ops.shock_filter.preview.poll
    assert not poll()
    box = rounded_box()
    assert poll()
    bpy.ops.object.mode_set(mode="EDIT")
    assert poll()
    bpy.ops.object.mode_set(mode="OBJECT")
    box.select_set(False)
    rounded_box(location=(4, 0, 0))
    bpy.context.view_layer.objects.active = box
    box.select_set(False)
    assert not poll()


def test_without_a_window_it_names_the_filter(rounded_box):
    rounded_box()
    with pytest.raises(RuntimeError, match="run the filter itself"):
        bpy.ops.shock_filter.preview("INVOKE_DEFAULT")
    assert jobs.previews == []


def test_the_time_dial_reaches_from_zero_to_the_steady_state():
    dial = LogarithmicDial(256.0, ABOUT["time"])
    assert dial.value == 256.0
    dial.drag(50)
    assert dial.value == 512.0
    dial.drag(-1e6)
    assert dial.value == 0.0
    dial.drag(1e6)
    assert dial.value == math.inf
    assert LogarithmicDial(math.inf, ABOUT["time"]).value == math.inf
    assert LogarithmicDial(0.0, ABOUT["time"]).value == 0.0
    kernel = describe(BeltramiSettings)["time"][2]
    dial = LogarithmicDial(1.0, kernel)
    dial.drag(1e6)
    assert dial.value <= kernel.maximum
    bounded = LogarithmicDial(1.0, ABOUT["max_displacement"])
    bounded.drag(1e6)
    assert bounded.value == pytest.approx(80.0)


def test_shares_have_a_linear_dial_and_times_and_widths_none():
    strength = describe(BeltramiGeometrySettings)["strength"][2]
    dial = dial_of(1.0, strength, 14)
    assert isinstance(dial, LinearDial)
    dial.drag(-100)
    assert dial.value == 0.75
    dial.drag(40)
    assert dial.value == 0.85
    dial.drag(1e6)
    assert dial.value == 2.0
    dial.drag(-1e6)
    assert dial.value == 0.0
    for name in ("time", "widest_fillet", "max_displacement"):
        assert isinstance(dial_of(1.0, ABOUT[name], 14), LogarithmicDial), name


@pytest.mark.parametrize("time", [0.1, 1234.5, 65536.0, 100_000.0])
def test_small_moves_change_any_time_a_little(time):
    for pixels in (0.5, -0.5):
        dial = LogarithmicDial(time, ABOUT["time"])
        dial.drag(pixels)
        ends = {math.inf if pixels > 0 else 0.0}
        assert dial.value in ends or dial.value == pytest.approx(time, rel=0.02)
    dial = LogarithmicDial(time, ABOUT["time"])
    dial.drag(-0.5 if time > 1 else 0.5)
    assert dial.value == pytest.approx(time, rel=0.02)


def test_the_wheel_leaves_values_beyond_its_range():
    threshold, passes = ABOUT["feature_threshold"], ABOUT["smoothing_passes"]
    assert turned(30, int, passes, 1.0) == 30
    assert turned(30, int, passes, -1.0) == 29
    assert turned(5.00001, float, threshold, 1.0) == 5.00001
    assert turned(5.0, float, threshold, -1.0) == 4.9


def test_the_wheel_stays_in_range():
    threshold, passes = ABOUT["feature_threshold"], ABOUT["smoothing_passes"]
    assert turned(1.1, float, threshold, 1.0) == 1.2
    assert turned(1.1, float, threshold, -0.1) == 1.09
    assert turned(0.05, float, threshold, -1.0) == 0.0
    assert turned(2.0, float, threshold, 1.0) == 2.0
    assert turned(1, int, passes, 0.1) == 2
    assert turned(0, int, passes, -1.0) == 0
    assert turned(16, int, passes, 1.0) == 16
