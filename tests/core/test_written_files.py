# SPDX-License-Identifier: GPL-3.0-or-later
"""What is written can be read, and replaces nothing but what was named as output."""

import json
import os
import struct
import sys
import zlib
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from shock_filter.core import cli
from shock_filter.core.files import images, reading
from shock_filter.core.files.formats.mesh.gltf import GltfFile
from shock_filter.core.files.formats.mesh.obj import ObjFile
from shock_filter.core.files.formats.mesh.ply import PlyFile
from shock_filter.core.files.formats.mesh.trimesh import SceneFile, load_scene
from shock_filter.core.files.images import filter_image_file
from shock_filter.core.files.meshes import filter_mesh_file
from shock_filter.core.files.output import Options
from test_image_files import picture, read, write

STRONG = core.ImageSettings(time=64)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def chunk(kind, data, check=None):
    body = kind + data
    crc = zlib.crc32(body) if check is None else check
    return struct.pack(">I", len(data)) + body + struct.pack(">I", crc)


FOREIGN = [
    b"<!DOCTYPE html><html><body>Not found</body></html>" * 5,
    b'<?xpacket end="w"?>',
    b"2026-01-01 12:00:00 done: file closed\n" * 3,
    b"\0\0\0\4abcd" + b"1234" + bytes(4),
]


@pytest.mark.parametrize("foreign", FOREIGN)
@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_bytes_behind_a_png_do_not_get_into_the_copy(foreign, dtype):
    pixels = picture(3, dtype)
    write("in.png", pixels)
    with Path("in.png").open("ab") as stream:
        stream.write(foreign)
    sharpen_image_file("in.png", "in.png", STRONG, overwrite=True)
    np.testing.assert_array_equal(read("in.png"), core.sharpen_image(pixels, STRONG))
    with Image.open("in.png") as image:
        image.verify()


def test_damaged_chunks_of_a_png_are_left_behind():
    write("in.png", picture())
    data = Path("in.png").read_bytes()
    good, bad = chunk(b"teXt", b"Title\0good"), chunk(b"teXt", b"Title\0bad", check=7)
    Path("in.png").write_bytes(data[:33] + good + data[33:-12] + bad + data[-12:])
    outcome = sharpen_image_file("in.png", "out.png", STRONG)
    result = Path("out.png").read_bytes()
    assert good in result
    assert bad not in result
    assert "damaged parts of the file (teXt): left behind" in outcome.notes


@pytest.mark.parametrize("name", ["in.png", "in.tif", "in.exr", "in.jpg", "in.webp", "in.bmp"])
@pytest.mark.parametrize("fault", ["cut", "other"])
def test_an_image_that_cannot_be_read_back_replaces_nothing(name, fault, monkeypatch):
    write(name, picture(3, "float32" if name == "in.exr" else "uint8"))
    before = Path(name).read_bytes()
    kind = images.FORMATS[Path(name).suffix]

    def spoil(path, image_file, pixels):
        other = pixels[:, :-1] if name == "in.jpg" else pixels[::-1]
        notes = kind.write(path, image_file, pixels if fault == "cut" else other)
        if fault == "cut":
            path.write_bytes(path.read_bytes()[:-200])
        return notes

    monkeypatch.setitem(images.FORMATS, Path(name).suffix, kind._replace(write=spoil))
    with pytest.raises(core.ShockError, match=f"{name} was not written: .* read back"):
        sharpen_image_file(name, name, STRONG, overwrite=True)
    assert Path(name).read_bytes() == before
    assert [path.name for path in Path().iterdir()] == [name]


# -------------------------------------------------------------------------------------- side files

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], dtype="<f4")
CORNERS = np.array([0, 1, 2, 0, 2, 3, 0, 3, 1, 1, 3, 2], dtype="<u2")


def gltf(path, uris, points=TRIANGLE, **more):
    """A tetrahedron whose positions and corners lie in buffers of their own, or in one."""
    blocks = [points.tobytes(), CORNERS.tobytes()]
    if len(uris) == 1:
        blocks = [b"".join(blocks)]
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(points), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(CORNERS), "type": "SCALAR"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": points.nbytes},
            {
                "buffer": len(uris) - 1,
                "byteOffset": points.nbytes if len(uris) == 1 else 0,
                "byteLength": CORNERS.nbytes,
            },
        ],
        "buffers": [
            {"uri": uri, "byteLength": len(block)} for uri, block in zip(uris, blocks, strict=True)
        ],
        **more,
    }
    path.parent.mkdir(exist_ok=True)
    path.write_text(json.dumps(tree))
    for uri, block in zip(uris, blocks, strict=True):
        if "/" not in uri and "%" not in uri:
            (path.parent / uri).write_bytes(block)


def lift(mesh, mask):
    return mesh.vertices + 1


def positions(path):
    """Read by means other than ours."""
    return np.asarray(trimesh.load_scene(path, process=False).to_mesh().vertices)


def test_buffers_of_other_models_are_not_replaced(folder):
    gltf(folder / "part1.gltf", ["part1.bin"], TRIANGLE * 3)
    gltf(folder / "part.gltf", ["part.bin", "part1.bin-"])
    other = (folder / "part1.bin").read_bytes()
    filter_mesh_file(lift, "part.gltf", "part.gltf", Options(overwrite=True))
    assert (folder / "part1.bin").read_bytes() == other
    np.testing.assert_allclose(positions("part1.gltf"), TRIANGLE * 3)
    np.testing.assert_allclose(positions("part.gltf"), TRIANGLE + 1)
    names = {"part.gltf", "part.bin", "part1.bin-", "part1.gltf", "part1.bin"}
    assert {path.name for path in folder.iterdir()} == names  # its own buffers kept their names


@pytest.mark.parametrize("order", [1, -1])
def test_buffers_of_a_batch_do_not_meet(folder, order):
    gltf(folder / "in/part.gltf", ["a.bin", "b.bin"])
    gltf(folder / "in/part1.gltf", ["a1.bin"], TRIANGLE * 3)
    (folder / "out").mkdir()
    for _ in range(2):  # the second time over what the first has written
        for name in ("part", "part1")[::order]:
            paths = f"in/{name}.gltf", f"out/{name}.gltf"
            filter_mesh_file(lift, *paths, Options(overwrite=True))
    np.testing.assert_allclose(positions("out/part.gltf"), TRIANGLE + 1)
    np.testing.assert_allclose(positions("out/part1.gltf"), TRIANGLE * 3 + 1)


@pytest.mark.parametrize("uri", ["a.bin", "./a.bin", "a%2Ebin", "sub\\\\a.bin"])
def test_models_that_share_a_buffer(folder, uri):
    gltf(folder / "in.gltf", ["a.bin"])
    tree = json.loads((folder / "in.gltf").read_text())
    tree["buffers"] *= 2
    tree["bufferViews"][1]["buffer"] = 1
    for buffer in tree["buffers"]:
        buffer["uri"] = uri
    (folder / "in.gltf").write_text(json.dumps(tree))
    data = (folder / "a.bin").read_bytes()
    (folder / "sub").mkdir()
    file = folder / ("sub/a.bin" if "sub" in uri else "a.bin")
    file.write_bytes(data + b"of another")
    for target in ("out.gltf", "in.gltf"):
        filter_mesh_file(lift, "in.gltf", target, Options(overwrite=True))
    assert file.read_bytes()[-22:] == data[-12:] + b"of another"
    assert (np.frombuffer(file.read_bytes(), "<f4", 12) == TRIANGLE.reshape(-1) + 1).all()
    np.testing.assert_allclose(positions("out.gltf"), TRIANGLE + 1)


OBJ = "mtllib {}\nusemtl paint\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\n"


def tree_of(name):
    data = Path(name).read_bytes()
    return json.loads(data[20 : 20 + struct.unpack_from("<I", data, 12)[0]])


def test_no_folder_of_the_user_gets_into_a_conversion(folder):
    (folder / "cube.obj").write_text(OBJ.format("none.mtl"))
    filter_mesh_file(lift, folder / "cube.obj", folder / "out.glb")
    assert str(folder).encode() not in Path("out.glb").read_bytes()
    tree = tree_of("out.glb")
    assert [tree[kind][0]["name"] for kind in ("meshes", "nodes")] == ["cube", "cube"]


def test_names_and_opacity_of_materials_survive_a_conversion(folder):
    (folder / "in.obj").write_text(OBJ.format("in.mtl") + "usemtl old paint\nf 1 2 4\n")
    (folder / "in.mtl").write_text("newmtl paint\nKd 1 0 0\nd 0.5\nnewmtl old paint\nKd 1 0 0\n")
    filter_mesh_file(lift, "in.obj", "out.glb")
    found = {material["name"]: material for material in tree_of("out.glb")["materials"]}
    assert sorted(found) == ["old paint", "paint"]
    alphas = [found[name]["pbrMetallicRoughness"]["baseColorFactor"][3] for name in sorted(found)]
    np.testing.assert_allclose(alphas, [1.0, 0.5], atol=0.01)
    assert found["paint"]["alphaMode"] == "BLEND" and "alphaMode" not in found["old paint"]


@pytest.mark.parametrize("names", ["one.mtl two.mtl", "two.mtl one.mtl", "one.mtl\nmtllib two.mtl"])
@pytest.mark.parametrize("target", ["out.obj", "out.glb"])
def test_all_material_files_of_a_line_count(folder, names, target):
    (folder / "in").mkdir()
    (folder / "in/in.obj").write_text(OBJ.format(names + " none.mtl") + "usemtl other\nf 1 2 4\n")
    Image.fromarray(picture()).save("in/tex.png")
    (folder / "in/one.mtl").write_text("newmtl paint\nKd 1 0 0\nmap_Kd tex.png\n")
    (folder / "in/two.mtl").write_text("newmtl other\nKd 0 1 0\n")
    (folder / "out").mkdir()
    outcome = filter_mesh_file(lift, "in/in.obj", f"out/{target}")
    assert [
        note
        for note in outcome.notes
        if "none.mtl" in note and "one.mtl" not in note.replace("none.mtl", "")
    ]
    if target == "out.obj":
        found = {path.name for path in (folder / "out").iterdir()}
        assert found == {"out.obj", "one.mtl", "two.mtl", "tex.png"}
    else:
        materials = tree_of("out/out.glb")["materials"]
        assert {material["name"] for material in materials} == {"paint", "other"}


def test_absolute_names_of_several_material_files_become_relative(folder):
    (folder / "in").mkdir()
    names = f"{folder}/in/one.mtl {folder}/in/two.mtl"
    (folder / "in/in.obj").write_text(OBJ.format(names))
    for name in ("one", "two"):
        (folder / f"in/{name}.mtl").write_text(f"newmtl {name}\n")
    filter_mesh_file(lift, "in/in.obj", "out.obj")
    assert (folder / "out.obj").read_text().startswith("mtllib one.mtl two.mtl\n")


@pytest.mark.parametrize("overwrite", [True, False])
def test_materials_of_others_are_not_replaced(folder, overwrite):
    (folder / "out").mkdir()
    for name in "ab":
        (folder / name).mkdir()
        (folder / name / f"{name}.obj").write_text(OBJ.format("material.mtl"))
        (folder / name / "material.mtl").write_text(f"newmtl paint\nKd 0 0 0 # {name}\n")
    filter_mesh_file(lift, "a/a.obj", "out/a.obj", Options(overwrite=overwrite))
    with pytest.raises(core.ShockError, match=r"material\.mtl exists already .* another folder"):
        filter_mesh_file(lift, "b/b.obj", "out/b.obj", Options(overwrite=overwrite))
    filter_mesh_file(lift, "a/a.obj", "out/a.obj", Options(overwrite=True))  # its own, the same
    assert {path.name for path in (folder / "out").iterdir()} == {"a.obj", "material.mtl"}
    assert (folder / "out/material.mtl").read_text().endswith("# a\n")


def test_a_side_file_named_as_the_output_does_not_replace_it(folder):
    (folder / "in.obj").write_text(OBJ.format("model.obj"))
    (folder / "model.obj").write_text("newmtl paint\nKd 1 0 0\n")
    (folder / "out").mkdir()
    outcome = filter_mesh_file(lift, "in.obj", "out/model.obj")
    assert "v 1 1 1" in (folder / "out/model.obj").read_text()
    assert any("model.obj" in note for note in outcome.notes)


def test_side_files_of_a_conversion_are_named_after_it(folder):
    box = trimesh.creation.box()
    uv = box.vertices[:, :2] + 0.5
    image = Image.fromarray(picture())
    material = trimesh.visual.material.PBRMaterial(name="paint", baseColorTexture=image)
    box.visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    box.export("in.glb")
    (folder / "out").mkdir()
    for name in ("a.obj", "b.obj", "a.obj"):
        filter_mesh_file(lift, "in.glb", f"out/{name}", Options(overwrite=True))
    names = sorted(path.name for path in (folder / "out").iterdir())
    assert names[:3] == ["a.obj", "a.obj.mtl", names[2]]
    assert all(name.startswith(("a.obj", "b.obj")) for name in names)
    for name in "ab":
        mesh = trimesh.load_mesh(f"out/{name}.obj", process=False)
        assert mesh.visual.material.image.size == image.size


@pytest.mark.parametrize("name", ["in.obj", "in.ply", "in.glb", "in.gltf", "in.stl", "in.off"])
@pytest.mark.parametrize("target", ["in", "out.obj", "out.ply", "out.glb", "out.stl", "out.off"])
def test_a_mesh_that_cannot_be_read_back_replaces_nothing(folder, name, target, monkeypatch):
    mesh = trimesh.Trimesh(TRIANGLE, CORNERS.reshape(-1, 3), process=False)
    if name == "in.gltf":
        trimesh.Scene(mesh).export(name, embed_buffers=True)
    else:
        mesh.export(name)
    target = Path(target).with_suffix(Path(target).suffix or Path(name).suffix)
    if target.name != name:
        target.write_text("old")
    before = target.read_bytes()
    for document in (GltfFile, ObjFile, PlyFile, SceneFile):

        def spoil(self, path, positions, moved, save=document.save):
            notes = save(self, path, positions, moved)
            path.write_bytes(path.read_bytes()[:-40])
            return notes

        monkeypatch.setattr(document, "save", spoil)
    with pytest.raises(core.ShockError, match=f"{target.name} was not written: .* read back"):
        filter_mesh_file(lift, name, target, Options(overwrite=True))
    assert target.read_bytes() == before
    assert {path.name for path in folder.iterdir()} == {name, target.name}


# ---------------------------------------------------------------------------- what a file refers to

OUTSIDE = ["../secret.bin", "%2e%2e/secret.bin", "a/../../secret.bin", "{folder}/secret.bin"]
OUTSIDE += ["file://{folder}/secret.bin", "/dev/zero", "pipe", "link.bin", "a\\..\\..\\secret.bin"]


@pytest.mark.skipif(sys.platform == "win32", reason="no pipes, no devices")
@pytest.mark.timeout(60)
@pytest.mark.parametrize("target", ["out.gltf", "out.obj"])
@pytest.mark.parametrize("uri", OUTSIDE)
def test_only_plain_files_below_the_model_are_read(folder, uri, target):
    size = TRIANGLE.nbytes + CORNERS.nbytes
    (folder / "secret.bin").write_bytes(TRIANGLE.tobytes() + CORNERS.tobytes())
    (folder / "in/a").mkdir(parents=True)
    os.mkfifo(folder / "in/pipe")
    (folder / "in/link.bin").symlink_to(folder / "secret.bin")
    gltf(folder / "in/in.gltf", ["model.bin"])
    uri = uri.format(folder=folder)
    tree = json.loads((folder / "in/in.gltf").read_text())
    tree["buffers"] = [{"uri": uri, "byteLength": size}]
    (folder / "in/in.gltf").write_text(json.dumps(tree))
    with pytest.raises(core.ShockError, match="not in the model's folder or below it; put it"):
        filter_mesh_file(lift, "in/in.gltf", target)
    assert not (folder / target).exists()


def test_buffers_that_are_shorter_than_claimed_are_named(folder):
    gltf(folder / "in.gltf", ["model.bin"])
    (folder / "model.bin").write_bytes(b"short")
    for target in ("out.gltf", "out.glb"):
        with pytest.raises(core.ShockError, match="shorter than the model says"):
            filter_mesh_file(lift, "in.gltf", target)


@pytest.mark.skipif(sys.platform == "win32", reason="no links, no pipes")
@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", ["../secret.mtl", "link.mtl", "pipe", "/dev/zero"])
@pytest.mark.parametrize("target", ["out.obj", "out.glb"])
def test_materials_from_elsewhere_are_left_behind(folder, name, target):
    (folder / "in").mkdir()
    os.mkfifo(folder / "in/pipe")
    (folder / "secret.mtl").write_text("newmtl paint\nKd 0.1 0.2 0.3\n")
    (folder / "in/link.mtl").symlink_to(folder / "secret.mtl")
    (folder / "in/in.obj").write_text(OBJ.format(name))
    outcome = filter_mesh_file(lift, "in/in.obj", target)
    assert any(name in note for note in outcome.notes)
    assert sorted(path.name for path in folder.iterdir()) == sorted(["in", "secret.mtl", target])


# ----------------------------------------------------------------------------- what a header claims


def bomb(name):
    """A small file whose header claims gigabytes; returns what they are."""
    if name.endswith(".bmp"):
        size = struct.pack("<IiiHHIIiiII", 40, 20, 536870936, 1, 24, 0, 0, 0, 0, 0, 0)
        Path(name).write_bytes(b"BM" + struct.pack("<IHHI", 1454, 0, 0, 54) + size + bytes(1400))
    elif name.endswith(".tif"):
        tifffile.imwrite(name, np.zeros((8, 20, 3), np.uint8), photometric="rgb", rowsperstrip=8)
        with tifffile.TiffFile(name, mode="r+b") as file:
            for tag in ("ImageLength", "RowsPerStrip"):
                file.pages[0].tags[tag].overwrite(67108888)
    elif name.endswith(".png"):
        write(name, picture())
        data = Path(name).read_bytes()
        header = chunk(b"IHDR", struct.pack(">II", 60000, 60000) + data[24:29])
        Path(name).write_bytes(data[:8] + header + data[33:])
    elif name.endswith(".exr"):
        write(name, picture(3, "float32"))
        data = Path(name).read_bytes()
        for window in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
            place = data.index(window) + len(window) + 4
            data = data[:place] + struct.pack("<4i", 0, 0, 59999, 59999) + data[place + 16 :]
        Path(name).write_bytes(data)
    else:
        gltf(Path(name), ["model.bin"])
        tree = json.loads(Path(name).read_text())
        accessor = {"componentType": 5126, "count": 500_000_000, "type": "VEC4"}
        tree["accessors"].append(accessor)
        tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"] = 2
        Path(name).write_text(json.dumps(tree))


def run_on(name, any_size):
    if name.endswith(".gltf"):
        return filter_mesh_file(lift, name, "out.obj", Options(any_size=any_size))
    ending = "exr" if name.endswith("exr") else "png"
    return sharpen_image_file(name, f"out.{ending}", STRONG, any_size=any_size)


@pytest.mark.timeout(30)
@pytest.mark.parametrize("name", ["in.bmp", "in.tif", "in.png", "in.exr", "in.gltf"])
def test_claims_that_a_file_cannot_hold_are_refused(name, monkeypatch):
    bomb(name)
    with pytest.raises(core.ShockError, match=r"claims to hold \d+\.\d GiB .* add --any-size"):
        run_on(name, any_size=False)
    monkeypatch.setattr(reading, "_FREE", 1)  # then nothing is small enough to be free
    monkeypatch.setattr(reading, "_RATIO", 0.01)
    write("small.png", picture())
    with pytest.raises(core.ShockError, match="claims to hold"):
        run_on("small.png", any_size=False)
    assert run_on("small.png", any_size=True).changed > 0


def test_flat_images_may_be_small_files(folder):
    Image.new("RGB", (8192, 8192)).save("in.webp", lossless=True)  # 200 MB in a few bytes
    assert Path("in.webp").stat().st_size < 10000
    assert filter_image_file(lambda pixels: pixels, "in.webp", "out.webp").changed == 0


def test_the_command_line_lifts_the_limit(monkeypatch, capsys):
    monkeypatch.setattr(reading, "_FREE", 1)
    monkeypatch.setattr(reading, "_RATIO", 0.01)
    write("in.png", picture())
    assert cli.main(["sharpen-image", "in.png", "out.png"]) == 1
    assert "add --any-size" in capsys.readouterr().err
    assert cli.main(["sharpen-image", "in.png", "out.png", "--any-size"]) == 0


def test_too_little_memory_is_not_called_damage(monkeypatch):
    write("in.png", picture())

    def run_short(path):
        raise MemoryError

    kind = images.FORMATS[".png"]._replace(read=run_short)
    monkeypatch.setitem(images.FORMATS, ".png", kind)
    with pytest.raises(core.ShockError, match=r"in\.png needs more memory than there is") as caught:
        sharpen_image_file("in.png", "out.png", STRONG)
    assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("strips", [[0], [0, 1, 2]])
def test_tiff_strips_without_data_are_not_read_as_black(strips):
    tifffile.imwrite("in.tif", picture(), photometric="rgb", rowsperstrip=8)
    with tifffile.TiffFile("in.tif", mode="r+b") as file:
        tag = file.pages[0].tags["StripByteCounts"]
        tag.overwrite([0 if k in strips else n for k, n in enumerate(tag.value)])
    with pytest.raises(core.ShockError, match="parts without data; fill them"):
        sharpen_image_file("in.tif", "out.tif", STRONG)


@pytest.mark.parametrize("pixels", [np.zeros((4, 5, 2000), np.uint8), np.zeros((4, 5, 2), "f2")])
def test_what_few_formats_hold_is_answered_with_those(pixels):
    np.save("in.npy", pixels)
    with pytest.raises(core.ShockError, match=r"write one of .*\.npy\."):
        sharpen_image_file("in.npy", "out.png", STRONG)


def test_archives_of_arrays_are_named():
    np.savez("in", pixels=picture())
    Path("in.npz").rename("in.npy")
    with pytest.raises(core.ShockError, match=r"in\.npy is an archive of arrays"):
        sharpen_image_file("in.npy", "out.npy", STRONG)


# ------------------------------------------------------------------------------ letters and numbers

TETRAHEDRON = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 3 4\nf 1 4 2\nf 2 4 3\n"
LETTERS = "Größe ©".encode("latin-1")


def lettered(name):
    """A mesh file with letters that are not UTF-8, where its format has room for words."""
    shape = trimesh.Trimesh(TRIANGLE, CORNERS.reshape(-1, 3), process=False)
    if name == "in.obj":
        Path(name).write_bytes(b"# " + LETTERS + b"\no " + LETTERS + b"\n" + TETRAHEDRON.encode())
    elif name == "in.stl":
        data = shape.export(file_type="stl_ascii").encode()
        Path(name).write_bytes(data.replace(b"solid ", b"solid " + LETTERS))
    elif name == "in.off":
        data = shape.export(file_type="off").encode()
        Path(name).write_bytes(data.replace(b"OFF\n", b"OFF\n# " + LETTERS + b"\n"))
    else:
        data = shape.export(file_type="ply")
        header = b"ply\n", b"comment " + LETTERS + b"\n"
        encoding, _, rest = data.removeprefix(b"ply\n").partition(b"\n")
        Path(name).write_bytes(header[0] + encoding + b"\n" + header[1] + rest)


@pytest.mark.parametrize("target", ["out.obj", "out.ply", "out.stl", "out.off", "out.glb"])
@pytest.mark.parametrize("name", ["in.obj", "in.stl", "in.off", "in.ply"])
def test_letters_that_are_not_utf8(name, target, monkeypatch):
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    lettered(name)
    filter_mesh_file(lift, name, target)
    mesh = load_scene(Path(target))[0].to_mesh()
    assert abs(mesh.volume) == pytest.approx(1 / 6, rel=1e-6)


def test_a_cut_stl_is_called_damaged(monkeypatch):
    monkeypatch.setitem(sys.modules, "charset_normalizer", None)
    trimesh.creation.icosphere().export("in.stl")
    data = Path("in.stl").read_bytes()
    for cut in (data[:-30], data[:700], b"\xff" * 90):
        Path("in.stl").write_bytes(cut)
        for target in ("out.stl", "out.obj"):
            with pytest.raises(core.ShockError, match=r"in\.stl cannot be read; is it damaged"):
                filter_mesh_file(lift, "in.stl", target)


def test_packages_that_readers_miss_are_named(monkeypatch):
    lettered("in.off")

    def miss(*_, **__):
        raise ModuleNotFoundError("No module named 'special'", name="special")

    monkeypatch.setattr(trimesh, "load_scene", miss)
    with pytest.raises(core.ShockError, match="needs special; run: pip install special"):
        filter_mesh_file(lift, "in.off", "out.off")


@pytest.mark.parametrize("target", ["out.obj", "out.ply"])
def test_a_byte_order_mark_does_not_hide_the_first_vertex(target):
    Path("in.obj").write_bytes(b"\xef\xbb\xbf" + TETRAHEDRON.encode())
    outcome = filter_mesh_file(lift, "in.obj", target)
    assert outcome.total == 4
    assert Path(target).read_bytes().startswith((b"\xef\xbb\xbfv 1 1 1", b"ply"))
    mesh = load_scene(Path(target))[0].to_mesh()
    np.testing.assert_allclose(mesh.bounds, [[1] * 3, [2] * 3])


def text_ply(numbers):
    header = "ply\nformat ascii 1.0\nelement vertex 4\n"
    header += "".join(f"property double {axis}\n" for axis in "xyz")
    header += "element face 4\nproperty list uchar int vertex_indices\nend_header\n"
    rows = [*numbers, "3 0 1 2", "3 0 2 3", "3 0 3 1", "3 1 3 2"]
    return header + "\n".join(rows) + "\n"


def test_long_numbers_of_a_text_ply_are_read_whole():
    long = f"1{'0' * 45}e-45"
    Path("in.ply").write_text(text_ply(["0 0 0", f"{long} 0 0", "0 1 0", "0 0 1"]))
    seen = []

    def look(mesh, mask):
        seen.append(mesh.vertices)
        return mesh.vertices

    filter_mesh_file(look, "in.ply", "out.ply")
    assert seen[0][1, 0] == 1.0


def test_a_text_ply_that_is_cut_is_named():
    Path("in.ply").write_text(text_ply(["0 0 0", "1 0 0", "0 1 0", "0 0 1"])[:-16])
    with pytest.raises(core.ShockError, match="fewer lines than its header says"):
        filter_mesh_file(lift, "in.ply", "out.ply")
    assert "of 4 polygons, 2 could be read" in filter_mesh_file(lift, "in.ply", "out.obj").notes


@pytest.mark.parametrize("target", ["out.glb", "out.stl", "out.ply", "in.glb", "in.ply"])
def test_positions_beyond_32_bits_are_refused(target):
    large = trimesh.Trimesh(TRIANGLE * np.float32(3e38), CORNERS.reshape(-1, 3), process=False)
    name = target if target.startswith("in.") else "in.obj"
    large.export(name)
    before = Path(name).read_bytes()

    def double(mesh, mask):
        return mesh.vertices * 2

    with pytest.raises(core.InvalidMesh, match="do not fit into this format; scale the mesh down"):
        filter_mesh_file(double, name, target, Options(overwrite=True))
    assert Path(name).read_bytes() == before


def with_draco(path):
    """A model whose primitive stands there compressed, too, for readers that know how."""
    gltf(path, ["model.bin"])
    tree = json.loads(path.read_text())
    draco = {"bufferView": 0, "attributes": {"POSITION": 0}}
    tree["meshes"][0]["primitives"][0]["extensions"] = {"KHR_draco_mesh_compression": draco}
    tree["extensionsUsed"] = ["KHR_draco_mesh_compression"]
    path.write_text(json.dumps(tree))


def test_a_compressed_copy_of_what_changed_is_dropped(folder):
    with_draco(folder / "in.gltf")
    outcome = filter_mesh_file(lift, "in.gltf", "out.gltf")
    assert "its compressed copy (Draco) was left behind" in outcome.notes
    assert "draco" not in (folder / "out.gltf").read_text()
    assert "extensionsUsed" not in (folder / "out.gltf").read_text()
    outcome = filter_mesh_file(lambda mesh, mask: mesh.vertices, "in.gltf", "same.gltf")
    assert "draco" in (folder / "same.gltf").read_text()


@pytest.mark.parametrize("target", ["out.gltf", "out.glb", "out.obj"])
def test_accessors_of_no_entries_do_not_stop_the_others(folder, target):
    gltf(folder / "in.gltf", ["model.bin"])
    tree = json.loads((folder / "in.gltf").read_text())
    tree["accessors"].append(tree["accessors"][0] | {"count": 0})
    tree["meshes"][0]["primitives"].append({"attributes": {"POSITION": 2}})
    (folder / "in.gltf").write_text(json.dumps(tree))
    assert filter_mesh_file(lift, "in.gltf", target).changed == 4


@pytest.mark.parametrize("target", ["out.glb", "out.gltf"])
@pytest.mark.parametrize("uris", [["a.bin"], ["a.bin", "b.bin"]])
def test_glb_and_gltf_become_each_other_without_loss(folder, target, uris):
    gltf(folder / "in.gltf", uris, animations=[{"name": "spin", "channels": [], "samplers": []}])
    filter_mesh_file(lift, "in.gltf", "once.glb")
    outcome = filter_mesh_file(lift, "once.glb", target, Options(overwrite=True))
    assert outcome.notes == ()
    np.testing.assert_allclose(positions(target), TRIANGLE + 2)
    assert b'"spin"' in (folder / target).read_bytes()
