# SPDX-License-Identifier: GPL-3.0-or-later
"""Textures on disk: meshes with coordinates of all formats, images, masks."""

import json
import struct

import numpy as np
import pytest
from on_files import dilate_texture_file, sharpen_file, sharpen_texture_file
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files.output import Options
from shock_filter.core.files.textures import (
    filter_texture_file,
    read_textured_mesh,
    texture_mask_file,
)
from shock_filter.core.settings import MaskSettings, describe

SIZE = 64
GAP = 0.25
STILL = core.TextureSettings(time=0)
STRONG = core.TextureSettings(time=1024)


def sheet(cells=8):
    """A flat sheet of quads whose halves are two charts with a gap between them.

    Returns positions (n, 3), quads (m, 4) and their texture coordinates (m, 4, 2).
    """
    x, y = np.meshgrid(np.linspace(0, 1, cells + 1), np.linspace(0, 1, cells + 1))
    points = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    first = (np.arange(cells)[:, None] * (cells + 1) + np.arange(cells)).ravel()
    quads = np.stack([first, first + 1, first + cells + 2, first + cells + 1], axis=1)
    uv = points[quads, :2] * (1 - GAP, 1.0)
    uv[..., 0] += GAP * (points[quads, 0].mean(axis=1) > 0.5)[:, None]
    return points, quads, uv


def triangles(rows):
    """Cut quads into fans."""
    return np.concatenate([rows[:, None, [0, 1, 2]], rows[:, None, [0, 2, 3]]], axis=1).reshape(
        -1, 3, *rows.shape[2:]
    )


def split_sheet():
    """Vertices that are split along the seam: positions, triangles, coordinates of vertices."""
    points, quads, uv = sheet()
    rows = np.concatenate([points[quads], uv], axis=2).reshape(-1, 5)
    kept, index = np.unique(rows, axis=0, return_inverse=True)
    return kept[:, :3], triangles(index.reshape(quads.shape)), kept[:, 3:]


def write_obj(path, material=("", "")):
    """OBJ with quads; the halves have these materials."""
    points, quads, uv = sheet()
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points]
    lines += [f"vt {u:.9g} {v:.9g}" for u, v in uv.reshape(-1, 2)]
    for k, quad in enumerate(quads):
        name = material[int(points[quad, 0].mean() > 0.5)]
        lines += [f"usemtl {name}"] * bool(name)
        lines.append("f " + " ".join(f"{v + 1}/{4 * k + n + 1}" for n, v in enumerate(quad)))
    path.write_text("\n".join(lines))


def write_vertex_ply(path, names=("s", "t")):
    points, faces, uv = split_sheet()
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in ("x", "y", "z", *names)),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header",
    ]
    rows = [" ".join(f"{v:.9g}" for v in row) for row in np.hstack([points, uv])]
    rows += ["3 " + " ".join(map(str, face)) for face in faces]
    path.write_text("\n".join([*header, *rows]) + "\n")


def write_face_ply(path):
    points, quads, uv = sheet()
    header = [
        "ply",
        "format ascii 1.0",
        f"element vertex {len(points)}",
        *(f"property float {name}" for name in "xyz"),
        f"element face {2 * len(quads)}",
        "property list uchar int vertex_indices",
        "property list uchar float texcoord",
        "end_header",
    ]
    rows = [" ".join(f"{v:.9g}" for v in row) for row in points]
    for face, corners in zip(triangles(quads), triangles(uv), strict=True):
        numbers = " ".join(f"{v:.9g}" for v in corners.ravel())
        rows.append("3 " + " ".join(map(str, face)) + " 6 " + numbers)
    path.write_text("\n".join([*header, *rows]) + "\n")


def write_glb(path, dtype=np.float32):
    points, faces, uv = split_sheet()
    uv = np.column_stack([uv[:, 0], 1 - uv[:, 1]])  # glTF counts v downwards
    if np.dtype(dtype).kind == "u":
        uv = np.rint(uv * np.iinfo(dtype).max)
    blocks = [points.astype("<f4"), uv.astype(dtype), faces.astype("<u2")]
    views, place, data = [], 0, b""
    for block in blocks:
        raw = block.tobytes()
        views.append({"buffer": 0, "byteOffset": place, "byteLength": len(raw)})
        data += raw + bytes(-len(raw) % 4)
        place = len(data)
    kind = {"f": 5126, "u": 5123}[np.dtype(dtype).kind]
    tree = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3",
             "min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()},
            {"bufferView": 1, "componentType": kind, "count": len(points), "type": "VEC2",
             "normalized": kind == 5123},
            {"bufferView": 2, "componentType": 5123, "count": faces.size, "type": "SCALAR"},
        ],
        "materials": [{"name": "Wood"}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2,
                                    "material": 0}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
        "scene": 0,
    }  # fmt: skip
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(data), 0x004E4942) + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)


def with_color(path, use):
    """Let the material of a GLB file show a texture."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    tree, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    tree |= {"images": [{"uri": "color.png"}], "textures": [{"source": 0}]}
    tree["materials"][0]["pbrMetallicRoughness"] = {"baseColorTexture": {"index": 0, **use}}
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    path.write_bytes(head + text + rest)


def transform(**values):
    return {"extensions": {"KHR_texture_transform": values}}


WRITERS = {
    "quads.obj": write_obj,
    "vertices.ply": write_vertex_ply,
    "uv.ply": lambda path: write_vertex_ply(path, ("u", "v")),
    "texture.ply": lambda path: write_vertex_ply(path, ("texture_u", "texture_v")),
    "faces.ply": write_face_ply,
    "floats.glb": write_glb,
    "shorts.glb": lambda path: write_glb(path, np.uint16),
}


def picture(dtype=np.uint8):
    """A soft edge left of the seam, drawn in both charts; rows differ. Row 0 is the top."""
    u = (np.arange(SIZE) + 0.5) / SIZE
    x = np.where(u < 0.5, u, u - GAP) / (1 - GAP)
    step = 0.5 + 0.4 * np.tanh((x - 0.45) / 0.06)
    rows = np.linspace(0.6, 1.0, SIZE)[:, None]
    values = np.stack([rows * step, rows * (1 - step), 0.5 * rows * step], axis=-1)
    values[:, (u > 0.5 * (1 - GAP)) & (u < 0.5 * (1 - GAP) + GAP)] = 0.0
    if np.dtype(dtype).kind == "u":
        values = np.rint(values * np.iinfo(dtype).max)
    return values.astype(dtype)


@pytest.fixture
def mesh(tmp_path):
    path = tmp_path / "mesh.obj"
    write_obj(path)
    return path


@pytest.fixture
def texture(tmp_path):
    path = tmp_path / "in.png"
    Image.fromarray(picture()).save(path)
    return path


def pixels_of(path):
    with Image.open(path) as image:
        return np.array(image)


# ------------------------------------------------------------------------------------------ meshes


@pytest.mark.parametrize("name", WRITERS)
def test_all_formats_give_the_same_surface(tmp_path, name):
    WRITERS[name](tmp_path / name)
    read = read_textured_mesh(tmp_path / name)
    points, _, _ = sheet()
    assert len(np.unique(read.mesh.faces)) == len(points)  # joined along the seam
    corners = read.mesh.vertices[read.mesh.faces]
    assert not read.mesh.flipped.any()
    expected = corners[..., :2] * (1 - GAP, 1.0)
    expected[..., 0] += GAP * (corners[..., 0].mean(axis=1) > 0.5)[:, None]
    np.testing.assert_allclose(read.uv, expected, atol=2e-5)
    assert read.notes == ()


def test_one_material_can_be_chosen(tmp_path):
    write_obj(tmp_path / "two.obj", ("Wood", "Fine Stone"))
    whole = read_textured_mesh(tmp_path / "two.obj")
    assert whole.notes == ("all materials (Fine Stone, Wood) count; choose one with --material",)
    part = read_textured_mesh(tmp_path / "two.obj", "Fine Stone")
    assert part.mesh.face_count == whole.mesh.face_count // 2
    assert (part.uv[..., 0] > 0.5).all()
    assert part.notes == ()
    with pytest.raises(core.ShockError, match=r"no material 'Metal'; it has: Fine Stone, Wood\."):
        read_textured_mesh(tmp_path / "two.obj", "Metal")
    write_glb(tmp_path / "one.glb")
    assert len(read_textured_mesh(tmp_path / "one.glb", "Wood").uv) == 128
    text = (tmp_path / "two.obj").read_text().splitlines()
    bare = [line for line in text if not line.startswith("usemtl")]
    (tmp_path / "bare.obj").write_text("\n".join(bare))
    with pytest.raises(core.ShockError, match="'Wood'; it names none; leave --material out"):
        read_textured_mesh(tmp_path / "bare.obj", "Wood")


@pytest.mark.parametrize(
    ("use", "words"),
    [
        ({"texCoord": 1}, "other texture coordinates"),
        (transform(texCoord=1), "other texture coordinates"),
        (transform(scale=[2, 2]), "are transformed"),
        (transform(rotation=0.5), "are transformed"),
        (transform(offset=[0, 0], scale=[1, 1]), ""),
        ({"texCoord": 1, **transform(texCoord=0)}, ""),
    ],
)
def test_colors_that_are_shown_elsewhere_are_refused(tmp_path, texture, use, words):
    write_glb(tmp_path / "in.glb")
    with_color(tmp_path / "in.glb", use)
    if not words:
        assert not read_textured_mesh(tmp_path / "in.glb", shown=True).notes
        return
    with pytest.raises(core.ShockError, match=f"color of Wood: .*{words}"):
        read_textured_mesh(tmp_path / "in.glb", shown=True)
    with pytest.raises(core.ShockError, match=words):
        filter_texture_file(None, tmp_path / "in.glb", texture, tmp_path / "out.png")
    assert any(words in note for note in read_textured_mesh(tmp_path / "in.glb").notes)


def test_colors_that_an_obj_file_moves_are_refused(tmp_path, texture):
    (tmp_path / "color.png").write_bytes(b"")
    (tmp_path / "in.mtl").write_text("newmtl Wood\nmap_Kd -s 2 2 1 color.png\n")
    write_obj(tmp_path / "in.obj", ("Wood", "Wood"))
    (tmp_path / "in.obj").write_text("mtllib in.mtl\n" + (tmp_path / "in.obj").read_text())
    with pytest.raises(core.ShockError, match=r"color of Wood: .*are transformed"):
        filter_texture_file(None, tmp_path / "in.obj", texture, tmp_path / "out.png")


def test_faces_without_coordinates_are_left_out(tmp_path, mesh):
    text = mesh.read_text() + "\nv 5 5 5\nf 1 2 82\n"
    mesh.write_text(text)
    read = read_textured_mesh(mesh)
    assert len(read.uv) == 128
    assert read.notes == ("1 triangles have no texture coordinates: left out",)


def test_negative_numbers_count_backwards(tmp_path):
    path = tmp_path / "back.obj"
    path.write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0.5\nf -3/-3 -2/-2/ -1/-1 # corner\n"
    )
    read = read_textured_mesh(path)
    np.testing.assert_array_equal(read.uv, [[[0, 0], [1, 0], [0.5, 0]]])


@pytest.mark.parametrize(
    ("name", "text", "error", "sentence"),
    [
        ("bare.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", core.InvalidUV,
         "has no texture coordinates; unwrap it"),
        ("bad.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/7\n", core.InvalidMesh,
         "names a texture coordinate that is not there"),
        ("word.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 x\nf 1/1 2/1 3/1\n", core.ShockError,
         "word.obj cannot be read; is it damaged"),
        ("box.stl", "solid\n", core.ShockError, r"stl: such files hold no texture"),
        ("odd.xyz", "", core.ShockError, "such files hold no texture coordinates"),
        ("gone.obj", None, core.ShockError, "There is no file"),
    ],
)  # fmt: skip
def test_bad_meshes_are_named(tmp_path, texture, name, text, error, sentence):
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(error, match=sentence):
        sharpen_texture_file(tmp_path / name, texture, tmp_path / "out.png")
    assert not (tmp_path / "out.png").exists()


def test_coordinates_survive_geometry_sharpening(tmp_path, mesh):
    sharpen_file(mesh, tmp_path / "new.obj", core.GeometrySettings(time=16))
    before, after = read_textured_mesh(mesh), read_textured_mesh(tmp_path / "new.obj")
    np.testing.assert_array_equal(before.uv, after.uv)


# ---------------------------------------------------------------------------------------- filtering


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32, np.float16])
def test_files_get_what_the_core_gives(tmp_path, mesh, dtype):
    np.save(tmp_path / "in.npy", picture(dtype))
    outcome = sharpen_texture_file(mesh, tmp_path / "in.npy", tmp_path / "out.npy", STRONG)
    read = read_textured_mesh(mesh)
    given = picture(dtype)[::-1]
    given = given.astype(np.float32) if dtype == np.float16 else given
    wanted = core.sharpen_texture(read.mesh, read.uv, given, STRONG)[::-1].astype(dtype)
    result = np.load(tmp_path / "out.npy")
    assert result.dtype == dtype
    np.testing.assert_array_equal(result, wanted)
    assert str(outcome) == f"changed {outcome.changed} of {SIZE * SIZE} pixels"
    assert outcome.changed == (result != picture(dtype)).any(axis=2).sum() > 100


def test_colors_flow_across_the_seam_and_rows_keep_their_place(tmp_path, mesh, texture):
    sharpen_texture_file(mesh, texture, tmp_path / "out.png", core.TextureSettings(time=4096))
    old, new = picture().astype(float), pixels_of(tmp_path / "out.png").astype(float)
    right = slice(40, 63)  # all of it lies beyond the edge
    assert np.ptp(old[32, right, 0]) > 10
    assert np.ptp(new[32, right, 0]) < 6
    assert new[4, 50, 0] < 0.8 * new[-5, 50, 0]  # the top stays darker


def test_time_zero_copies_the_file(tmp_path, mesh, texture):
    outcome = sharpen_texture_file(mesh, texture, tmp_path / "out.png", STILL)
    assert (tmp_path / "out.png").read_bytes() == texture.read_bytes()
    assert outcome.changed == 0


@pytest.mark.parametrize("invert", [False, True])
def test_a_mask_protects(tmp_path, mesh, texture, invert):
    weights = np.zeros((SIZE, SIZE), dtype=np.uint8)
    weights[: SIZE // 2] = 255  # the upper half
    Image.fromarray(weights).save(tmp_path / "mask.png")
    settings = core.TextureSettings(time=1024, gutter=0)
    sharpen_texture_file(
        mesh, texture, tmp_path / "out.png", settings, mask=tmp_path / "mask.png",
        invert_mask=invert,
    )  # fmt: skip
    inside = np.r_[4:20, 44:60]
    changed = (pixels_of(tmp_path / "out.png") != picture()).any(axis=2)[:, inside].any(axis=1)
    upper, lower = changed[4 : SIZE // 2 - 2], changed[SIZE // 2 + 2 : -4]
    kept, free = (upper, lower) if invert else (lower, upper)
    assert not kept.any()
    assert free.all()


def test_dilation_fills_around_the_charts(tmp_path, mesh, texture):
    settings = core.DilateSettings(gutter=4)
    outcome = dilate_texture_file(mesh, texture, tmp_path / "out.png", settings)
    old, new = picture(), pixels_of(tmp_path / "out.png")
    filled = np.flatnonzero((old != new).any(axis=(0, 2)))
    np.testing.assert_array_equal(filled, [*range(24, 28), *range(36, 40)])
    assert outcome.changed == 8 * SIZE
    np.testing.assert_allclose(new[8:-8, 24:28].astype(int), old[8:-8, 40:44], atol=12)


def test_unusual_coordinates_are_mentioned(tmp_path, mesh, texture):
    lines = [
        f"vt {3 * float(line.split()[1]):g} {line.split()[2]}" if line.startswith("vt") else line
        for line in mesh.read_text().splitlines()
    ]
    mesh.write_text("\n".join(lines))
    outcome = dilate_texture_file(mesh, texture, tmp_path / "out.png")
    assert any("overlap" in note for note in outcome.notes)
    assert any("leave the image" in note for note in outcome.notes)


def test_cancelling_writes_nothing(tmp_path, mesh, texture):
    fractions = []

    def stop(fraction, message):
        fractions.append(fraction)
        return fraction < 0.6

    with pytest.raises(core.Cancelled):
        sharpen_texture_file(mesh, texture, tmp_path / "out.png", progress=stop)
    assert fractions == sorted(fractions)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.png", "mesh.obj"]


# -------------------------------------------------------------------------------------------- masks


def test_masks_as_numbers(tmp_path, mesh):
    read = read_textured_mesh(mesh)
    masks = core.TextureAtlas(read.mesh, read.uv, size=(32, SIZE)).masks()
    for kind in describe(MaskSettings)["kind"][2].choices:
        wanted = getattr(masks, kind)[::-1]
        for ending in ("npy", "tif", "exr"):
            path = tmp_path / f"{kind}.{ending}"
            outcome = texture_mask_file(mesh, path, kind, (32, SIZE))
            if ending == "npy":
                np.testing.assert_array_equal(np.load(path), wanted)
            else:
                np.testing.assert_array_equal(floats_of(path), wanted.astype(np.float32))
    assert str(outcome) == f"2 charts, {masks.active.sum()} of {32 * SIZE} texels active"
    assert masks.face.min() == -1
    assert set(np.unique(masks.chart)) == {-1, 0, 1}


def floats_of(path):
    if path.suffix == ".tif":
        import tifffile

        return tifffile.imread(path)
    import OpenEXR

    with OpenEXR.File(str(path)) as file:
        return file.channels()["Y"].pixels.copy()


def test_masks_as_pictures(tmp_path, mesh, texture):
    def drawn(kind):
        path = tmp_path / f"{kind}.png"
        texture_mask_file(mesh, path, kind, texture, Options(overwrite=True))
        return pixels_of(path)

    active, boundary, count = (drawn(kind) for kind in ("active", "boundary", "count"))
    assert set(np.unique(active)) == {0, 255}
    assert (active[boundary > 0] == 255).all()
    assert (count[4:-4, 4:20] == 64).all()
    assert (count[:, 32] == 0).all()  # no chart lies there
    charts = drawn("chart")
    assert charts.shape == (SIZE, SIZE, 3)
    assert (charts[5, 5] != charts[5, -5]).any()
    assert (charts[:, 32] == 0).all()
    assert (charts[:, 5] >= 64).all()
    faces = drawn("face")
    assert len(np.unique(faces.reshape(-1, 3), axis=0)) > 100
    np.testing.assert_array_equal(faces, drawn("face"))


def test_masks_that_cannot_be_written_are_named(tmp_path, mesh):
    with pytest.raises(core.ShockError, match=r"\.webp cannot hold 1 channels of uint8; write one"):
        texture_mask_file(mesh, tmp_path / "out.webp", "active", (8, 8))
    with pytest.raises(core.ShockError, match="cannot handle this ending"):
        texture_mask_file(mesh, tmp_path / "out.obj", "active", (8, 8))
    with pytest.raises(core.ShockError, match="There is no file"):
        texture_mask_file(mesh, tmp_path / "out.png", "active", tmp_path / "gone.png")
    texture_mask_file(mesh, tmp_path / "out.png", "active", (8, 8))
    with pytest.raises(core.ShockError, match="exists already"):
        texture_mask_file(mesh, tmp_path / "out.png", "active", (8, 8))


# ------------------------------------------------------------------------------------ command line


def test_the_command_line_reaches_all_of_it(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "mesh.obj", ("Wood", "Stone"))
    for name in ("a.png", "b.png"):
        Image.fromarray(picture()).save(name)
    words = ["sharpen-texture", "mesh.obj", "a.png", "b.png", "out", "--time", "256"]
    assert cli.main(words) == 0
    assert (pixels_of("out/a.png") != picture()).any()
    np.testing.assert_array_equal(pixels_of("out/a.png"), pixels_of("out/b.png"))
    out, err = capsys.readouterr()
    assert out.splitlines()[0].startswith("a.png -> out/a.png: changed ")
    assert out.splitlines()[1] == "  all materials (Stone, Wood) count; choose one with --material"
    assert cli.main(["dilate-texture", "mesh.obj", "a.png", "d.png", "--material", "Wood"]) == 0
    assert cli.main(["texture-mask", "mesh.obj", "m.npy", "--size", "20x10", "--kind", "face"]) == 0
    assert np.load("m.npy").shape == (10, 20)
    capsys.readouterr()
    (tmp_path / "bare.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    assert cli.main(["sharpen-texture", "bare.obj", "a.png", "e.png"]) == 1
    err = capsys.readouterr().err
    assert "bare.obj has no texture coordinates; unwrap it (in Blender: UV > Unwrap)" in err
    assert not (tmp_path / "e.png").exists()


def test_gain_maps_are_read_as_they_are_stored(tmp_path):
    write_obj(tmp_path / "mesh.obj")
    y, x = np.mgrid[:SIZE, :SIZE]
    image = np.rint(127 + 25 * np.sin(x * np.pi / 4) * np.sin(y * np.pi / 4)).astype(np.uint8)
    Image.fromarray(image).save(tmp_path / "in.png")
    words = ["filter-texture", str(tmp_path / "mesh.obj"), str(tmp_path / "in.png")]

    def filtered(grays, name, *more):
        Image.fromarray(grays).save(tmp_path / "map.png")
        target = str(tmp_path / name)
        code = cli.main([*words, target, "--gain-map", str(tmp_path / "map.png"), *more])
        return code, np.array(Image.open(target)) if code == 0 else None

    for middle in (127, 128):
        code, same = filtered(np.full((SIZE, SIZE), middle, np.uint8), f"{middle}.png")
        assert code == 0
        np.testing.assert_array_equal(same, image)
    grays = np.repeat(np.uint8([0, 255]), SIZE // 2)[:, None] * np.ones(SIZE, np.uint8)
    code, result = filtered(grays, "out.png", "--gain", "3")
    left = slice(8, 20), slice(8, 20)
    right = slice(SIZE - 20, SIZE - 8), slice(8, 20)
    assert result[left].std() < 0.2 * image[left].std()
    assert 2.5 * image[right].std() < result[right].std() < 3.5 * image[right].std()
    mesh = read_textured_mesh(tmp_path / "mesh.obj")
    settings = core.FilterSettings(gain=3.0)
    gains = np.where(grays, 3.0, 0.0)[::-1]
    wanted = core.filter_texture(mesh.mesh, mesh.uv, image[::-1], settings, gain=gains)[::-1]
    np.testing.assert_array_equal(result, wanted)


def test_gain_maps_with_colors_are_refused(tmp_path, capsys):
    write_obj(tmp_path / "mesh.obj")
    for name, mode in (("in.png", "L"), ("map.png", "RGB")):
        Image.new(mode, (SIZE, SIZE)).save(tmp_path / name)
    words = [str(tmp_path / name) for name in ("mesh.obj", "in.png", "out.png")]
    assert cli.main(["filter-texture", *words, "--gain-map", str(tmp_path / "map.png")]) == 1
    assert "the gain map has colors or opacity; save it as a gray image" in capsys.readouterr().err


def three_pictures(folder):
    """Write pictures of one surface in different light, each of which knows a part."""
    write_obj(folder / "mesh.obj")
    y, x = np.mgrid[:SIZE, :SIZE]
    waves = 120 + 40 * np.cos(x * np.pi / 16) * np.cos(y * np.pi / 16)
    images = []
    for number, step in enumerate((0, 30, -20)):
        known = (x * 3 // SIZE >= number - 1) & (x * 3 // SIZE <= number + 1)
        gray = np.where(known, waves + step, 0)
        image = np.stack([gray, gray, gray, 255 * known], axis=-1).round().astype(np.uint8)
        Image.fromarray(image).save(folder / f"{number}.png")
        images.append(image)
    return [str(folder / f"{number}.png") for number in range(3)], images


def test_several_pictures_become_one(tmp_path):
    (source, *others), images = three_pictures(tmp_path)
    words = ["stitch-textures", str(tmp_path / "mesh.obj"), source, str(tmp_path / "out.png")]
    more = [word for path in others for word in ("--with", path)]
    assert cli.main([*words, *more, "--radius", "1000"]) == 0
    result = np.array(Image.open(tmp_path / "out.png"))
    mesh = read_textured_mesh(tmp_path / "mesh.obj")
    settings = core.StitchSettings(radius=1000.0)
    upright = [image[::-1] for image in images]
    wanted = core.stitch_textures(mesh.mesh, mesh.uv, upright, settings)[::-1]
    np.testing.assert_array_equal(result, wanted)
    inside = core.TextureAtlas(mesh.mesh, mesh.uv, size=(SIZE, SIZE)).inside[::-1]
    assert (result[inside][:, 3] == 255).all()
    assert (result[inside] != images[0][inside]).any(axis=1).mean() > 0.5


def test_pictures_that_do_not_fit_are_named(tmp_path, capsys):
    (source, other, _), images = three_pictures(tmp_path)
    words = ["stitch-textures", str(tmp_path / "mesh.obj"), source, str(tmp_path / "out.png")]
    for wrong in (images[1][:-1], images[1][..., :3]):
        Image.fromarray(wrong).save(other)
        assert cli.main([*words, "--with", other]) == 1
        said = capsys.readouterr().err
        assert f"{other} holds {SIZE} x" in said
        assert "save them with one size, the same channels and the same depth" in said
    assert cli.main([*words, "--with", str(tmp_path / "gone.png")]) == 1
    assert "gone.png" in capsys.readouterr().err
    assert not (tmp_path / "out.png").exists()


def drawn(tmp_path, command, name, *words, size=f"{SIZE}x{SIZE}"):
    """Run a command that makes an image of the sheet; return its code and the pixels."""
    write_obj(tmp_path / "mesh.obj")
    target = tmp_path / name
    code = cli.main([command, str(tmp_path / "mesh.obj"), str(target), "--size", size, *words])
    read = np.load if target.suffix == ".npy" else pixels_of
    return code, read(target) if code == 0 else None


def test_distances_are_drawn_from_meshes(tmp_path, capsys):
    code, found = drawn(tmp_path, "geodesic-distance", "out.npy", "--vertices", "0", "8")
    assert code == 0
    assert found.shape == (SIZE, SIZE)
    assert found.dtype == np.float32
    # Row 0 of files is at the top, the vertices at the bottom, where the sheet is 1 wide.
    assert found[-1, 0] < 0.02
    np.testing.assert_allclose(found[0, 0], 1.0, atol=0.02)
    assert " values 0.0" in capsys.readouterr().out
    gray = np.zeros((SIZE, SIZE), np.uint8)
    gray[-1] = 255
    Image.fromarray(gray).save(tmp_path / "start.png")
    words = ["--painted", str(tmp_path / "start.png"), "--look", "gradient"]
    code, picture = drawn(tmp_path, "geodesic-distance", "out.png", *words)
    assert code == 0
    assert picture.dtype == np.uint16
    assert picture[-1, 4] == 65535
    assert (np.diff(picture[:, 4].astype(int)) >= 0).all()


def test_streaks_and_patterns_are_drawn_from_meshes(tmp_path):
    code, streaks = drawn(tmp_path, "surface-streaks", "s.png", "--along", "x")
    assert code == 0
    part = streaks[8:-8, 4:20].astype(float)
    assert np.abs(np.diff(part, axis=1)).mean() < 0.5 * np.abs(np.diff(part, axis=0)).mean()
    code, pattern = drawn(tmp_path, "surface-pattern", "p.png", "--steps", "300", "--scale", "8")
    assert code == 0
    assert pattern.max() > 30000


def test_what_an_image_cannot_be_made_from_is_named(tmp_path, capsys):
    assert drawn(tmp_path, "geodesic-distance", "out.npy")[0] == 1
    assert "source" in capsys.readouterr().err
    assert drawn(tmp_path, "geodesic-distance", "out.npy", "--vertices", "999")[0] == 1
    assert "999" in capsys.readouterr().err
    assert not (tmp_path / "out.npy").exists()


@pytest.mark.parametrize("words", [["wear"], ["bake-maps", "--map", "occlusion"]])
def test_charts_smaller_than_all_texels_are_named(tmp_path, capsys, words):
    points = [[0, 0], [0.1, 0], [0.1, 0.1], [0, 0.1]]
    rows = [f"v {x} {y} 0" for x, y in points] + [f"vt {x} {y}" for x, y in points]
    source = tmp_path / "small.obj"
    source.write_text("\n".join([*rows, "f 1/1 2/2 3/3 4/4"]))
    target = tmp_path / "out.npy"
    command = [words[0], str(source), str(target), "--size", "2x2", *words[1:]]
    assert cli.main(command) == cli.FAILED
    assert "No chart covers the middle of a texel; use a larger image" in capsys.readouterr().err
    assert not target.exists()
