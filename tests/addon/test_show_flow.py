# SPDX-License-Identifier: GPL-3.0-or-later
"""The operators Show Flow and Hide Flow, and what the overlay draws."""

from types import SimpleNamespace

import bmesh
import bpy
import numpy as np
import pytest
from mathutils import Matrix
from shock_filter import core
from shock_filter.core.host.inputs import ColoredSurface
from shock_filter.core.preview.arrows import arrows, potential_colors
from shock_filter.core.preview.flow import flow_of_colors
from shock_filter.shock_addon.data.arrays import read_attribute
from shock_filter.shock_addon.data.mesh.flow import FLOW, POTENTIAL
from shock_filter.shock_addon.data.mesh.meshes import (
    read_corner_vertices,
    read_positions,
    read_triangle_corners,
)
from shock_filter.shock_addon.flow import drawing as flow_drawing
from shock_filter.shock_addon.flow import showing as flow_shown
from shock_filter.shock_addon.operators import base as operators


def show_flow(**choices):
    """Show the flow, and keep it in attributes, so that it can be read."""
    return bpy.ops.shock_filter.show_flow(attributes=True, **choices)


def read_flow(mesh):
    """Read the potential and the flow; None if the mesh has no such attributes."""
    found = [mesh.attributes.get(name) for name in (POTENTIAL, FLOW)]
    return None if None in found else tuple(read_attribute(each) for each in found)


hide_flow = bpy.ops.shock_filter.hide_flow


def centers(mesh):
    return np.array([polygon.center for polygon in mesh.polygons])


def test_the_flow_of_a_rounded_box_points_to_its_edges(rounded_box):
    box = rounded_box(cuts=15)
    before = read_positions(box.data)
    assert show_flow(mode="geometry") == {"FINISHED"}
    potential, flow = read_flow(box.data)
    assert (potential >= 0).all()
    height = np.sort(np.abs(read_positions(box.data)), axis=1)
    middle = height[:, 1] < 0.3  # of a side of the box
    assert potential[middle].max() < 0.01 * potential.max()
    # Towards an edge two coordinates are large: along the flow the second largest grows.
    place = centers(box.data)
    speed = np.linalg.norm(flow, axis=1)
    strong = speed > 0.2 * speed.max()
    ahead = place[strong] + 0.02 * flow[strong] / speed[strong, None]
    second = np.sort(np.abs(place[strong]), axis=1)[:, 1]
    assert (np.sort(np.abs(ahead), axis=1)[:, 1] > second).mean() > 0.9
    np.testing.assert_array_equal(read_positions(box.data), before)
    assert operators.summaries["geometry"].startswith("Wrote .shock_potential and .shock_flow to")


def test_the_flow_is_that_of_the_core_with_the_panels_settings(rounded_box):
    box = rounded_box()
    settings = bpy.context.scene.shock_filter.geometry
    settings.feature_threshold = 0.5
    show_flow()
    mesh = box.data
    triangles = read_corner_vertices(mesh)[read_triangle_corners(mesh)]
    surface = core.TriangleMesh(read_positions(mesh), triangles)
    expected, vectors = core.geometry_flow(surface, core.GeometrySettings(feature_threshold=0.5))
    potential, flow = read_flow(mesh)
    np.testing.assert_allclose(potential, expected, rtol=1e-5)
    pairs = vectors.reshape(-1, 2, 3).mean(axis=1) * surface.mean_edge_length
    np.testing.assert_allclose(flow, pairs, atol=1e-6)


@pytest.mark.parametrize("domain", ["POINT", "CORNER"])
@pytest.mark.parametrize("channels", ["coupled", "luminance"])
def test_the_flow_of_colors_points_to_the_edge(painted_sheet, domain, channels):
    sheet = painted_sheet(domain=domain)
    bpy.context.scene.shock_filter.colors.channels = channels
    assert show_flow(mode="colors") == {"FINISHED"}
    potential, flow = read_flow(sheet.data)
    x = read_positions(sheet.data)[:, 0]
    peak = x[potential.argmax()]
    assert abs(peak) < 0.15
    place = centers(sheet.data)[:, 0] - peak
    beside = (np.abs(place) > 0.1) & (np.abs(place) < 0.3)
    assert (np.sign(flow[beside, 0]) == -np.sign(place[beside])).all()


def test_potentials_keep_their_places_where_cutting_turns_a_face():
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0.5, 0, 1]], np.float32)
    wings = np.array([[0, 1, 2], [0, 1, 3], [0, 1, 4]], np.int32)  # alike at one edge
    corners = np.arange(9, dtype=np.int32).reshape(3, 3)
    colors = np.repeat(np.array([0.0, 0.2, 0.9, 0.4, 0.5], np.float32)[wings].reshape(9, 1), 3, 1)
    colors[6:8] = [[7.0], [7.5]]  # the third wing hangs on by nothing
    surface = ColoredSurface(points, wings, None, np.identity(3), colors, corners, None, 0)
    flow = flow_of_colors(surface, core.ShockSettings(), weld=False, progress=None)
    cut = core.TriangleMesh(points[[0, 1, 2, 3, 0, 1, 4]], [[0, 1, 2], [0, 1, 3], [4, 5, 6]])
    expected, _ = core.flow_field(cut, colors[[0, 1, 2, 5, 6, 7, 8]], core.ShockSettings())
    highest = [*np.maximum(expected[:2], expected[4:6]), *expected[[2, 3, 6]]]
    np.testing.assert_allclose(flow.potential, highest, rtol=1e-6)


def test_the_flow_is_in_the_objects_own_space(rounded_box):
    box = rounded_box()
    box.matrix_world = Matrix.Diagonal((1.0, 4.0, 1.0, 1.0))
    box.data.transform(box.matrix_world.inverted())  # even in the scaled shape
    bpy.context.view_layer.update()
    show_flow()
    scaled = read_flow(box.data)
    box.data.transform(box.matrix_world)
    box.matrix_world = Matrix.Identity(4)
    bpy.context.view_layer.update()
    show_flow()
    applied = read_flow(box.data)
    np.testing.assert_allclose(scaled[0], applied[0], rtol=1e-3, atol=1e-6)
    np.testing.assert_allclose(scaled[1] * [1, 4, 1], applied[1], atol=1e-4)


def test_only_the_active_object_and_any_mode(rounded_box, select):
    first, second = rounded_box(), rounded_box(location=(4, 0, 0))
    select(first, second)
    bpy.ops.object.mode_set(mode="EDIT")
    assert show_flow() == {"FINISHED"}
    assert bpy.context.mode == "EDIT_MESH"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert read_flow(first.data) is not None
    assert read_flow(second.data) is None


def test_an_attribute_of_another_kind_gives_way(rounded_box):
    box = rounded_box()
    box.data.attributes.new(".shock_potential", "INT", "FACE")
    show_flow()
    assert box.data.attributes[".shock_potential"].data_type == "FLOAT"
    first = read_flow(box.data)
    show_flow()
    np.testing.assert_array_equal(read_flow(box.data)[0], first[0])
    assert ".shock_potential.001" not in box.data.attributes


def test_without_a_window_nothing_is_drawn(rounded_box):
    rounded_box()
    show_flow()
    assert flow_shown.shown_object() is None


class _Shown:
    """Pretends that there is a window, and counts what is registered."""

    def __init__(self, monkeypatch):
        self.handlers = []
        self.view = self
        app = type("App", (), {"background": False, "handlers": bpy.app.handlers})
        types = type("Types", (), {"SpaceView3D": self})
        fake = type("Bpy", (), {"app": app, "types": types, "data": bpy.data})
        fake.context = bpy.context
        monkeypatch.setattr(flow_shown, "bpy", fake)

    def draw_handler_add(self, function, arguments, region, event):
        self.handlers.append(event)
        return event

    def draw_handler_remove(self, handler, region):
        self.handlers.remove(handler)


@pytest.fixture
def window(monkeypatch):
    shown = _Shown(monkeypatch)
    yield shown
    flow_shown.hide()


def registered():
    handlers = bpy.app.handlers
    return [
        function
        for group in (handlers.depsgraph_update_post, handlers.undo_post, handlers.load_pre)
        for function in group
        if function.__module__ == flow_shown.__name__
    ]


def test_what_is_drawn_fits_the_mesh(rounded_box, window, monkeypatch):
    box = rounded_box()
    show_flow()
    shader = SimpleNamespace(from_builtin=lambda name: name)
    monkeypatch.setattr(flow_drawing, "gpu", SimpleNamespace(shader=shader))
    monkeypatch.setattr(flow_drawing, "batch_for_shader", lambda *args, **more: (*args, more))
    found = flow_shown._shown.found
    surface = flow_drawing._surface(box.data, found)
    assert len(surface[2]["color"]) == len(box.data.vertices)
    (rims, _), (shapes, _) = flow_drawing._arrows(box.data, found, 0.2)
    assert len(rims[2]["pos"]) == len(shapes[2]["pos"]) > 0


def test_the_mesh_stays_as_it_is(rounded_box, window):
    box = rounded_box()
    names = set(box.data.attributes.keys())
    assert bpy.ops.shock_filter.show_flow(mode="geometry") == {"FINISHED"}
    assert set(box.data.attributes.keys()) == names
    assert operators.summaries["geometry"].startswith(f"Computed the flow of {box.name}, ")
    hide_flow()
    assert set(box.data.attributes.keys()) == names


@pytest.mark.parametrize(("zoom", "finer"), [(2.0, 0.5), (4.0, 0.25), (0.25, 4.0)])
def test_arrows_are_as_dense_on_screen_however_close_the_view_is(
    rounded_box, monkeypatch, zoom, finer
):
    box = rounded_box()
    bpy.context.view_layer.update()
    system = SimpleNamespace(ui_scale=1.0)
    preferences = SimpleNamespace(system=system)
    fake = SimpleNamespace(context=SimpleNamespace(preferences=preferences))
    monkeypatch.setattr(flow_drawing, "bpy", fake)
    region = SimpleNamespace(width=1000)

    def distance(size, scale=1.0):
        box.matrix_world = Matrix.Diagonal((scale, scale, scale, 1.0))
        window = Matrix.Diagonal((size, size, 0.1, 1.0))  # without perspective
        view = SimpleNamespace(perspective_matrix=window, window_matrix=window)
        return flow_drawing._distance(box, region, view)

    assert distance(0.1 * zoom) == pytest.approx(finer * distance(0.1))
    assert distance(0.1 * zoom, 2.0) == pytest.approx(0.5 * distance(0.1 * zoom))
    assert distance(1e9) >= 0.01  # a close view has not more arrows than can be drawn


def test_hiding_the_flow_draws_nothing_more(rounded_box, window):
    box = rounded_box()
    assert show_flow() == {"FINISHED"}
    assert flow_shown.shown_object() == box.name
    assert window.handlers == ["POST_VIEW", "POST_PIXEL"]
    assert len(registered()) == 3
    box.select_set(False)
    bpy.context.view_layer.objects.active = None
    assert hide_flow() == {"FINISHED"}
    assert not hide_flow.poll()
    assert flow_shown.shown_object() is None
    assert window.handlers == []
    assert registered() == []
    assert read_flow(box.data) is not None  # as they were asked for


def test_another_object_takes_over(rounded_box, select, window):
    first, second = rounded_box(), rounded_box(location=(4, 0, 0))
    select(first)
    show_flow()
    select(second)
    assert show_flow() == {"FINISHED"}
    assert flow_shown.shown_object() == second.name
    assert len(window.handlers) == 2
    assert show_flow() == {"FINISHED"}
    assert len(window.handlers) == 2


def test_the_flow_is_not_exported(rounded_box, tmp_path):
    rounded_box(cuts=1)
    show_flow()
    path = tmp_path / "box.ply"
    bpy.ops.wm.ply_export(filepath=str(path))
    assert b"element vertex" in path.read_bytes()
    assert b"shock" not in path.read_bytes()


def test_the_overlay_follows_a_new_name_and_ends_with_the_object(rounded_box, window):
    box = rounded_box()
    show_flow()
    box.name = "Renamed"
    bpy.context.view_layer.update()
    assert flow_shown._shown.object() == box
    assert flow_shown.shown_object() == "Renamed"
    bpy.data.objects.remove(box)
    bpy.context.view_layer.update()
    assert flow_shown.shown_object() is None
    assert window.handlers == []


def test_the_overlay_ends_when_the_mesh_is_another_one_or_the_file_goes(rounded_box, window):
    box = rounded_box()
    show_flow()
    box.data.vertices.add(1)
    box.data.update()
    bpy.context.view_layer.update()
    assert flow_shown.shown_object() is None
    show_flow()
    assert flow_shown.shown_object() == box.name
    bpy.ops.wm.read_homefile(use_empty=True)
    assert flow_shown.shown_object() is None
    assert window.handlers == []
    assert registered() == []


def test_editing_the_mesh_by_another_object_draws_nothing_meanwhile(rounded_box, select, window):
    box = rounded_box()
    twin = box.copy()
    bpy.context.collection.objects.link(twin)
    show_flow()
    view = SimpleNamespace(overlay=SimpleNamespace(show_overlays=True))
    seen = SimpleNamespace(
        type="MESH", mode="OBJECT", data=box.data, visible_get=lambda viewport: True
    )
    assert flow_drawing.is_seen(seen, view)
    select(twin)
    bpy.ops.object.mode_set(mode="EDIT")
    assert box.mode == "OBJECT"
    flow_shown._refresh()
    assert not flow_drawing.is_seen(seen, view)
    bmesh.from_edit_mesh(twin.data).verts.ensure_lookup_table()
    bmesh.from_edit_mesh(twin.data).verts[0].co.x += 1.0
    flow_shown._shown.surface = "drawn"
    bpy.ops.object.mode_set(mode="OBJECT")
    assert flow_shown._shown.surface is None
    assert flow_drawing.is_seen(seen, view)


@pytest.mark.parametrize("draw", ["draw_surface", "draw_legend"])
@pytest.mark.parametrize("what", ["hidden", "in Edit Mode", "without overlays"])
def test_neither_surface_nor_legend_is_drawn_when_it_is_not_seen(
    rounded_box, window, monkeypatch, draw, what
):
    box = rounded_box()
    show_flow()
    if what == "in Edit Mode":
        bpy.ops.object.mode_set(mode="EDIT")
    shown = SimpleNamespace(
        type="MESH", mode=box.mode, data=box.data, visible_get=lambda viewport: what != "hidden"
    )
    view = SimpleNamespace(overlay=SimpleNamespace(show_overlays=what != "without overlays"))
    context = SimpleNamespace(space_data=view)  # drawing would need more
    monkeypatch.setattr(flow_drawing, "bpy", SimpleNamespace(context=context))
    assert getattr(flow_drawing, draw)(SimpleNamespace(object=lambda: shown)) is None


def test_edits_are_drawn_anew(rounded_box, window):
    box = rounded_box()
    show_flow()
    flow_shown._shown.surface = "drawn"
    box.location.x += 1
    bpy.context.view_layer.update()
    assert flow_shown._shown.surface == "drawn"
    box.data.vertices[0].co.x += 1
    box.data.update()
    bpy.context.view_layer.update()
    assert flow_shown._shown.surface is None


def test_colors_rise_with_the_potential():
    colors = potential_colors(np.array([0.0, 0.1, 0.5, 1.0, 100.0], dtype=np.float32) ** 2)
    lightness = colors[:, :3] @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness) >= 0).all()
    assert (np.diff(colors[:, 3]) >= 0).all()
    assert colors[0, 2] > colors[0, 0]  # blue
    assert colors[-1, 0] > colors[-1, 2]  # yellow
    flat = potential_colors(np.zeros(3, dtype=np.float32))
    np.testing.assert_array_equal(flat, np.broadcast_to(flat[0], (3, 4)))


def field(count=40, speed=2.0):
    """Faces of a flat square in rows, and a flow in y: centers, normals, flow."""
    x, y = np.meshgrid(np.arange(count, dtype=np.float32), np.arange(count, dtype=np.float32))
    centers = np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1)
    normals = np.broadcast_to(np.float32([0, 0, 1]), centers.shape)
    return centers, normals, np.broadcast_to(np.float32([0, speed, 0]), centers.shape).copy()


def middles(triangles):
    """Return where shafts are, and how long each arrow is in y."""
    corners = triangles.reshape(-1, 9, 3)
    return corners[:, :6].mean(axis=1), np.ptp(corners[:, :, 1], axis=1)


def test_arrows_point_along_the_flow_in_the_faces_plane():
    shapes = arrows(*field(), 4.0).arrows.reshape(-1, 9, 3)
    tips, bases = shapes[:, 7], shapes[:, [6, 8]].mean(axis=1)
    assert (tips[:, 1] > bases[:, 1] + 0.5).all()
    np.testing.assert_allclose(tips[:, 0], bases[:, 0], atol=1e-5)
    assert (shapes[..., 2] == 0).all()


def test_rims_are_all_around_arrows():
    rims, shapes = arrows(*field(), 4.0)
    for axis in (0, 1):
        inner = shapes.reshape(-1, 9, 3)[..., axis]
        outer = rims.reshape(-1, 9, 3)[..., axis]
        assert (outer.min(axis=1) < inner.min(axis=1) - 0.05).all()
        assert (outer.max(axis=1) > inner.max(axis=1) + 0.05).all()


def test_arrows_stand_apart_and_are_not_too_many():
    places, _ = middles(arrows(*field(), 4.0).arrows)
    assert 50 < len(places) < 300
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 9.0 * np.eye(len(places))
    assert apart.min() >= 1.4
    places, _ = middles(arrows(*field(), 0.1).arrows)
    assert len(places) == 1600  # one for each face
    places, lengths = middles(arrows(*field(), 0.1, most=300).arrows)
    assert 50 < len(places) <= 300
    assert lengths.max() > 1.0  # farther from each other, they are longer


def test_the_strongest_flow_nearby_has_the_arrow_and_few_fast_faces_leave_others_long():
    centers, normals, flow = field()
    flow[820] *= 3.0
    places, lengths = middles(arrows(centers, normals, flow, 4.0).arrows)
    assert np.linalg.norm(places[:, :2] - centers[820, :2], axis=1).min() < 1.0
    flow[820] *= 1e6
    _, others = middles(arrows(centers, normals, flow, 4.0).arrows)
    np.testing.assert_allclose(np.sort(others), np.sort(lengths), rtol=1e-5)
    flow[:] = 0.0
    assert len(arrows(centers, normals, flow, 4.0).arrows) == 0
