# SPDX-License-Identifier: GPL-3.0-or-later
"""Mesh files: what changes, what survives, what is refused."""

import errno
import json
import os
import shutil
import signal
import struct
import subprocess
import sys

import numpy as np
import pytest
import trimesh
from on_files import sharpen_colors_file, sharpen_file
from PIL import Image
from scipy.spatial import cKDTree
from shock_filter import core
from shock_filter.core.files import staging
from shock_filter.core.files.formats.mesh import obj
from shock_filter.core.files.meshes import (
    IN_PLACE,
    filter_colors_file,
    filter_mesh_file,
    read_document,
)
from shock_filter.core.files.output import staged

STILL = core.GeometrySettings(time=0)
STRONG = core.GeometrySettings.of_paper(time=256, feature_threshold=0, sampling="linear")
"""What moves all vertices of small shapes, which have no creases that the default sharpens."""


def rounded_box(size=1.0):
    """A box of 386 vertices whose edges were smoothed away."""
    box = trimesh.creation.box(extents=(size, size, size)).subdivide().subdivide().subdivide()
    trimesh.smoothing.filter_laplacian(box, iterations=4)
    return np.array(box.vertices), np.array(box.faces, dtype=np.int64)


def expected(vertices, faces, settings=STRONG):
    return core.sharpen_geometry(core.TriangleMesh(vertices, faces), settings)


def obj_text(vertices, faces, first=1):
    rows = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
    rows += [f"f {a + first} {b + first} {c + first}" for a, b, c in faces]
    return "\n".join(rows) + "\n"


def read_obj(path):
    """Positions and the words of the faces."""
    lines = [line.split() for line in path.read_text().splitlines()]
    positions = np.array([line[1:4] for line in lines if line[:1] == ["v"]], dtype=float)
    return positions, [line[1:] for line in lines if line[:1] == ["f"]]


def ply_bytes(vertices, faces, extra=(), order="<", before=b""):
    """A binary PLY file; `extra` holds (name, PLY type, numpy type, values) of vertices."""
    fields = [(axis, order + "f4") for axis in "xyz"] + [(n, order + t) for n, _, t, _ in extra]
    table = np.zeros(len(vertices), dtype=fields)
    for k, axis in enumerate("xyz"):
        table[axis] = vertices[:, k]
    for name, _, _, values in extra:
        table[name] = values
    rows = np.zeros(len(faces), dtype=[("n", "u1"), ("v", order + "i4", faces.shape[1])])
    rows["n"], rows["v"] = faces.shape[1], faces
    names = [("float", axis) for axis in "xyz"] + [(kind, n) for n, kind, _, _ in extra]
    header = [
        "ply",
        f"format binary_{'little' if order == '<' else 'big'}_endian 1.0",
        "comment a scan",
        *(["element camera 1", "property double focal"] if before else []),
        f"element vertex {len(vertices)}",
        *[f"property {kind} {name}" for kind, name in names],
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + before + table.tobytes() + rows.tobytes()


def ply_table(data, fields, count, start=None):
    start = data.index(b"end_header\n") + 11 if start is None else start
    return np.frombuffer(data, np.dtype(fields), count, start)


def seams(vertices, faces):
    """Give every triangle its own vertices, as the worst of UV seams does."""
    return vertices[faces.reshape(-1)], np.arange(faces.size).reshape(-1, 3)


def farthest(points, others):
    """The largest distance from a point to the nearest of the others."""
    return cKDTree(others).query(points)[0].max()


def assert_closed(positions, faces):
    assert trimesh.Trimesh(positions, faces, process=True).is_watertight


# -------------------------------------------------------------------------------------------- OBJ

QUADS = b"""# made by hand\r
mtllib box.mtl\r
o box\r
v 0 0 0 0.5 0.25 1\r
v 1.0 0 0 0.5 0.25 1\r
v  1 1 0 0.5 0.25 1\r
v 0 1.000 0 0.5 0.25 1\r
v 0 0 1 0.5 0.25 1\r
v 1 0 1 0.5 0.25 1\r
v 1 1 1.5 0.5 0.25 1\r
v 0 1 1 0.5 0.25 1\r
vt 0 0\r
vt 1 0\r
usemtl red stuff\r
s 1\r
f 1/1 4/2 3/1 2/2 # the floor\r
f 5/1 6/2 7/1 8/2\r
f 1/1 2/2 6/1 5/2\r
usemtl blue\r
f 2/1 3/2 7/1 6/2\r
f 3/1 4/2 8/1 7/2\r
f -8/1 -4/2 -1/1 -5/2\r
l 1 2\r
"""


def test_obj_changes_vertex_lines_only(tmp_path):
    (tmp_path / "in.obj").write_bytes(QUADS)
    outcome = sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STRONG)
    assert outcome.total == 8
    assert 0 < outcome.changed <= 8
    before, after = (
        (tmp_path / name).read_bytes().splitlines(keepends=True) for name in ("in.obj", "out.obj")
    )
    assert len(before) == len(after)
    for old, new in zip(before, after, strict=True):
        if old.startswith(b"v "):
            assert new.startswith(b"v ")
            assert new.endswith(b" 0.5 0.25 1\r\n")
        else:
            assert old == new
    changed = sum(a != b for a, b in zip(before, after, strict=True))
    assert changed == outcome.changed


def test_obj_gives_the_core_result_in_file_order(tmp_path):
    vertices, faces = rounded_box()
    (tmp_path / "in.obj").write_text(obj_text(vertices, faces))
    sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STRONG)
    positions, _ = read_obj(tmp_path / "out.obj")
    np.testing.assert_allclose(positions, expected(vertices, faces), atol=1e-9)
    assert abs(positions - vertices).max() > 0.01


def test_obj_relative_indices_mean_the_same(tmp_path):
    vertices, faces = rounded_box()
    (tmp_path / "a.obj").write_text(obj_text(vertices, faces))
    (tmp_path / "b.obj").write_text(obj_text(vertices, faces, first=-len(vertices)))
    for name in "ab":
        sharpen_file(tmp_path / f"{name}.obj", tmp_path / f"{name}2.obj", STRONG)
    np.testing.assert_array_equal(
        read_obj(tmp_path / "a2.obj")[0], read_obj(tmp_path / "b2.obj")[0]
    )


def test_obj_time_zero_returns_the_same_bytes(tmp_path):
    text = QUADS.replace(b"vt 0 0", b"vn 0 0 1").replace(b"1/1 ", b"1//1 ")
    (tmp_path / "in.obj").write_bytes(text)
    outcome = sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STILL)
    assert outcome.changed == 0
    assert (tmp_path / "out.obj").read_bytes() == text


def normals_at_corners(path):
    lines = [line.split() for line in path.read_text().splitlines()]
    normals = np.array([line[1:] for line in lines if line[:1] == ["vn"]], dtype=float)
    corners = [[c.split("/") for c in line[1:]] for line in lines if line[:1] == ["f"]]
    return normals[[[int(c[2]) - 1 for c in face] for face in corners]]


def test_obj_normals_are_renewed_and_hard_edges_stay_hard(tmp_path):
    vertices, faces = rounded_box()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rows = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
    # One normal for each face, but those that point up share theirs, as exporters write it.
    shared = np.where(mesh.face_normals[:, 2] > 0.99, 0, np.arange(len(faces)))
    rows += ["vn {:.6f} {:.6f} {:.6f}".format(*n) for n in mesh.face_normals]
    rows += [
        f"f {a + 1}//{n + 1} {b + 1}//{n + 1} {c + 1}//{n + 1}"
        for (a, b, c), n in zip(faces, shared, strict=True)
    ]
    (tmp_path / "in.obj").write_text("\n".join(rows))
    outcome = sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STRONG)
    assert any("normals" in note for note in outcome.notes)
    positions, _ = read_obj(tmp_path / "out.obj")
    new = trimesh.Trimesh(positions, faces, process=False).face_normals
    corners = normals_at_corners(tmp_path / "out.obj")
    hard = shared != 0
    np.testing.assert_allclose(corners[hard], np.repeat(new[hard][:, None], 3, 1), atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(corners, axis=2), 1, atol=1e-9)


def test_obj_materials_and_textures_come_along(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "in/textures/wood").mkdir(parents=True)
    (tmp_path / "in/a.obj").write_bytes(QUADS)
    (tmp_path / "in/box.mtl").write_text(
        "newmtl blue\nmap_Kd -s 2 2 textures/wood/a.png\nmap_Bump my bump.png\nmap_Ks ../gone.png\n"
    )
    (tmp_path / "in/textures/wood/a.png").write_bytes(b"wood")
    (tmp_path / "in/my bump.png").write_bytes(b"bump")
    outcome = sharpen_file(tmp_path / "in/a.obj", tmp_path / "out/b.obj", STRONG)
    assert (tmp_path / "out/textures/wood/a.png").read_bytes() == b"wood"
    assert (tmp_path / "out/my bump.png").read_bytes() == b"bump"
    assert (tmp_path / "out/box.mtl").read_bytes() == (tmp_path / "in/box.mtl").read_bytes()
    assert any("../gone.png" in note for note in outcome.notes)


def test_side_files_of_others_are_not_replaced(tmp_path):
    (tmp_path / "in").mkdir()
    (tmp_path / "out").mkdir()
    (tmp_path / "in/a.obj").write_bytes(QUADS)
    (tmp_path / "in/box.mtl").write_text("newmtl blue\n")
    (tmp_path / "out/box.mtl").write_text("newmtl other\n")
    with pytest.raises(core.ShockError, match=r"box\.mtl exists already"):
        sharpen_file(tmp_path / "in/a.obj", tmp_path / "out/a.obj", STRONG)
    assert [path.name for path in (tmp_path / "out").iterdir()] == ["box.mtl"]
    assert (tmp_path / "out/box.mtl").read_text() == "newmtl other\n"


def test_objects_are_sharpened_on_their_own(tmp_path):
    vertices, faces = rounded_box()
    large = vertices * 100 + 500
    text = "o small\n" + obj_text(vertices, faces) + "o large\n"
    text += obj_text(large, faces, first=1 + len(vertices))
    text += "o flat\nv 9 9 9\nv 8 8 8\nv 7 7 7\nf -1 -2 -3\n"
    (tmp_path / "in.obj").write_text(text)
    sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STRONG)
    positions, _ = read_obj(tmp_path / "out.obj")
    n = len(vertices)
    np.testing.assert_allclose(positions[:n], expected(vertices, faces), atol=1e-9)
    np.testing.assert_allclose(positions[n : 2 * n], expected(large, faces), atol=1e-6)
    np.testing.assert_array_equal(positions[2 * n :], [[9] * 3, [8] * 3, [7] * 3])


# -------------------------------------------------------------------------------------------- PLY


@pytest.mark.parametrize("order", ["<", ">"])
def test_ply_changes_positions_and_normals_only(tmp_path, order):
    vertices, faces = rounded_box()
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    extra = [
        ("quality", "double", "f8", np.linspace(0, 1, len(vertices))),
        *[(name, "float", "f4", normals[:, k]) for k, name in enumerate(("nx", "ny", "nz"))],
        ("red", "uchar", "u1", np.arange(len(vertices)) % 256),
    ]
    data = ply_bytes(vertices, faces, extra, order, before=struct.pack(order + "d", 35.0))
    (tmp_path / "in.ply").write_bytes(data)
    outcome = sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    result = (tmp_path / "out.ply").read_bytes()
    start = data.index(b"end_header\n") + 11 + 8
    fields = [(name, order + "f4") for name in "xyz"]
    fields += [(name, order + t) for name, _, t, _ in extra]
    end = start + len(vertices) * np.dtype(fields).itemsize
    assert (result[:start], result[end:]) == (data[:start], data[end:])
    old, new = (ply_table(blob, fields, len(vertices), start) for blob in (data, result))
    for name in ("quality", "red"):
        np.testing.assert_array_equal(new[name], old[name])
    positions = np.column_stack([new[axis] for axis in "xyz"])
    exact = np.column_stack([old[axis] for axis in "xyz"]).astype(float)
    np.testing.assert_allclose(positions, expected(exact, faces), atol=1e-6)
    smooth = trimesh.Trimesh(positions, faces, process=False)
    given = np.column_stack([new[name] for name in ("nx", "ny", "nz")])
    np.testing.assert_allclose(np.linalg.norm(given, axis=1), 1, atol=1e-6)
    assert np.einsum("ij,ij->i", given, smooth.vertex_normals).min() > 0.9
    assert abs(given - normals).max() > 0.05
    assert outcome.notes == ("normals were computed anew from the changed surface",)


def test_ply_quads_stay_quads(tmp_path):
    (tmp_path / "in.obj").write_bytes(QUADS)
    vertices, words = read_obj(tmp_path / "in.obj")
    quads = np.array([[int(w.split("/")[0]) for w in face] for face in words[1:5]]) - 1
    data = ply_bytes(vertices, quads)
    (tmp_path / "in.ply").write_bytes(data)
    outcome = sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    result = (tmp_path / "out.ply").read_bytes()
    assert outcome.changed > 0
    assert len(result) == len(data)
    assert result[-quads.size * 4 - len(quads) :] == data[-quads.size * 4 - len(quads) :]


@pytest.mark.parametrize("kind, dtype", [("char", "i1"), ("short", "i2")])
def test_ply_normals_of_whole_numbers_are_renewed_as_such(tmp_path, kind, dtype):
    vertices, faces = rounded_box()
    normals = trimesh.Trimesh(vertices, faces, process=False).vertex_normals
    most = np.iinfo(dtype).max
    names = ("nx", "ny", "nz")
    extra = [(name, kind, dtype, np.rint(most * normals[:, k])) for k, name in enumerate(names)]
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces, extra))
    sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    fields = [(axis, "<f4") for axis in "xyz"] + [(name, f"<{dtype}") for name in names]
    table = ply_table((tmp_path / "out.ply").read_bytes(), fields, len(vertices))
    positions = np.column_stack([table[axis] for axis in "xyz"])
    given = np.column_stack([table[name] for name in names]) / most
    np.testing.assert_allclose(np.linalg.norm(given, axis=1), 1, atol=0.02)
    smooth = trimesh.Trimesh(positions, faces, process=False).vertex_normals
    assert np.einsum("ij,ij->i", given, smooth).min() > 0.9


ROOF = [[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0], [0, 1, 1.5], [2, 1, 1.5], [3, 1, 0]]
MIXED = [[0, 1, 5, 4], [2, 3, 4, 5], [0, 4, 3], [0, 3, 2, 6, 1], [1, 6, 5], [6, 2, 5]]


def mixed_ply(faces, order=None, lengths="uchar", corners="int", extra=False):
    """A PLY file of polygons of different sizes; text without an order."""
    codes = {"uchar": "B", "ushort": "H", "int": "i", "uint": "I"}
    header = ["ply", "comment ü", f"element vertex {len(ROOF)}"]
    words = {None: "ascii", "<": "binary_little_endian", ">": "binary_big_endian"}
    header.insert(1, f"format {words[order]} 1.0")
    header += [f"property double {axis}" for axis in "xyz"] + [f"element face {len(faces)}"]
    header += ["property float quality"] * extra
    header += [f"property list {lengths} {corners} vertex_indices", "end_header\n"]
    head = "\n".join(header).encode()
    flags = [0.1 * number for number in range(len(faces))]
    if order is None:
        rows = [" ".join(map(repr, map(float, point))) for point in ROOF]
        for flag, face in zip(flags, faces, strict=True):
            rows.append(" ".join(map(str, [flag] * extra + [len(face), *face])))
        return head + "\n".join(rows).encode() + b"\n"
    body = np.array(ROOF, f"{order}f8").tobytes()
    for flag, face in zip(flags, faces, strict=True):
        body += struct.pack(f"{order}f", flag) * extra
        code = f"{order}{codes[lengths]}{len(face)}{codes[corners]}"
        body += struct.pack(code, len(face), *face)
    return head + body


@pytest.mark.parametrize(
    "form",
    [
        {"order": "<"},
        {"order": ">", "extra": True},
        {"order": ">", "lengths": "int", "corners": "uint"},
        {"order": "<", "lengths": "ushort", "corners": "uchar"},
    ],
)
@pytest.mark.parametrize("start", range(4))  # trimesh takes the first length for all
def test_binary_ply_files_hold_polygons_of_any_sizes(tmp_path, form, start):
    faces = MIXED[start:] + MIXED[:start]
    data = mixed_ply(faces, **form)
    (tmp_path / "a.ply").write_bytes(data)
    (tmp_path / "b.ply").write_bytes(mixed_ply(faces))
    found, wanted = (IN_PLACE[".ply"](tmp_path / name) for name in ("a.ply", "b.ply"))
    np.testing.assert_array_equal(found.faces, wanted.faces)
    assert len(found.faces) == sum(len(face) - 2 for face in faces)
    np.testing.assert_array_equal(found.vertices, ROOF)
    assert sharpen_file(tmp_path / "a.ply", tmp_path / "out.ply", STRONG).changed
    assert (tmp_path / "out.ply").read_bytes()[-10:] == data[-10:]
    outcome = sharpen_file(tmp_path / "a.ply", tmp_path / "out.obj", STRONG)
    assert "polygons were cut into triangles" in outcome.notes


def test_binary_ply_files_may_have_empty_tables_and_polygons(tmp_path):
    data = mixed_ply([*MIXED, []], "<")
    head = b"element edge 0\nproperty int vertex1\nproperty list uchar int others\nend_header\n"
    (tmp_path / "a.ply").write_bytes(data.replace(b"end_header\n", head))
    found = IN_PLACE[".ply"](tmp_path / "a.ply")
    assert len(found.faces) == sum(len(face) - 2 for face in MIXED)


def test_binary_ply_polygons_are_not_told_by_the_length_of_the_file(tmp_path):
    faces = [[0, 1, 5, 4], [0, 4, 3], [0, 3, 2, 6, 1]]  # as long as three quads
    (tmp_path / "a.ply").write_bytes(mixed_ply(faces, "<"))
    (tmp_path / "b.ply").write_bytes(mixed_ply(faces))
    found, wanted = (IN_PLACE[".ply"](tmp_path / name) for name in ("a.ply", "b.ply"))
    np.testing.assert_array_equal(found.faces, wanted.faces)


@pytest.mark.parametrize("cut", [1, 5, 30])
def test_binary_ply_files_that_end_in_a_polygon_are_damaged(tmp_path, cut):
    (tmp_path / "a.ply").write_bytes(mixed_ply(MIXED, "<")[:-cut])
    with pytest.raises(core.ShockError, match="less data than its header says"):
        sharpen_file(tmp_path / "a.ply", tmp_path / "out.ply", STRONG)


def text_ply(vertices, faces, value="0.50"):
    rows = [f"{x:.9g}  {y:.9g} {z:.9g} {value} 7" for x, y, z in vertices]
    rows += [f"3 {a} {b} {c}" for a, b, c in faces]
    header = f"""ply
format ascii 1.0
element vertex {len(vertices)}
property float x
property float y
property float z
property float quality
property int tag
element face {len(faces)}
property list uchar int vertex_indices
end_header
"""
    return header + "\n".join(rows) + "\n"


def test_text_ply_keeps_all_words_but_positions(tmp_path):
    vertices, faces = rounded_box()
    (tmp_path / "in.ply").write_text(text_ply(vertices, faces))
    outcome = sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    old, new = ((tmp_path / name).read_text().splitlines() for name in ("in.ply", "out.ply"))
    assert outcome.changed > 300
    assert len(old) == len(new)
    rows = slice(old.index("end_header") + 1, old.index("end_header") + 1 + len(vertices))
    assert all(line.endswith(" 0.50 7") for line in new[rows])
    positions = np.array([line.split()[:3] for line in new[rows]], dtype=float)
    np.testing.assert_allclose(positions, expected(vertices, faces), atol=1e-6)
    assert new[: rows.start] == old[: rows.start]
    assert new[rows.stop :] == old[rows.stop :]


def test_coordinates_of_whole_numbers_are_refused(tmp_path):
    vertices, faces = rounded_box()
    text = text_ply(np.rint(100 * vertices), faces)
    for axis in "xyz":
        text = text.replace(f"property float {axis}", f"property int {axis}")
    (tmp_path / "in.ply").write_text(text)
    with pytest.raises(core.ShockError, match="save them as float"):
        sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    assert not (tmp_path / "out.ply").exists()


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_ply_time_zero_returns_the_same_bytes(tmp_path, kind):
    vertices, faces = rounded_box()
    vertices[0] = [-0.0, 0.0, 1e-30]
    text = text_ply(vertices, faces).encode()
    data = ply_bytes(vertices, faces) if kind == "binary" else text
    (tmp_path / "in.ply").write_bytes(data)
    assert sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STILL).changed == 0
    assert (tmp_path / "out.ply").read_bytes() == data


@pytest.mark.parametrize("name", ["weight", "byte"])
def test_ply_mask_holds_vertices_bit_for_bit(tmp_path, name):
    vertices, faces = rounded_box()
    held = vertices[:, 0] < 0
    extra = [
        ("weight", "float", "f4", ~held),
        ("byte", "uchar", "u1", np.where(held, 0, 255)),
    ]
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces, extra))
    fields = [(axis, "<f4") for axis in "xyz"] + [("weight", "<f4"), ("byte", "u1")]
    old = ply_table((tmp_path / "in.ply").read_bytes(), fields, len(vertices))
    for invert, still in ((False, held), (True, ~held)):
        target = tmp_path / f"{invert}.ply"
        sharpen_file(tmp_path / "in.ply", target, STRONG, mask=name, invert_mask=invert)
        new = ply_table(target.read_bytes(), fields, len(vertices))
        moved = np.any([old[axis] != new[axis] for axis in "xyz"], axis=0)
        assert not moved[still].any()
        assert moved[~still].sum() > 50


def test_weights_above_1_are_refused(tmp_path):
    vertices, faces = rounded_box()
    weights = np.full(len(vertices), 5.0)
    (tmp_path / "in.ply").write_bytes(
        ply_bytes(vertices, faces, [("weight", "float", "f4", weights)])
    )
    with pytest.raises(core.ShockError, match="1"):
        sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG, mask="weight")
    assert not (tmp_path / "out.ply").exists()


@pytest.mark.parametrize("kind, dtype, most", [("uchar", "u1", 255), ("int", "i4", 2147483647)])
def test_masks_of_flags_in_whole_numbers_are_refused(tmp_path, kind, dtype, most):
    vertices, faces = rounded_box()
    flags = vertices[:, 0] > 0
    source, target = tmp_path / "in.ply", tmp_path / "out.ply"
    source.write_bytes(ply_bytes(vertices, faces, [("flag", kind, dtype, flags)]))
    with pytest.raises(core.ShockError, match=f"'flag' reaches 1, of {most} .* save it as float"):
        sharpen_file(source, target, STRONG, mask="flag")
    assert not target.exists()
    source.write_bytes(ply_bytes(vertices, faces, [("flag", kind, dtype, 0 * flags)]))
    assert sharpen_file(source, target, STRONG, mask="flag").changed == 0


def test_mask_reaches_split_vertices(tmp_path):
    vertices, faces = seams(*rounded_box())
    free = np.ones(len(vertices))
    free[0] = 0  # one of the several vertices there
    data = ply_bytes(vertices, faces, [("weight", "float", "f4", free)])
    (tmp_path / "in.ply").write_bytes(data)
    sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG, mask="weight")
    fields = [(axis, "<f4") for axis in "xyz"] + [("weight", "<f4")]
    old, new = (
        ply_table((tmp_path / name).read_bytes(), fields, len(vertices))
        for name in ("in.ply", "out.ply")
    )
    there = np.all([old[axis] == old[axis][0] for axis in "xyz"], axis=0)
    assert there.sum() > 3
    for axis in "xyz":
        np.testing.assert_array_equal(new[axis][there], old[axis][there])


def test_unknown_mask_lists_the_properties(tmp_path):
    (tmp_path / "in.ply").write_text(text_ply(*rounded_box()))
    with pytest.raises(core.ShockError, match="'paint'; it has: x, y, z, quality, tag"):
        sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", mask="paint")
    (tmp_path / "in.obj").write_bytes(QUADS)
    with pytest.raises(core.ShockError, match="PLY files only"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", mask="paint")


def test_seams_do_not_crack(tmp_path):
    vertices, faces = rounded_box()
    split, triangles = seams(vertices, faces)
    uv = np.random.default_rng(0).random((len(split), 2))
    extra = [("s", "float", "f4", uv[:, 0]), ("t", "float", "f4", uv[:, 1])]
    (tmp_path / "in.ply").write_bytes(ply_bytes(split, triangles, extra))
    sharpen_file(tmp_path / "in.ply", tmp_path / "out.ply", STRONG)
    fields = [(name, "<f4") for name in ("x", "y", "z", "s", "t")]
    table = ply_table((tmp_path / "out.ply").read_bytes(), fields, len(split))
    positions = np.column_stack([table[axis] for axis in "xyz"])
    assert_closed(positions, triangles)
    np.testing.assert_array_equal(table["s"], uv[:, 0].astype("f4"))
    near = expected(vertices.astype("f4").astype(float), faces)[faces.reshape(-1)]
    np.testing.assert_allclose(positions, near, atol=1e-3)


# ------------------------------------------------------------------------------------------- glTF


def two_material_glb(vertices, faces):
    """A textured box in two materials under a node that stretches it, and what it should keep."""
    half = vertices[faces].mean(axis=1)[:, 0] < 0
    scene = trimesh.Scene()
    stretch = np.diag([3.0, 1.0, 0.5, 1.0])
    stretch[:3, 3] = [5, 6, 7]
    image = Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3))
    for name, chosen, color in (("left", half, 255), ("right", ~half, 128)):
        used, corners = np.unique(faces[chosen], return_inverse=True)
        mesh = trimesh.Trimesh(vertices[used], corners.reshape(-1, 3), process=False)
        material = trimesh.visual.material.PBRMaterial(
            name=name, baseColorTexture=image, baseColorFactor=[color, color, color, 255]
        )
        mesh.visual = trimesh.visual.TextureVisuals(uv=vertices[used][:, :2], material=material)
        mesh.vertex_normals  # noqa: B018 (put into the file)
        scene.add_geometry(mesh, geom_name=name, node_name=f"{name} node", transform=stretch)
    return scene.export(file_type="glb", include_normals=True)


def glb_tree(data):
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length])


def test_glb_keeps_all_but_positions_and_normals(tmp_path):
    vertices, faces = rounded_box()
    data = two_material_glb(vertices, faces)
    (tmp_path / "in.glb").write_bytes(data)
    outcome = sharpen_file(tmp_path / "in.glb", tmp_path / "out.glb", STRONG)
    assert outcome.notes == ("normals were computed anew from the changed surface",)
    old, new = (
        trimesh.load_scene(tmp_path / name, process=False) for name in ("in.glb", "out.glb")
    )
    assert set(new.geometry) == {"left", "right"}
    assert set(new.graph.nodes) == set(old.graph.nodes)
    for name, mesh in new.geometry.items():
        np.testing.assert_array_equal(mesh.faces, old.geometry[name].faces)
        np.testing.assert_array_equal(mesh.visual.uv, old.geometry[name].visual.uv)
        assert mesh.visual.material.name == name
        assert mesh.visual.material.baseColorTexture.size == (4, 4)
        assert np.einsum("ij,ij->i", mesh.vertex_normals, np.asarray(mesh.vertices)).min() > 0
    positions = np.vstack(
        [
            trimesh.transform_points(mesh.vertices, new.graph.get(f"{name} node")[0])
            for name, mesh in new.geometry.items()
        ]
    )
    world = vertices.astype("f4") * [3, 1, 0.5] + [5, 6, 7]
    wanted = expected(world, faces)
    assert farthest(positions, wanted) < 1e-3  # float32, and ties of flow-lines
    assert abs(wanted - world).max() > 0.02
    tree = glb_tree((tmp_path / "out.glb").read_bytes())
    for mesh in tree["meshes"]:
        accessor = tree["accessors"][mesh["primitives"][0]["attributes"]["POSITION"]]
        mesh_vertices = new.geometry[mesh["name"]].vertices
        np.testing.assert_allclose(accessor["min"], mesh_vertices.min(axis=0), atol=1e-6)
        np.testing.assert_allclose(accessor["max"], mesh_vertices.max(axis=0), atol=1e-6)


def test_glb_materials_do_not_crack_apart(tmp_path):
    vertices, faces = rounded_box()
    (tmp_path / "in.glb").write_bytes(two_material_glb(vertices, faces))
    sharpen_file(tmp_path / "in.glb", tmp_path / "out.glb", STRONG)
    mesh = trimesh.load_scene(tmp_path / "out.glb", process=False).to_mesh()
    assert_closed(mesh.vertices.round(5), mesh.faces)


def test_glb_time_zero_keeps_the_binary_chunk(tmp_path):
    data = two_material_glb(*rounded_box())
    (tmp_path / "in.glb").write_bytes(data)
    assert sharpen_file(tmp_path / "in.glb", tmp_path / "out.glb", STILL).changed == 0
    result = (tmp_path / "out.glb").read_bytes()
    starts = [20 + struct.unpack_from("<I", blob, 12)[0] for blob in (data, result)]
    assert result[starts[1] :] == data[starts[0] :]
    assert struct.unpack_from("<I", result, 8)[0] == len(result)
    assert glb_tree(result)["nodes"] == glb_tree(data)["nodes"]


def test_gltf_leaves_its_input_alone(tmp_path):
    vertices, faces = rounded_box()
    points, triangles = vertices.astype("<f4"), faces.astype("<u2")
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": [0, 0, 0.6, 0.8], "scale": [-2, 2, 2]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "animations": [{"name": "spin", "channels": [], "samplers": []}],
        "images": [{"uri": "a%20picture.png"}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": triangles.size, "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": points.nbytes},
            {"buffer": 0, "byteOffset": points.nbytes, "byteLength": triangles.nbytes},
        ],
        "buffers": [{"uri": "data.bin", "byteLength": points.nbytes + triangles.nbytes}],
    }
    (tmp_path / "in.gltf").write_text(json.dumps(tree))
    (tmp_path / "data.bin").write_bytes(points.tobytes() + triangles.tobytes())
    (tmp_path / "a picture.png").write_bytes(b"png")
    (tmp_path / "out").mkdir()
    sharpen_file(tmp_path / "in.gltf", tmp_path / "out/x.gltf", STRONG)
    assert (tmp_path / "data.bin").read_bytes() == points.tobytes() + triangles.tobytes()
    assert (tmp_path / "out/a picture.png").read_bytes() == b"png"
    result = json.loads((tmp_path / "out/x.gltf").read_text())
    assert result["animations"] == tree["animations"]
    assert result["buffers"][0]["uri"] == "x.gltf.0.bin"
    data = (tmp_path / "out/x.gltf.0.bin").read_bytes()
    assert data[points.nbytes :] == triangles.tobytes()
    positions = np.frombuffer(data, "<f4", points.size).reshape(-1, 3)
    # A rotation, a mirror and a uniform scale change nothing but the odd tie.
    difference = np.linalg.norm(positions - expected(points.astype(float), faces), axis=1)
    assert np.median(difference) < 1e-4
    assert np.median(np.linalg.norm(positions - points, axis=1)) > 1e-3


def test_normals_of_all_primitives_on_the_same_positions_are_renewed(tmp_path):
    points = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype="<f4")
    upward = np.tile(np.array([0, 0, 1], dtype="<f4"), (4, 1))
    tangents = np.tile(np.array([1, 0, 0, 1], dtype="<f4"), (4, 1))
    arrays = [
        points,
        upward,
        -upward,
        tangents,
        np.array([0, 1, 2], dtype="<u2"),
        np.array([0, 3, 2], dtype="<u2"),
    ]
    ends = np.cumsum([array.nbytes for array in arrays])
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "a.bin", "byteLength": int(ends[-1])}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": int(end - array.nbytes), "byteLength": array.nbytes}
            for array, end in zip(arrays, ends, strict=True)
        ],
        "accessors": [
            {
                "bufferView": k,
                "componentType": 5126 if array.dtype.kind == "f" else 5123,
                "count": len(array),
                "type": f"VEC{array.shape[1]}" if array.ndim == 2 else "SCALAR",
            }
            for k, array in enumerate(arrays)
        ],
        "meshes": [
            {
                "primitives": [
                    {"attributes": {"POSITION": 0, "NORMAL": n, "TANGENT": 3}, "indices": 3 + n}
                    for n in (1, 2)
                ]
            }
        ],
        "nodes": [{"mesh": 0}],
    }
    (tmp_path / "a.bin").write_bytes(b"".join(array.tobytes() for array in arrays))
    (tmp_path / "a.gltf").write_text(json.dumps(tree))

    def tilt(mesh, mask):
        return mesh.vertices + mesh.vertices[:, :1] * (0, 0, 1)

    (tmp_path / "out").mkdir()
    paths = tmp_path / "a.gltf", tmp_path / "out" / "b.gltf"
    outcome = filter_mesh_file(tilt, *paths)
    assert outcome.notes == ("normals were computed anew from the changed surface",)
    data = (tmp_path / "out" / "b.gltf.0.bin").read_bytes()
    for number, sign in ((1, 1), (2, -1)):
        normals = np.frombuffer(data, "<f4", 12, int(ends[number - 1])).reshape(4, 3)
        faces = arrays[3 + number]
        wanted = np.tile([-(0.5**0.5), 0, 0.5**0.5], (3, 1)) * sign
        np.testing.assert_allclose(normals[faces], wanted, atol=1e-6)
    for primitive in json.loads(paths[1].read_text())["meshes"][0]["primitives"]:
        assert set(primitive["attributes"]) == {"POSITION", "NORMAL"}


def test_compressed_glb_is_refused(tmp_path):
    tree = glb_tree(two_material_glb(*rounded_box()))
    for accessor in tree["accessors"]:
        del accessor["bufferView"]
    for mesh in tree["meshes"]:
        mesh["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": {}}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text), len(text), 0x4E4F534A)
    (tmp_path / "in.glb").write_bytes(head + text + struct.pack("<II", 0, 0x004E4942))
    with pytest.raises(core.ShockError, match="without compression"):
        sharpen_file(tmp_path / "in.glb", tmp_path / "out.glb")


# ---------------------------------------------------------------------------------- other formats


@pytest.mark.parametrize("ending", ["stl", "off"])
def test_stl_and_off(tmp_path, ending):
    vertices, faces = rounded_box()
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / f"in.{ending}")
    outcome = sharpen_file(tmp_path / f"in.{ending}", tmp_path / f"out.{ending}", STRONG)
    assert outcome.total == len(vertices)
    result = trimesh.load_mesh(tmp_path / f"out.{ending}")
    assert result.is_watertight
    assert len(result.faces) == len(faces)
    wanted = expected(vertices.astype("f4").astype(float), faces)
    assert farthest(result.vertices, wanted) < 2e-3
    assert farthest(vertices, wanted) > 0.01


@pytest.mark.parametrize("ending", ["ply", "obj", "glb", "gltf"])
def test_colors_survive_conversion(tmp_path, ending):
    vertices, faces = rounded_box()
    colors = np.full((len(vertices), 4), 255, dtype=np.uint8)
    colors[:, 0] = np.arange(len(vertices)) % 256
    mesh = trimesh.Trimesh(vertices, faces, vertex_colors=colors, process=False)
    source = tmp_path / ("in.glb" if ending == "ply" else "in.ply")
    mesh.export(source)
    outcome = sharpen_file(source, tmp_path / f"out.{ending}", STRONG)
    assert not any("colors" in note for note in outcome.notes)
    result = trimesh.load_scene(tmp_path / f"out.{ending}", process=False).to_mesh()
    near = abs(result.visual.vertex_colors[:, 0].astype(int) - colors[:, 0])
    assert len(result.vertices) == len(vertices)
    assert near.max() <= 1
    assert outcome.changed > 300


@pytest.mark.parametrize(
    "source, target, note",
    [
        (
            "in.obj",
            "out.stl",
            ".stl files written here lack UVs, colors, comments, lines and points, materials,"
            " object names, smoothing groups",
        ),
        ("in.obj", "out.ply", "polygons were cut into triangles"),
        ("in.glb", "out.ply", ".ply files written here lack materials, normals, object names"),
    ],
)
def test_losses_are_said(tmp_path, source, target, note):
    (tmp_path / "in.obj").write_bytes(QUADS.replace(b"# the floor", b""))
    (tmp_path / "box.mtl").write_text("newmtl blue\nnewmtl red stuff\n")
    (tmp_path / "in.glb").write_bytes(two_material_glb(*rounded_box()))
    assert note in sharpen_file(tmp_path / source, tmp_path / target, STRONG).notes


OFF_ROWS = "0 0 0\n1 0 0\n1 1 0\n0 1 0\n0 0 1\n3 0 1 4\n3 1 2 4{end}\n3 2 3 4\n3 3 0 4\n"


@pytest.mark.parametrize(
    "head, end, notes",
    [
        ("OFF\n5 4 0\n", " 255 0 0", [".off files written here lack face colors"]),
        ("OFF\n5 4 0\n", "", []),
        ("OFF 5 4 0\n", "", []),  # a vertex of whole numbers looks like the numbers of a head
        ("# Colors are OFF\nOFF\n5 4 0\n", "", [".off files written here lack comments"]),
    ],
)
def test_off_files_tell_what_is_lost(tmp_path, head, end, notes):
    (tmp_path / "in.off").write_text(head + OFF_ROWS.format(end=end))
    assert list(sharpen_file(tmp_path / "in.off", tmp_path / "out.off", STILL).notes) == notes


def test_textured_glb_becomes_obj_with_its_own_side_files(tmp_path):
    (tmp_path / "in.glb").write_bytes(two_material_glb(*rounded_box()))
    sharpen_file(tmp_path / "in.glb", tmp_path / "a.obj", STRONG)
    assert "mtllib a.obj.mtl" in (tmp_path / "a.obj").read_text()
    material = (tmp_path / "a.obj.mtl").read_text()
    assert "newmtl left" in material
    assert "newmtl right" in material
    names = [line.split()[1] for line in material.splitlines() if line.startswith("map_Kd")]
    assert names
    assert all((tmp_path / name).is_file() for name in names)
    assert_closed(
        *(lambda m: (m.vertices.round(5), m.faces))(trimesh.load_mesh(tmp_path / "a.obj"))
    )


# -------------------------------------------------------------------------------- what is refused

STRIPS = b"""ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element tristrips 1
property list int int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
1 1 1
4 0 1 2 3
"""


@pytest.mark.parametrize(
    "name, data, words",
    [
        ("strips.ply", STRIPS, "strips.ply holds no faces .*strips"),
        ("lines.obj", b"v 0 0 0\nv 1 0 0\nl 1 2\n", "lines.obj holds no faces"),
        ("none.obj", b"# nothing\n", "none.obj holds no faces"),
        ("none.ply", b"hello", "none.ply is not a PLY file"),
        *[(f"empty.{e}", b"", f"empty.{e} is empty") for e in ("obj", "ply", "stl", "glb")],
        ("torn.glb", b"glTF\x02\0\0\0", "torn.glb cannot be read"),
        ("text.off", b"hello", "text.off"),
        ("nan.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "nan.obj holds NaN"),
        ("word.obj", b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "word.obj cannot be read"),
        ("bare.ply", b"ply\nelement vertex 1\nproperty float x\nend_header\n", "cannot be read"),
        ("odd.ply", STRIPS.replace(b"ascii", b"asciii"), "odd.ply cannot .*its format is asciii"),
        ("far.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "far.obj: a face names a vertex"),
        ("zero.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 0 1 2\n", "zero.obj: a face names a vertex"),
        ("line.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "zero area"),
        ("mesh.xyz", b"0 0 0", r"\.xyz: cannot handle this ending; use one of .glb"),
    ],
)
def test_bad_files_are_named(tmp_path, name, data, words):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(core.ShockError, match=words):
        sharpen_file(tmp_path / name, tmp_path / f"out{(tmp_path / name).suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_our_own_mistakes_are_logged_with_their_traceback(tmp_path, monkeypatch, caplog):
    (tmp_path / "in.obj").write_bytes(QUADS)
    monkeypatch.setattr(obj, "fans", None)  # a planted mistake: None is called
    with pytest.raises(core.ShockError, match=r"in\.obj cannot be read; is it damaged\? \('None"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj")
    (record,) = caplog.records
    assert record.message == f"The reader of {tmp_path / 'in.obj'} failed."
    assert record.exc_info[0] is TypeError
    assert "in __init__" in caplog.text  # of the traceback


@pytest.mark.parametrize(
    "name, data",
    [
        ("word.obj", b"v 0 0 zero\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"),
        ("torn.glb", b"glTF\x02\0\0\0"),
        ("bare.ply", b"ply\nelement vertex 1\nproperty float x\nend_header\n"),
        ("first.ply", b"ply\nformat ascii 1.0\nproperty float x\nend_header\n"),
    ],
)
def test_damage_is_not_logged(tmp_path, caplog, name, data):
    (tmp_path / name).write_bytes(data)
    with pytest.raises(core.ShockError, match="is it damaged"):
        sharpen_file(tmp_path / name, tmp_path / f"out{name[-4:]}")
    assert not caplog.records


def test_what_another_reader_stumbles_over_is_damage(tmp_path, monkeypatch, caplog):
    (tmp_path / "in.stl").write_bytes(b"solid\n")

    def stumble(*_, **__):
        return {}["mesh"]

    monkeypatch.setattr(trimesh, "load_scene", stumble)  # its module is none of ours
    with pytest.raises(core.ShockError, match="is it damaged"):
        sharpen_file(tmp_path / "in.stl", tmp_path / "out.stl")
    assert not caplog.records


def test_indices_out_of_range_are_named(tmp_path):
    vertices, faces = rounded_box()
    faces[5, 1] = len(vertices)
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces))
    for ending in ("ply", "obj"):
        with pytest.raises(core.ShockError, match=r"in\.ply: a face names a vertex"):
            sharpen_file(tmp_path / "in.ply", tmp_path / f"out.{ending}")
    (tmp_path / "in.obj").write_bytes(QUADS.replace(b"f 5/1 ", b"f 5/1/3 "))
    with pytest.raises(core.ShockError, match=r"in\.obj: a face names a normal"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj")


def test_torn_binary_ply_is_named(tmp_path):
    data = ply_bytes(*rounded_box())
    for size in (len(data) - 3000, len(data) - 7000, 150):
        (tmp_path / "torn.ply").write_bytes(data[:size])
        with pytest.raises(core.ShockError, match=r"torn\.ply"):
            sharpen_file(tmp_path / "torn.ply", tmp_path / "out.ply")


def test_paths_are_checked(tmp_path):
    (tmp_path / "in.obj").write_bytes(QUADS)
    with pytest.raises(core.ShockError, match=r"no file .*gone\.obj"):
        sharpen_file(tmp_path / "gone.obj", tmp_path / "out.obj")
    with pytest.raises(core.ShockError, match="is a folder"):
        sharpen_file(tmp_path, tmp_path / "out.obj")
    with pytest.raises(core.ShockError, match=r"no folder .*nowhere"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "nowhere/out.obj")
    with pytest.raises(core.ShockError, match="exists already; add --overwrite"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "in.obj")
    assert (tmp_path / "in.obj").read_bytes() == QUADS
    sharpen_file(tmp_path / "in.obj", tmp_path / "in.obj", STRONG, overwrite=True)
    assert (tmp_path / "in.obj").read_bytes() != QUADS


def test_cancel_writes_nothing(tmp_path):
    (tmp_path / "in.obj").write_bytes(QUADS)
    calls = []

    def progress(fraction, message):
        calls.append((fraction, message))
        return len(calls) < 3

    with pytest.raises(core.Cancelled):
        sharpen_file(tmp_path / "in.obj", tmp_path / "out.obj", STRONG, progress=progress)
    assert len(calls) == 3
    assert [path.name for path in tmp_path.iterdir()] == ["in.obj"]


def test_progress_rises_over_all_objects(tmp_path):
    vertices, faces = rounded_box()
    text = "o a\n" + obj_text(vertices, faces)
    text += "o b\n" + obj_text(vertices + 10, faces, first=1 + len(vertices))
    (tmp_path / "in.obj").write_text(text)
    fractions = []
    sharpen_file(
        tmp_path / "in.obj",
        tmp_path / "out.obj",
        progress=lambda fraction, message: fractions.append(fraction) or True,
    )
    assert fractions[0] == 0.0
    assert fractions[-1] == 1.0
    assert np.count_nonzero(np.diff(np.array(fractions) > 0.5)) == 1  # one object, then the other


def test_a_failed_write_leaves_the_old_file(tmp_path):
    (tmp_path / "out.obj").write_text("old")
    with pytest.raises(OSError, match="disk full"), staged(tmp_path / "out.obj", True) as path:
        path.write_text("half")
        raise OSError("disk full")
    assert (tmp_path / "out.obj").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out.obj"]


@pytest.mark.parametrize("said", [True, False])
def test_a_full_disk_is_named_also_if_the_writer_does_not_say_so(tmp_path, monkeypatch, said):
    (tmp_path / "out.obj").write_text("old")
    full = OSError(errno.ENOSPC, "No space left on device")

    def refuse(_number):
        raise full

    if not said:
        monkeypatch.setattr(os, "fsync", refuse)
    with (
        pytest.raises(core.ShockError, match=r"disk of .* is full .*No space left.*; make room"),
        staged(tmp_path / "out.obj", True) as path,
    ):
        path.write_text("half")
        if said:
            raise full
    assert (tmp_path / "out.obj").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["out.obj"]


def test_a_folder_that_goes_is_not_called_full(tmp_path):
    (tmp_path / "out").mkdir()
    with (
        pytest.raises(FileNotFoundError, match="gone"),
        staged(tmp_path / "out" / "out.obj", True),
    ):
        shutil.rmtree(tmp_path / "out")
        raise FileNotFoundError(errno.ENOENT, "gone")


def test_a_writer_that_writes_nothing_fails(tmp_path):
    with (
        pytest.raises(core.ShockError, match=r"out\.obj was not written"),
        staged(tmp_path / "out.obj", False) as path,
    ):
        path.with_name("out.mtl").write_text("newmtl paint")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("refused", ["m.mtl", "z.png"])
def test_the_file_itself_comes_last(tmp_path, monkeypatch, refused):
    (tmp_path / "n.obj").write_text("old")
    replace = os.replace

    def move(new, old):
        if old.name == refused:
            raise PermissionError("open elsewhere")
        replace(new, old)

    monkeypatch.setattr(os, "replace", move)
    with pytest.raises(PermissionError), staged(tmp_path / "n.obj", True) as path:
        for name in ("m.mtl", "n.obj", "z.png"):
            path.with_name(name).write_text("new")
    assert (tmp_path / "n.obj").read_text() == "old"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has other permissions")
def test_replaced_files_keep_links_and_permissions(tmp_path):
    (tmp_path / "store").mkdir()
    kept = tmp_path / "store" / "kept.obj"
    kept.write_text("old")
    kept.chmod(0o640)
    for number in (1, 2):  # a link to a link
        (tmp_path / f"{number}.obj").symlink_to([kept, "1.obj"][number - 1])
    (tmp_path / "plain.obj").write_text("old")
    (tmp_path / "plain.obj").chmod(0o600)
    for name in ("2.obj", "plain.obj"):
        with staged(tmp_path / name, True) as path:
            path.write_text("new")
    assert (tmp_path / "2.obj").is_symlink()
    assert (tmp_path / "1.obj").is_symlink()
    assert kept.read_text() == (tmp_path / "plain.obj").read_text() == "new"
    assert kept.stat().st_mode & 0o777 == 0o640
    assert (tmp_path / "plain.obj").stat().st_mode & 0o777 == 0o600
    assert [path.name for path in (tmp_path / "store").iterdir()] == ["kept.obj"]


def test_links_to_nothing_stay_links(tmp_path):
    (tmp_path / "store").mkdir()
    (tmp_path / "out.obj").symlink_to(tmp_path / "store" / "out.obj")
    with staged(tmp_path / "out.obj", False) as path:
        path.write_text("new")
    assert (tmp_path / "out.obj").is_symlink()
    assert (tmp_path / "store" / "out.obj").read_text() == "new"
    (tmp_path / "far.obj").symlink_to(tmp_path / "gone" / "out.obj")
    (tmp_path / "loop.obj").symlink_to("loop.obj")
    for name in ("far.obj", "loop.obj"):
        with (
            pytest.raises(core.ShockError, match=f"{name} is a link .* remove the link"),
            staged(tmp_path / name, True) as path,
        ):
            path.write_text("new")
        assert (tmp_path / name).is_symlink()


KILLED = """
import os, signal, sys
from pathlib import Path
from shock_filter.core.files.output import staged
with staged(Path("out.obj"), True) as path:
    path.write_text("half")
    number = int(sys.argv[1])
    if number != signal.SIGKILL:
        signal.signal(number, signal.SIG_DFL)  # `nohup` has programs ignore some
    os.kill(os.getpid(), number)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no such signals, no locks on folders")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_what_a_killed_run_has_left_is_removed_by_a_later_one(tmp_path, number):
    run = subprocess.run([sys.executable, "-c", KILLED, str(int(number))], cwd=tmp_path)
    assert run.returncode == -number
    (left,) = tmp_path.iterdir()
    with staged(tmp_path / "of_another.obj", True) as path:  # and what another run has at work
        path.write_text("new")
        at_work = path.parent.parent
        staging._tidy.cache_clear()
        with staged(tmp_path / "out.obj", True) as path:
            path.write_text("new")
        assert not left.exists()
        assert at_work.exists()
    assert {path.name for path in tmp_path.iterdir()} == {"of_another.obj", "out.obj"}


# ------------------------------------------------------------------------------------------ colors

SOFT = core.ShockSettings(time=64)
STILL_COLORS = core.ShockSettings(time=0)


def painted():
    """A sphere, painted in two colors with a soft edge between them."""
    ball = trimesh.creation.icosphere(subdivisions=4)
    share = 1 / (1 + np.exp(-ball.vertices[:, 2:] / 0.08))
    colors = share * [0.9, 0.2, 0.1] + (1 - share) * [0.1, 0.3, 0.8]
    vertices = ball.vertices.astype(np.float32).astype(np.float64)  # what all formats can hold
    return vertices, np.array(ball.faces, dtype=np.int64), colors


def bytes_of(colors):
    return np.rint(colors * 255).astype(np.uint8)


def sharpened(vertices, faces, colors, settings=SOFT):
    result = core.sharpen_vertex_signal(core.TriangleMesh(vertices, faces), colors, settings)
    assert abs(result - colors).max() > 0.05
    return result


def color_columns(colors, kind="uchar", dtype="u1", names=("red", "green", "blue")):
    return [(name, kind, dtype, colors[:, k]) for k, name in enumerate(names)]


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("kind, dtype", [("uchar", "u1"), ("float", "f4"), ("ushort", "u2")])
def test_binary_ply_changes_colors_only(tmp_path, order, kind, dtype):
    vertices, faces, colors = painted()
    scale = 1 if dtype == "f4" else np.iinfo(dtype).max
    stored = colors.astype("f4") if scale == 1 else np.rint(colors * scale).astype(dtype)
    alpha = np.arange(len(vertices)) % 200
    extra = [*color_columns(stored, kind, dtype), ("alpha", "uchar", "u1", alpha)]
    old = ply_bytes(vertices, faces, extra, order)
    (tmp_path / "in.ply").write_bytes(old)
    outcome = sharpen_colors_file(tmp_path / "in.ply", tmp_path / "out.ply", SOFT)
    new = (tmp_path / "out.ply").read_bytes()
    fields = [(axis, order + "f4") for axis in "xyz"]
    fields += [(name, order + t) for name, _, t, _ in extra]
    before, after = (ply_table(data, fields, len(vertices)) for data in (old, new))
    for name in ("x", "y", "z", "alpha"):
        np.testing.assert_array_equal(after[name], before[name])
    assert new[-len(faces) * 13 :] == old[-len(faces) * 13 :]
    wanted = sharpened(vertices, faces, stored.astype(np.float64) / scale) * scale
    wanted = np.rint(wanted) if scale > 1 else wanted
    got = np.column_stack([after[name] for name in ("red", "green", "blue")])
    np.testing.assert_allclose(got, wanted, atol=2e-7 if scale == 1 else 0)
    assert outcome.total == len(vertices)
    assert outcome.changed == (got != stored).any(axis=1).sum() > 100


def painted_text_ply(vertices, faces, colors, names=("red", "green", "blue"), kind="uchar"):
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {axis}" for axis in "xyz"]
    header += [f"property {kind} {name}" for name in names]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [
        "{:.9g} {:.9g} {:.9g}  {} {} {}".format(*vertex, *color)
        for vertex, color in zip(vertices, colors, strict=True)
    ]
    rows += ["3 {} {} {}".format(*face) for face in faces]
    return "\n".join([*header, *rows]) + "\n"


@pytest.mark.parametrize("names", [("diffuse_red", "diffuse_green", "diffuse_blue"), tuple("rgb")])
def test_text_ply_changes_lines_of_changed_colors_only(tmp_path, names):
    vertices, faces, colors = painted()
    stored = bytes_of(colors)
    (tmp_path / "in.ply").write_text(painted_text_ply(vertices, faces, stored, names))
    outcome = sharpen_colors_file(tmp_path / "in.ply", tmp_path / "out.ply", SOFT)
    before, after = ((tmp_path / name).read_text().splitlines() for name in ("in.ply", "out.ply"))
    assert sum(a != b for a, b in zip(before, after, strict=True)) == outcome.changed > 100
    start = before.index("end_header") + 1
    got = np.array([row.split()[3:] for row in after[start : start + len(vertices)]], dtype=float)
    np.testing.assert_array_equal(got, np.rint(255 * sharpened(vertices, faces, stored / 255)))


@pytest.mark.parametrize("kind, dtype", [("int", "i4"), ("uint", "u4"), ("ushort", "u2")])
def test_ply_colors_up_to_255_in_wide_numbers_are_bytes(tmp_path, kind, dtype):
    vertices, faces, colors = painted()
    stored = bytes_of(colors).astype(dtype)
    source = tmp_path / "in.ply"
    source.write_bytes(ply_bytes(vertices, faces, color_columns(stored, kind, dtype)))
    sharpen_colors_file(source, tmp_path / "out.ply", SOFT)
    source.write_text(painted_text_ply(vertices, faces, stored, kind=kind))
    sharpen_colors_file(source, tmp_path / "text.ply", SOFT)
    wanted = sharpened(vertices, faces, stored / 255)
    for name in ("out.ply", "text.ply"):
        got = IN_PLACE[".ply"](tmp_path / name).read_colors()
        np.testing.assert_array_equal(got, np.rint(255 * wanted) / 255)
    fields = [(axis, "<f4") for axis in "xyz"]
    fields += [(name, f"<{dtype}") for name in ("red", "green", "blue")]
    written = ply_table((tmp_path / "out.ply").read_bytes(), fields, len(vertices))
    np.testing.assert_array_equal(written["red"], np.rint(255 * wanted[:, 0]))


@pytest.mark.parametrize("is_text", [False, True])
def test_ply_colors_of_16_bits_stay_so_when_all_become_small(tmp_path, is_text):
    vertices, faces, _ = painted()
    stored = np.full((len(vertices), 3), 200, dtype="u2")
    stored[7] = 260  # the only one above 255
    source, target = tmp_path / "in.ply", tmp_path / "out.ply"
    if is_text:
        source.write_text(painted_text_ply(vertices, faces, stored, kind="ushort"), newline="\r\n")
    else:
        source.write_bytes(ply_bytes(vertices, faces, color_columns(stored, "ushort", "u2")))
    filter_colors_file(lambda mesh, colors, mask=None: colors * 0.5, source, target)
    np.testing.assert_array_equal(IN_PLACE[".ply"](target).read_colors()[:9], stored[:9] / 131070)
    filter_colors_file(lambda mesh, colors, mask=None: colors, target, tmp_path / "again.ply")
    assert (tmp_path / "again.ply").read_bytes() == target.read_bytes()
    assert trimesh.load_mesh(target, process=False).faces.shape == faces.shape


def obj_with_colors(vertices, faces, colors):
    rows = [
        "v {} {} {} {:.3f} {:.3f} {:.3f}".format(*v, *c)
        for v, c in zip(vertices, colors, strict=True)
    ]
    rows += ["f {} {} {}".format(*face) for face in faces + 1]
    return "# painted\n" + "\n".join(rows) + "\n"


def test_obj_changes_colors_only(tmp_path):
    vertices, faces, colors = painted()
    colors = colors.round(3)
    (tmp_path / "in.obj").write_text(obj_with_colors(vertices, faces, colors))
    outcome = sharpen_colors_file(tmp_path / "in.obj", tmp_path / "out.obj", SOFT)
    before, after = (
        [line.split() for line in (tmp_path / name).read_text().splitlines()]
        for name in ("in.obj", "out.obj")
    )
    got = np.array([words[4:] for words in after if words[0] == "v"], dtype=float)
    np.testing.assert_allclose(got, sharpened(vertices, faces, colors), atol=2e-7)
    assert [words[:4] for words in before] == [words[:4] for words in after]
    assert outcome.changed == (got != colors).any(axis=1).sum() > 100


@pytest.mark.parametrize("ending", ["glb", "gltf"])
def test_gltf_changes_colors_only(tmp_path, ending):
    vertices, faces, colors = painted()
    rgba = np.column_stack([bytes_of(colors), np.arange(len(colors)) % 256]).astype(np.uint8)
    mesh = trimesh.Trimesh(vertices, faces, process=False, vertex_colors=rgba)
    trimesh.Scene(mesh).export(tmp_path / f"in.{ending}")
    outcome = sharpen_colors_file(tmp_path / f"in.{ending}", tmp_path / f"out.{ending}", SOFT)
    new = trimesh.load_mesh(tmp_path / f"out.{ending}", process=False)
    wanted = np.rint(255 * sharpened(vertices, faces, rgba[:, :3] / 255))
    np.testing.assert_array_equal(new.visual.vertex_colors[:, :3], wanted)
    np.testing.assert_array_equal(new.visual.vertex_colors[:, 3], rgba[:, 3])
    np.testing.assert_array_equal(new.vertices, vertices)
    assert outcome.changed == (wanted != rgba[:, :3]).any(axis=1).sum() > 100
    assert outcome.notes == ()


def test_time_zero_keeps_colored_files(tmp_path):
    vertices, faces, colors = painted()
    (tmp_path / "in.obj").write_text(obj_with_colors(vertices, faces, colors))
    columns = color_columns(bytes_of(colors))
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces, columns))
    floats = painted_text_ply(
        vertices, faces, colors, kind="float"
    )  # more digits than a float holds
    (tmp_path / "text.ply").write_text(floats)
    rgba = np.column_stack([bytes_of(colors), np.full(len(colors), 255)])
    mesh = trimesh.Trimesh(vertices, faces, process=False, vertex_colors=rgba)
    mesh.export(tmp_path / "in.glb")
    for name in ("in.obj", "in.ply", "text.ply", "in.glb"):
        outcome = sharpen_colors_file(tmp_path / name, tmp_path / ("out_" + name), STILL_COLORS)
        assert outcome.changed == 0
        assert (tmp_path / ("out_" + name)).read_bytes() == (tmp_path / name).read_bytes()


def test_split_vertices_of_one_color_do_not_show(tmp_path):
    vertices, faces, colors = painted()
    colors = bytes_of(colors)
    split = ply_bytes(*seams(vertices, faces), color_columns(colors[faces.reshape(-1)]))
    (tmp_path / "in.ply").write_bytes(split)
    sharpen_colors_file(tmp_path / "in.ply", tmp_path / "out.ply", SOFT)
    fields = [*((axis, "<f4") for axis in "xyz"), *((c, "u1") for c in ("red", "green", "blue"))]
    table = ply_table((tmp_path / "out.ply").read_bytes(), fields, faces.size)
    wanted = np.rint(255 * sharpened(vertices, faces, colors / 255))[faces.reshape(-1), 0]
    np.testing.assert_array_equal(table["red"], wanted)


def test_colors_that_jump_stay_apart(tmp_path):
    # Two halves of a sheet, each of one color of its own: nothing to sharpen across the cut.
    rows, columns = np.mgrid[:9, :9]
    sheet = np.column_stack([rows.ravel(), columns.ravel(), np.zeros(81)]).astype(float)
    quads = np.arange(81).reshape(9, 9)
    a, b, c, d = quads[:-1, :-1], quads[1:, :-1], quads[1:, 1:], quads[:-1, 1:]
    triangles = np.vstack(
        [np.dstack([a, b, c]).reshape(-1, 3), np.dstack([a, c, d]).reshape(-1, 3)]
    )
    vertices = np.vstack([sheet, sheet + [8, 0, 0]])
    faces = np.vstack([triangles, triangles + 81])
    colors = np.repeat([[200, 10, 10], [10, 10, 200]], 81, axis=0)
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces, color_columns(colors)))
    assert sharpen_colors_file(tmp_path / "in.ply", tmp_path / "out.ply", SOFT).changed == 0


def test_mask_protects_colors(tmp_path):
    vertices, faces, colors = painted()
    colors = bytes_of(colors)
    free = vertices[:, 0] > 0
    extra = [*color_columns(colors), ("soft", "uchar", "u1", 255 * free)]
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces, extra))
    fields = [*((axis, "<f4") for axis in "xyz"), *((name, "u1") for name, *_ in extra)]
    for invert in (False, True):
        sharpen_colors_file(
            tmp_path / "in.ply", tmp_path / "out.ply", SOFT, mask="soft", invert_mask=invert,
            overwrite=True,
        )  # fmt: skip
        new = ply_table((tmp_path / "out.ply").read_bytes(), fields, len(vertices))
        changed = new["red"] != colors[:, 0]
        assert changed.any()
        assert not changed[free == invert].any()


def test_objects_without_colors_are_left(tmp_path):
    vertices, faces, colors = painted()
    scene = trimesh.Scene()
    rgba = np.column_stack([bytes_of(colors), np.full(len(colors), 255)])
    scene.add_geometry(trimesh.Trimesh(vertices, faces, process=False, vertex_colors=rgba))
    scene.add_geometry(trimesh.creation.box())
    scene.export(tmp_path / "in.glb")
    outcome = sharpen_colors_file(tmp_path / "in.glb", tmp_path / "out.glb", SOFT)
    assert outcome.changed > 100


def test_colors_that_are_no_numbers_are_named(tmp_path):
    text = "v 0 0 0 1 0 0\nv 1 0 0 1 red 0\nv 0 1 0 1 0 0\nf 1 2 3\n"
    (tmp_path / "in.obj").write_text(text)
    with pytest.raises(core.ShockError, match=r"in\.obj cannot be read; is it damaged"):
        sharpen_colors_file(tmp_path / "in.obj", tmp_path / "out.obj")


def test_files_without_colors_are_refused(tmp_path):
    vertices, faces, _ = painted()
    (tmp_path / "in.obj").write_text(obj_text(vertices, faces))
    (tmp_path / "in.ply").write_bytes(ply_bytes(vertices, faces))
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "in.glb")
    trimesh.Trimesh(vertices, faces, process=False).export(tmp_path / "in.stl")
    for name in ("in.obj", "in.ply", "in.glb"):
        with pytest.raises(core.InvalidSignal, match=f"{name} has no vertex colors; paint them"):
            sharpen_colors_file(tmp_path / name, tmp_path / ("out_" + name))
    with pytest.raises(core.ShockError, match=r"use one of .obj, .ply, .glb, .gltf\."):
        sharpen_colors_file(tmp_path / "in.stl", tmp_path / "out.stl")
    with pytest.raises(core.ShockError, match=r"format of the input only; end it in .ply"):
        sharpen_colors_file(tmp_path / "in.ply", tmp_path / "out.obj")
    with pytest.raises(core.ShockError, match=r"no file .*gone.ply"):
        sharpen_colors_file(tmp_path / "gone.ply", tmp_path / "out.ply")
    assert not list(tmp_path.glob("out*"))


def test_gltf_nodes_that_contain_each_other_are_refused(tmp_path):
    tree = {
        "asset": {"version": "2.0"},
        "nodes": [{"children": [1]}, {"children": [2]}, {"children": [1]}],
        "meshes": [],
    }
    path = tmp_path / "loop.gltf"
    path.write_text(json.dumps(tree))
    with pytest.raises(core.ShockError, match="contain each other"):
        sharpen_file(path, tmp_path / "out.gltf", core.GeometrySettings())


def test_texture_coordinates_of_one_number_are_refused(tmp_path):
    text = (
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1\nvt 0 1\nf 1/1 2/2 3/3\nf 1/1 3/3 4/2\n"
    )
    (tmp_path / "in.obj").write_text(text)
    with pytest.raises(core.ShockError, match=r"in\.obj cannot be read; is it damaged\? \(texture"):
        sharpen_file(tmp_path / "in.obj", tmp_path / "out.glb", STRONG)
    assert not (tmp_path / "out.glb").exists()


def test_obj_normals_that_count_backwards_mean_the_same(tmp_path):
    vertices, faces = rounded_box()
    mesh = trimesh.Trimesh(vertices, faces, process=False)
    rows = [f"v {x:.17g} {y:.17g} {z:.17g}" for x, y, z in vertices]
    rows += ["vn {:.6f} {:.6f} {:.6f}".format(*n) for n in mesh.face_normals]
    for name, first in (("a", 1), ("b", -len(faces))):
        corners = [[f"{v + 1}//{n + first}" for v in face] for n, face in enumerate(faces)]
        lines = rows + ["f " + " ".join(each) for each in corners]
        (tmp_path / f"{name}.obj").write_text("\n".join(lines))
        sharpen_file(tmp_path / f"{name}.obj", tmp_path / f"{name}2.obj", STRONG)
    found = [normals_at_corners(tmp_path / f"{name}2.obj") for name in "ab"]
    np.testing.assert_array_equal(*found)


# ----------------------------------------------------------------------------- polygons

L_SHAPE = [(0, 2), (0, 0), (2, 0), (2, 1), (1, 1), (1, 2)]
DART = [(0, 0), (3, -1), (1, 0), (3, 1)]
COMB = [(0, 0), (5, 0), (5, 2), (4, 2), (4, 1), (3, 1), (3, 2), (2, 2), (2, 1), (1, 1), (1, 2)]
COMB += [(0, 2)]


def write_polygons(path, outlines):
    """Polygons side by side, on a slope, as `f` lines or rows of a text PLY or OFF file."""
    points = [(x + 9 * n, y, 0.5 * x) for n, outline in enumerate(outlines) for x, y in outline]
    ends = np.cumsum([len(outline) for outline in outlines])
    faces = [range(end - len(outline), end) for end, outline in zip(ends, outlines, strict=True)]
    rows = [" ".join(map(str, point)) for point in points]
    if path.suffix == ".obj":
        lines = ["v " + row for row in rows]
        lines += ["f " + " ".join(str(v + 1) for v in face) for face in faces]
    elif path.suffix == ".off":
        lines = [f"OFF {len(rows)} {len(faces)} 0", *rows]
        lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    else:
        lines = ["ply", "format ascii 1.0", f"element vertex {len(rows)}"]
        lines += [f"property float {axis}" for axis in "xyz"]
        lines += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
        lines += ["end_header", *rows]
        lines += [" ".join(map(str, [len(face), *face])) for face in faces]
    path.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("ending", [".obj", ".ply"])
@pytest.mark.parametrize("turn", range(4))
def test_concave_polygons_have_no_flipped_triangles(tmp_path, ending, turn):
    outlines = [np.roll(outline, turn, axis=0) for outline in (COMB, DART, L_SHAPE, DART)]
    path = tmp_path / f"in{ending}"
    write_polygons(path, [*outlines, [(0, 0), (1, 0), (0, 1)]])
    document = read_document(path, IN_PLACE[ending])
    a, b, c = (document.vertices[document.faces[:, k]] for k in range(3))
    areas = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(8 + 1 + 3 + 1 + 0.5)
    assert len(areas) == 10 + 2 + 4 + 2 + 1


@pytest.mark.parametrize("ending", [".glb", ".stl", ".ply", ".off", ".obj"])
@pytest.mark.parametrize("source", ["in.obj", "in.ply", "in.off"])
def test_conversions_cut_concave_polygons_along_their_shape(tmp_path, source, ending):
    if ending in IN_PLACE and source.endswith(ending):
        pytest.skip("keeps its polygons")
    outlines = [np.roll(outline, 1, axis=0) for outline in (COMB, DART, L_SHAPE, DART)]
    write_polygons(tmp_path / source, [*outlines, [(0, 0), (1, 0), (1, 1), (0, 1)]])
    sharpen_file(tmp_path / source, tmp_path / f"out{ending}", STILL)
    written = trimesh.load(tmp_path / f"out{ending}", force="mesh", process=False)
    a, b, c = np.moveaxis(written.triangles, 1, 0)
    areas = 0.5 * np.cross(b - a, c - a)[:, 2]
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(8 + 1 + 3 + 1 + 1)
    assert len(areas) == 10 + 2 + 4 + 2 + 2


def test_conversions_of_concave_polygons_keep_their_coordinates(tmp_path):
    points = "".join(f"v {x} {y} 0\nvt {x / 4} {y / 4}\n" for x, y in L_SHAPE)
    text = f"{points}vn 0 0 1\nf 3/3/1 4/4/1 5/5/1 6/6/1 \\\n1/1/1 2/2/1\n"
    (tmp_path / "in.obj").write_text(text)
    sharpen_file(tmp_path / "in.obj", tmp_path / "out.glb", STILL)
    mesh = trimesh.load(tmp_path / "out.glb", force="mesh", process=False)
    assert mesh.area == pytest.approx(3) and len(mesh.faces) == 4
    np.testing.assert_allclose(mesh.visual.uv, mesh.vertices[:, :2] / 4, atol=1e-6)


@pytest.mark.parametrize("ending", [".obj", ".ply"])
def test_convex_polygons_stay_fans(tmp_path, ending):
    angles = np.arange(7) * 2 * np.pi / 7
    outline = np.column_stack([np.cos(angles), np.sin(angles)])
    write_polygons(tmp_path / f"in{ending}", [outline])
    faces = read_document(tmp_path / f"in{ending}", IN_PLACE[ending]).faces
    assert faces.tolist() == [[0, k, k + 1] for k in range(1, 6)]


def test_polygons_that_cross_themselves_stay_fans(tmp_path):
    write_polygons(tmp_path / "in.obj", [[(0, 0), (2, 2), (2, 0), (0, 1), (-1, 3)]])
    faces = read_document(tmp_path / "in.obj", IN_PLACE[".obj"]).faces
    assert faces.tolist() == [[0, 1, 2], [0, 2, 3], [0, 3, 4]]
