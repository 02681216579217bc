# SPDX-License-Identifier: GPL-3.0-or-later
"""glTF files in all forms that are allowed; of those that are broken, the part is named."""

import copy
import json
import logging
import random
import struct
from pathlib import Path

import numpy as np
import pytest
from on_files import sharpen_file
from shock_filter import core
from shock_filter.core.files.formats.mesh.gltf import GltfFile, _gltf_matrices
from shock_filter.core.files.meshes import filter_colors_file, filter_mesh_file
from shock_filter.core.files.output import Options
from shock_filter.core.files.textures import read_textured_mesh
from test_written_files import CORNERS, TRIANGLE, lift, positions

OVERWRITE = Options(overwrite=True)
TARGETS = ["out.gltf", "out.glb", "out.ply", "out.obj", "out.stl", "out.off"]
NORMALS = np.tile(np.array([0, 0, 1], "<f4"), (4, 1))
TANGENTS = np.tile(np.array([1, 0, 0, 1], "<f4"), (4, 1))
UVS = TRIANGLE[:, :2].copy()
COLORS = np.tile(np.array([255, 0, 0, 128], np.uint8), (4, 1))
PLACES, VALUES = np.array([1, 3], "<u2"), np.array([[2, 0, 0], [0, 0, 3]], "<f4")
SPARSE_POINTS = TRIANGLE.copy()
SPARSE_POINTS[PLACES] = VALUES
ARRAYS = [TRIANGLE, CORNERS, NORMALS, UVS, COLORS, TANGENTS, PLACES, VALUES]
KINDS = {"<f4": 5126, "<u2": 5123, "|u1": 5121}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def blob():
    return b"".join(array.tobytes() for array in ARRAYS)


def description():
    """A tetrahedron with all that is read: points, corners, normals, UVs, colors."""
    views, accessors, start = [], [], 0
    for array in ARRAYS:
        view = {"buffer": 0, "byteOffset": start, "byteLength": array.nbytes, "extensions": {}}
        views.append(view)
        width = array.shape[1] if array.ndim == 2 else 1
        about = {"componentType": KINDS[array.dtype.str], "type": TYPES[width]}
        accessors.append({"bufferView": len(accessors), "count": len(array), **about})
        start += array.nbytes
    names = {"POSITION": 0, "NORMAL": 2, "TEXCOORD_0": 3, "COLOR_0": 4}
    primitive = {"attributes": names, "indices": 1, "material": 0, "mode": 4, "extensions": {}}
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [
            {"mesh": 0, "translation": [1, 0, 0], "rotation": [0, 0, 0, 1], "children": [1]},
            {"matrix": np.eye(4).ravel().tolist()},
        ],
        "meshes": [{"name": "m", "primitives": [primitive]}],
        "materials": [{"name": "paint"}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": start, "uri": "a.bin"}],
        "extensions": {},
    }


def sparse(base=None):
    """An accessor whose entries 1 and 3 are others than those of a view, or than 0."""
    accessor = {"componentType": 5126, "count": 4, "type": "VEC3"}
    accessor |= {} if base is None else {"bufferView": base}
    indices = {"bufferView": 6, "componentType": 5123}
    return accessor | {"sparse": {"count": 2, "indices": indices, "values": {"bufferView": 7}}}


def write(tree, name="in.gltf"):
    path = Path(name)
    if path.suffix == ".gltf":
        Path("a.bin").write_bytes(blob())
        path.write_text(json.dumps(tree))
        return
    tree = copy.deepcopy(tree)
    if isinstance(tree.get("buffers"), list) and isinstance(tree["buffers"][0], dict):
        tree["buffers"][0].pop("uri", None)
    text = json.dumps(tree).encode()
    chunks = [(0x4E4F534A, text + b" " * (-len(text) % 4)), (0x004E4942, blob())]
    body = b"".join(struct.pack("<II", len(data), kind) + data for kind, data in chunks)
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(body)) + body)


def vertices(name):
    """Read by means other than ours, in the order of x, y and z."""
    found = np.unique(positions(name).round(4), axis=0)
    return found[np.lexsort(found.T[::-1])]


def ordered(points):
    return np.unique(np.asarray(points, np.float64).round(4), axis=0)


# ------------------------------------------------------------------------------- what is allowed


@pytest.mark.parametrize("target", [*TARGETS, "in.gltf"])
def test_sparse_positions_are_read_and_written(target):
    tree = description()
    tree["accessors"][0] = sparse(0)
    write(tree)
    np.testing.assert_array_equal(GltfFile(Path("in.gltf")).vertices, SPARSE_POINTS + [1, 0, 0])
    assert filter_mesh_file(lift, "in.gltf", target, OVERWRITE).changed == 4
    np.testing.assert_allclose(vertices(target), ordered(SPARSE_POINTS + [2, 1, 1]))


def test_sparse_positions_without_a_view_are_zeros_otherwise():
    tree = description()
    tree["accessors"][0] = sparse()
    write(tree)
    expected = np.zeros((4, 3))
    expected[PLACES] = VALUES
    np.testing.assert_array_equal(GltfFile(Path("in.gltf")).vertices, expected + [1, 0, 0])


def test_other_accessors_that_share_the_view_of_a_sparse_one_stay():
    """The view is changed for the first primitive; what the second is made of it is not."""
    tree = description()
    tree["accessors"].append(sparse(0))
    second = {"attributes": {"POSITION": 8}, "indices": 1}
    tree["meshes"][0]["primitives"].append(second)
    write(tree)
    document = GltfFile(Path("in.gltf"))
    moved = np.arange(8) < 4
    new = document.vertices + moved[:, None]
    document.save(Path("out.gltf"), new, moved)
    np.testing.assert_allclose(GltfFile(Path("out.gltf")).vertices, new)


@pytest.mark.parametrize("name", ["in.gltf", "in.glb"])
def test_what_is_not_changed_stays_sparse(name):
    tree = description()
    tree["accessors"].append(sparse())
    tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": 8}]
    write(tree, name)
    filter_mesh_file(lift, name, f"out{name[2:]}")
    data = Path(f"out{name[2:]}").read_bytes()
    assert data.count(b'"sparse"') == 1


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("attribute", ["NORMAL", "TEXCOORD_0", "COLOR_0", "_REST"])
def test_accessors_without_a_view_are_zeros(attribute, target):
    tree = description()
    names = tree["meshes"][0]["primitives"][0]["attributes"]
    number = names.setdefault(attribute, len(tree["accessors"]))
    kind = {"TEXCOORD_0": "VEC2", "COLOR_0": "VEC4"}.get(attribute, "VEC3")
    about = {"componentType": 5126, "count": 4, "type": kind}
    tree["accessors"][number:] = [about, *tree["accessors"][number + 1 :]]
    write(tree)
    assert filter_mesh_file(lift, "in.gltf", target).changed == 4
    np.testing.assert_allclose(vertices(target), ordered(TRIANGLE + [2, 1, 1]))


def test_colors_without_a_view_are_black_and_are_written():
    tree = description()
    tree["accessors"][4] = {"componentType": 5126, "count": 4, "type": "VEC3"}
    write(tree)

    def lighten(mesh, colors, mask=None):
        assert (colors == 0).all()
        return colors + 0.5

    assert filter_colors_file(lighten, "in.gltf", "out.gltf").changed == 4
    np.testing.assert_array_equal(GltfFile(Path("out.gltf")).read_colors(), np.full((4, 3), 0.5))


def test_all_zeros_have_no_area():
    tree = description()
    del tree["accessors"][0]["bufferView"]
    write(tree)
    with pytest.raises(core.ShockError, match="no vertices"):
        filter_mesh_file(lift, "in.gltf", "out.gltf")


def test_primitives_without_positions_are_left_as_they_are():
    tree = description()
    tree["meshes"][0]["primitives"].append({"attributes": {"NORMAL": 2}})
    write(tree)
    assert filter_mesh_file(lift, "in.gltf", "out.gltf").changed == 4


@pytest.mark.parametrize("target", ["out.ply", "out.obj", "out.stl"])
def test_a_node_of_scale_zero_is_named(target):
    tree = description()
    tree["nodes"][0]["scale"] = [1, 0, 1]
    write(tree, "in.glb")
    with pytest.raises(core.ShockError, match=r"in\.glb: m.* is scaled to 0"):
        filter_mesh_file(lift, "in.glb", target)


def test_infinite_positions_are_named_without_warnings():
    points = ARRAYS[0].copy()
    points[0] = np.inf, -np.inf, np.nan
    write(description(), "in.gltf")
    Path("a.bin").write_bytes(points.tobytes() + blob()[points.nbytes :])
    with pytest.raises(core.InvalidMesh, match="NaN or infinite positions"):
        filter_mesh_file(lift, "in.gltf", "out.gltf")


def test_a_node_of_scale_zero_does_not_hide_others():
    tree = description()
    tree["nodes"][0]["scale"] = [1, 0, 1]
    tree["nodes"].append({"mesh": 0})
    tree["scenes"][0]["nodes"].append(2)
    write(tree, "in.glb")
    filter_mesh_file(lift, "in.glb", "out.glb")
    points = GltfFile(Path("out.glb")).vertices
    np.testing.assert_allclose(points, TRIANGLE + 1)


def test_half_letters_in_names_are_kept():
    tree = description()
    tree["meshes"][0]["name"] = "\ud800"
    write(tree)
    filter_mesh_file(lift, "in.gltf", "out.gltf")
    assert json.loads(Path("out.gltf").read_bytes())["meshes"][0]["name"] == "\ud800"


# ---------------------------------------------------------------------------------- morph targets

MORPHS = "morph targets were left as they were: only the shape without them changed"


@pytest.mark.parametrize("name", ["in.gltf", "in.glb"])
def test_morph_targets_are_said_to_stay(name):
    tree = description()
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["attributes"]["TANGENT"] = 5
    primitive["targets"] = [{"POSITION": 2, "TANGENT": 2}, {"NORMAL": 2}]
    write(tree, name)
    outcome = filter_mesh_file(lift, name, f"out{name[2:]}")
    assert MORPHS in outcome.notes
    written = GltfFile(Path(f"out{name[2:]}"))._tree["meshes"][0]["primitives"][0]
    assert "TANGENT" not in written["attributes"]
    assert written["targets"] == [{"POSITION": 2}, {"NORMAL": 2}]  # none without that of the base
    still = core.GeometrySettings(time=0)
    assert MORPHS not in sharpen_file(name, f"same{name[2:]}", still).notes


def test_colors_of_morph_targets_are_said_to_stay():
    tree = description()
    tree["meshes"][0]["primitives"][0]["targets"] = [{"COLOR_0": 4}]
    write(tree)
    outcome = filter_colors_file(lambda mesh, colors, mask=None: 1 - colors, "in.gltf", "out.gltf")
    assert MORPHS in outcome.notes


def with_twin():
    """Two tetrahedra that share normals and colors, as optimizers leave those that are equal."""
    tree = description()
    tree["accessors"].append(sparse(0))  # other positions
    twin = copy.deepcopy(tree["meshes"][0])
    twin["primitives"][0]["attributes"]["POSITION"] = len(tree["accessors"]) - 1
    tree["meshes"].append(twin)
    tree["nodes"].append({"mesh": 1, "translation": [9, 0, 0]})
    tree["accessors"][2] |= {"min": [0, 0, 1], "max": [0, 0, 1]}
    return tree


def arrays_of(name, attribute):
    """An attribute of each mesh, and its accessor's description."""
    document = GltfFile(Path(name))
    tree = document._tree
    numbers = [mesh["primitives"][0]["attributes"][attribute] for mesh in tree["meshes"]]
    return [document._array(number) for number in numbers], [tree["accessors"][n] for n in numbers]


@pytest.mark.parametrize("name", ["in.gltf", "in.glb"])
def test_meshes_that_share_normals_get_their_own_where_they_differ(name):
    def squeezed(mesh, mask):
        return mesh.vertices * [1, 1, 0.5]

    write(with_twin(), name)
    filter_mesh_file(squeezed, name, f"out{Path(name).suffix}")
    found, accessors = arrays_of(f"out{Path(name).suffix}", "NORMAL")
    points = TRIANGLE, SPARSE_POINTS
    for normals, places, accessor in zip(found, points, accessors, strict=True):
        corners = (places * [1, 1, 0.5])[CORNERS.reshape(-1, 3)]
        a, b, c = corners.transpose(1, 0, 2)
        wanted = np.zeros((4, 3))
        np.add.at(wanted, CORNERS, np.repeat(np.cross(b - a, c - a), 3, axis=0))
        lengths = np.linalg.norm(wanted, axis=1, keepdims=True)
        cosines = np.einsum("ij,ij->i", normals, wanted / lengths)
        np.testing.assert_allclose(abs(cosines), 1, atol=1e-6)
        assert not {"min", "max"} & accessor.keys()


def test_meshes_that_share_normals_go_on_sharing_them_where_they_agree():
    tree = with_twin()
    tree["meshes"][1]["primitives"][0]["attributes"]["POSITION"] = len(tree["accessors"])
    tree["accessors"].append(tree["accessors"][0] | {"name": "a copy"})
    write(tree)
    filter_mesh_file(lambda mesh, mask: mesh.vertices * [1, 1, 0.5], "in.gltf", "out.gltf")
    meshes = json.loads(Path("out.gltf").read_text())["meshes"]
    assert len({mesh["primitives"][0]["attributes"]["NORMAL"] for mesh in meshes}) == 1


def test_normals_that_are_stored_as_positions_leave_these_alone():
    tree = description()
    tree["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 0  # as of a ball
    write(tree)
    filter_mesh_file(lift, "in.gltf", "out.gltf")
    np.testing.assert_allclose(vertices("out.gltf"), ordered(TRIANGLE + [2, 1, 1]))
    (normals,), _ = arrays_of("out.gltf", "NORMAL")
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-6)


def test_normals_that_also_serve_as_colors_leave_these_alone():
    """As those of green ground, where y is up, would."""
    tree = description()
    tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
    write(tree)
    filter_mesh_file(lambda mesh, mask: mesh.vertices * [1, 1, 0.5], "in.gltf", "out.gltf")
    (colors,), _ = arrays_of("out.gltf", "COLOR_0")
    np.testing.assert_array_equal(colors, NORMALS)
    (normals,), _ = arrays_of("out.gltf", "NORMAL")
    assert not np.array_equal(normals, NORMALS)


def test_colors_that_also_serve_as_moves_leave_these_alone():
    tree = description()
    primitive = tree["meshes"][0]["primitives"][0]
    primitive["attributes"]["COLOR_0"] = 2
    primitive["targets"] = [{"POSITION": 2}]
    write(tree)
    filter_colors_file(lambda mesh, colors, mask=None: colors + 0.25, "in.gltf", "out.gltf")
    tree = json.loads(Path("out.gltf").read_text())
    moves = tree["meshes"][0]["primitives"][0]["targets"][0]["POSITION"]
    np.testing.assert_array_equal(GltfFile(Path("out.gltf"))._array(moves), NORMALS)
    (colors,), _ = arrays_of("out.gltf", "COLOR_0")
    np.testing.assert_array_equal(colors, NORMALS + 0.25)


def test_colors_of_three_bytes_are_padded_to_four_where_they_are_stored_anew():
    """The format asks for it."""
    tree = with_twin()
    tree["accessors"][4]["type"], tree["bufferViews"][4]["byteStride"] = "VEC3", 4

    def by_place(mesh, colors, mask=None):
        return np.full_like(colors, 0.2 if mesh.vertices[:, 0].max() < 5 else 0.8)

    write(tree)
    filter_colors_file(by_place, "in.gltf", "out.gltf")
    found, accessors = arrays_of("out.gltf", "COLOR_0")
    assert [each.max() for each in found] == [51, 204]
    views = json.loads(Path("out.gltf").read_text())["bufferViews"]
    assert [views[each["bufferView"]]["byteStride"] for each in accessors] == [4, 4]


def test_meshes_that_share_colors_get_their_own_where_they_differ():
    def by_place(mesh, colors, mask=None):
        return np.full_like(colors, 0.2 if mesh.vertices[:, 0].max() < 5 else 0.8)

    write(with_twin())
    assert filter_colors_file(by_place, "in.gltf", "out.gltf").changed == 8
    found, _ = arrays_of("out.gltf", "COLOR_0")
    for colors, red in zip(found, (51, 204), strict=True):
        np.testing.assert_array_equal(colors, np.tile([red, red, red, 128], (4, 1)))


# ----------------------------------------------------------------------------------- what is broken


def broken(place, value):
    """The description with another value at a place; without it, if that is None."""
    tree = description()
    tree["accessors"][2] = sparse()
    part = tree
    for key in place[:-1]:
        part = part[key]
    if value is None:
        del part[place[-1]]
    else:
        part[place[-1]] = value
    return tree


BROKEN = [
    (("accessors", 0, "count"), None, r"accessors\[0\]\.count is not a whole number"),
    (("accessors", 0, "count"), -1, r"accessors\[0\]\.count is not a whole number"),
    (("accessors", 0, "count"), 2.0, r"accessors\[0\]\.count is not a whole number"),
    (("accessors", 0, "count"), 5, r"accessors\[\d\], the \w+ of meshes\[0\]"),
    (("accessors", 0, "type"), "VEC9", r"accessors\[0\]\.type is 'VEC9'"),
    (("accessors", 0, "type"), [], r"accessors\[0\]\.type is \[\]"),
    (("accessors", 0, "type"), "VEC2", r"accessors\[0\], the POSITION .* is a VEC2"),
    (("accessors", 0, "componentType"), 7, r"accessors\[0\]\.componentType is 7"),
    (("accessors", 0, "bufferView"), 99, r"bufferView names bufferViews\[99\], which is not"),
    (("accessors", 0, "byteOffset"), 10**30, r"accessors\[0\] reaches beyond buffers\[0\]"),
    (("accessors", 1, "componentType"), 5126, r"accessors\[1\], the indices of"),
    (("accessors", 1, "count"), 10**9, r"accessors\[1\] reaches beyond buffers\[0\]"),
    (("accessors", 2, "sparse"), 3, r"accessors\[2\]\.sparse is not an object"),
    (("accessors", 2, "sparse", "indices"), None, r"sparse\.indices is not an object"),
    (("accessors", 2, "sparse", "count"), 5, r"sparse\.count is 5, of 4 entries"),
    (("accessors", 2, "sparse", "indices", "bufferView"), 5, r"indices name entries that are not"),
    (("accessors", 2, "sparse", "values", "byteOffset"), 900, r"sparse\.values reaches beyond"),
    (("accessors", 2, "sparse", "indices", "componentType"), 5126, r"componentType is 5126"),
    (("accessors",), None, r"names accessors\[\d\], which is not there"),
    (("accessors",), {}, "accessors is not a list"),
    (("accessors", 1), "x", r"accessors\[1\] is not an object"),
    (("bufferViews",), None, r"names bufferViews\[\d\], which is not there"),
    (("bufferViews", 0, "buffer"), 3, r"bufferViews\[0\]\.buffer names buffers\[3\]"),
    (("bufferViews", 0, "byteOffset"), "x", r"bufferViews\[0\]\.byteOffset is not a whole"),
    (("bufferViews", 0, "byteStride"), 1, r"bufferViews\[0\]\.byteStride is less than"),
    (("bufferViews", 0, "extensions"), [], r"bufferViews\[0\]\.extensions is not an object"),
    (("buffers",), None, r"bufferViews\[0\]\.buffer names buffers\[0\]"),
    (("buffers", 0, "byteLength"), None, r"buffers\[0\]\.byteLength is not a whole number"),
    (("buffers", 0, "uri"), 5, r"buffers\[0\]\.uri is not a text"),
    (("buffers", 0, "uri"), "data:,AAA", r"buffers\[0\]\.uri cannot be decoded"),
    (("buffers", 0, "uri"), "data:;base64,AAAA", r"buffers\[0\] holds 3 of \d+ bytes"),
    (("meshes", 0, "primitives"), None, r"meshes\[0\]\.primitives is not a list"),
    (("meshes", 0, "primitives", 0), [], r"meshes\[0\]\.primitives\[0\] is not an object"),
    (("meshes", 0, "primitives", 0, "attributes"), None, r"attributes is not an object"),
    (("meshes", 0, "primitives", 0, "indices"), "a", r"primitives\[0\]\.indices is not a whole"),
    (("meshes", 0, "primitives", 0, "material"), 9, r"material names materials\[9\]"),
    (("meshes", 0, "primitives", 0, "targets"), [3], r"targets\[0\] is not an object"),
    (("nodes", 0, "mesh"), 8, r"nodes\[0\]\.mesh names meshes\[8\]"),
    (("nodes", 0, "children"), [7], r"nodes\[0\]\.children names nodes\[7\]"),
    (("nodes", 0, "rotation"), [0, 1], r"nodes\[0\]\.rotation is not 4 numbers"),
    (("nodes", 0, "scale"), [1, 1, "x"], r"nodes\[0\]\.scale is not 3 numbers"),
    (("nodes", 1, "matrix"), [float("nan")] * 16, r"nodes\[1\]\.matrix is not 16 numbers"),
    (("materials", 0, "name"), 3, r"materials\[0\]\.name is not a text"),
    (("extensionsUsed",), [3], "extensionsUsed is not a text"),
]


@pytest.mark.parametrize("place, value, words", BROKEN)
def test_what_is_broken_is_named(place, value, words, caplog):
    write(broken(place, value))
    for target in ("out.gltf", "out.ply"):
        with pytest.raises(core.ShockError, match=words):
            filter_mesh_file(lift, "in.gltf", target)
    assert not caplog.records
    assert not list(Path().glob("out*"))


@pytest.mark.parametrize("text", [b"[]", b"7", b"null", b"[" * 100_000])
def test_what_is_no_description_is_named(text):
    Path("in.gltf").write_bytes(text)
    with pytest.raises(core.ShockError, match="its description is"):
        filter_mesh_file(lift, "in.gltf", "out.gltf")


OTHERS = [
    *(None, True, 0, 1, -1, 3, 255, 2**31, 10**30, 1.5, float("nan"), 1e308, 5126, 5125),
    *("", "x", "../x", "data:,", "\ud800", "\0", "VEC3", [], [1], [None], {}, {"a": 1}),
    *({"bufferView": 0}, [0, 0, 0], [1e200] * 16, [0] * 16, ["x"] * 3),
]


def places(part, place=()):
    keys = part if isinstance(part, dict) else range(len(part)) if isinstance(part, list) else ()
    for key in keys:
        yield (*place, key)
        yield from places(part[key], (*place, key))


def test_changed_descriptions_are_read_or_refused_in_a_sentence(caplog):
    """A few hundred of the many thousand that were tried."""
    choose = random.Random(7)
    whole = description()
    whole["accessors"] += [sparse(0), sparse()]
    whole["meshes"][0]["primitives"].append(
        {"attributes": {"POSITION": 8, "NORMAL": 9}, "indices": 1}
    )
    caplog.set_level(logging.ERROR, "shock_filter")
    refused = 0
    for number in range(250):
        tree = copy.deepcopy(whole)
        place = choose.choice(list(places(tree)))
        part = tree
        for key in place[:-1]:
            part = part[key]
        if choose.random() < 0.3:
            del part[place[-1]]
        else:
            part[place[-1]] = choose.choice(OTHERS)
        name = ("in.gltf", "in.glb")[number % 2]
        write(tree, name)
        target = f"out{choose.choice([name[2:], '.ply', '.obj'])}"
        try:
            filter_mesh_file(lift, name, target, OVERWRITE)
            filter_colors_file(lambda mesh, colors, mask: 1 - colors, name, f"c{name}", OVERWRITE)
            read_textured_mesh(name)
        except core.ShockError:
            refused += 1
    assert 50 < refused < 220
    assert not caplog.records


def test_a_mesh_that_stands_in_a_scene_twice_counts_where_it_stands_first():
    nodes = [{"mesh": 0, "translation": [1, 0, 0]}, {"mesh": 0, "translation": [2, 0, 0]}]
    parent = {"children": [0], "scale": [3, 3, 3]}
    assert _gltf_matrices({"nodes": nodes})[0][0, 3] == 1
    assert _gltf_matrices({"nodes": [*nodes, parent]})[0][0, 3] == 2  # of roots, then of children
