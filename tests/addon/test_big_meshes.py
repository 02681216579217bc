# SPDX-License-Identifier: GPL-3.0-or-later
"""What the main thread does with large meshes: the quick ways give what Blender's own give."""

import bpy
import numpy as np
import pytest
from shock_filter.core.host.edge_marks import CreaseEdges
from shock_filter.shock_addon.data import arrays
from shock_filter.shock_addon.data.mesh import meshes, shading


@pytest.fixture(params=["triangles", "quads", "mixed", "few"])
def mesh(request):
    """A bent sheet of more triangles than are read one by one, or of fewer."""
    cells = 8 if request.param == "few" else 40
    bpy.ops.mesh.primitive_grid_add(x_subdivisions=cells, y_subdivisions=cells)
    found = bpy.context.object.data
    for vertex in found.vertices:
        vertex.co.z = np.sin(9.0 * vertex.co.x * vertex.co.y)
    if request.param != "quads":
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.select_all(action="SELECT" if request.param == "triangles" else "DESELECT")
        bpy.ops.object.mode_set(mode="OBJECT")
        if request.param == "mixed":
            found.polygons.foreach_set("select", np.arange(len(found.polygons)) % 3 == 0)
        bpy.ops.object.mode_set(mode="EDIT")
        bpy.ops.mesh.quads_convert_to_tris()
        bpy.ops.object.mode_set(mode="OBJECT")
    return found


def test_triangles_are_those_of_blender(mesh):
    mesh.calc_loop_triangles()
    corners = arrays.read(mesh.loop_triangles, "loops", 3, np.int32)
    vertices = arrays.read(mesh.loop_triangles, "vertices", 3, np.int32)
    np.testing.assert_array_equal(meshes.read_triangle_corners(mesh), corners)
    np.testing.assert_array_equal(meshes.read_triangles(mesh), vertices)


def test_triples_that_lie_otherwise_in_memory_are_asked_for(mesh, monkeypatch):
    mesh.calc_loop_triangles()
    asked = []
    read = arrays.read

    def noted(*words):
        asked.append(words[1])
        return read(*words)

    monkeypatch.setattr(arrays, "read", noted)
    vertices = arrays.view_triples(mesh.loop_triangles, "vertices")  # which are computed
    assert asked == ["vertices"]
    np.testing.assert_array_equal(vertices, read(mesh.loop_triangles, "vertices", 3, np.int32))


def test_creases_among_edges_are_those_of_their_places():
    rng = np.random.default_rng(0)
    places = rng.integers(-1, 50, 80)
    pairs, ends = rng.integers(0, 50, (200, 2)), rng.integers(0, 80, (400, 2))
    wanted = {frozenset(pair) for pair in pairs.tolist()}
    expected = [frozenset(pair) in wanted for pair in places[ends].tolist()]
    assert sum(expected) > 3
    np.testing.assert_array_equal(CreaseEdges(places, pairs).among(ends), expected)
    nothing = np.zeros((0, 2), dtype=np.intp)
    assert not CreaseEdges(places, nothing).among(ends).any()


@pytest.mark.parametrize("shading_of", ["flat", "smooth", "mixed"])
def test_flat_is_what_has_no_smooth_face(mesh, shading_of):
    if shading_of == "smooth":
        mesh.shade_smooth()
    elif shading_of == "flat":
        mesh.shade_flat()
    else:
        mesh.shade_flat()
        mesh.polygons[3].use_smooth = True
    assert shading.is_flat(mesh) == (shading_of == "flat")
