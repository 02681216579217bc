# SPDX-License-Identifier: GPL-3.0-or-later
"""Damaged mesh and image files: filtered, or refused with one of Shock Filter's own errors."""

import base64
import json
import re
import tempfile
import warnings
from pathlib import Path

import numpy as np
import OpenEXR
import tifffile
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from on_files import sharpen_colors_file, sharpen_file, sharpen_image_file, sharpen_texture_file
from PIL import Image
from shapes import cube
from shock_filter import core
from shock_filter.core.files.formats.mesh.trimesh import SceneFile
from shock_filter.core.files.images import write_image_file
from shock_filter.core.files.meshes import read_document
from strategies import examples

WORDS = [
    b"", b"0", b"-1", b"2", b"7", b"4000000000", b"1e39", b"1e400", b"nan", b"-inf", b"x", b"1/1",
    b"1/2/3", b"-1//-1", b"\xff\xfe", b"\\", b"#", b"null", b"[]", b"{}", b'""', b"\n", b"\r",
]  # fmt: skip
FOREIGN = [
    b"<!DOCTYPE html><html><body>Not found</body></html>", b'<?xpacket end="w"?>', b"\0" * 40,
    "Größe ©\n".encode("latin-1"), "# 寸法\n".encode(), b"2026-01-01 12:00:00 done: closed\n",
]  # fmt: skip
CLAIMS = [b"\xff\xff\xff\x7f", b"\x7f\xff\xff\xff", b"\x00\x00\x00\x04", b"\x04\x00\x00\x00"]
NUMBERS = [b"\x00" * 4, b"\xff" * 4, b"\x7f\xff\xff\xff", b"\x00\x00\xc0\x7f", b"\x00\x00\x80\x7f"]


def mesh_samples(folder):
    """One small file of each mesh format, some with colors, normals and texture coordinates."""
    vertices, faces = cube(2)
    shape = trimesh.Trimesh(vertices, faces, process=False)
    uv = vertices[:, :2] + 0.1 * vertices[:, 2:]
    lines = [f"v {x} {y} {z} {abs(x)} {abs(y)} 0.5" for x, y, z in vertices]
    lines += [f"vt {u} {v}" for u, v in uv]
    lines += [f"vn {x} {y} {z}" for x, y, z in shape.vertex_normals]
    lines += ["o Box", "usemtl Paint"]
    lines += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in faces + 1]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")
    colors = (255 * abs(vertices)).astype(np.uint8)
    shape.visual = trimesh.visual.ColorVisuals(shape, vertex_colors=colors)
    shape.export(folder / "text.ply", encoding="ascii", vertex_normal=True)
    for name in ("box.ply", "box.glb", "box.stl", "box.off"):
        shape.export(folder / name)
    shape.visual = trimesh.visual.TextureVisuals(uv=uv)
    shape.export(folder / "uv.glb")
    trimesh.Scene(shape).export(folder / "box.gltf", embed_buffers=True)


def image_samples(folder):
    """One small file of each image format."""
    rng = np.random.default_rng(0)
    deep = rng.integers(0, 2**16, (6, 5, 3), dtype=np.uint16)
    floats = rng.random((6, 5, 4), np.float32)
    for name, pixels in {
        "gray.png": (deep[..., 0] >> 8).astype(np.uint8),
        "deep.png": deep,
        "flat.tif": (deep >> 8).astype(np.uint8),
        "float.tif": floats,
        "float.exr": floats,
        "flat.bmp": (deep >> 8).astype(np.uint8),
        "flat.jpg": (deep >> 8).astype(np.uint8),
        "flat.webp": (deep >> 8).astype(np.uint8),
        "array.npy": floats,
    }.items():
        write_image_file(folder / name, pixels, overwrite=False)


def contents(make):
    with tempfile.TemporaryDirectory() as folder:
        make(Path(folder))
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


MESHES, IMAGES = contents(mesh_samples), contents(image_samples)
IMAGE_ENDINGS = {Path(name).suffix for name in IMAGES}


@st.composite
def damaged(draw, data):
    """Spoil the bytes of a file in up to three places, and put others behind its end."""
    if draw(st.booleans()):
        data += draw(st.sampled_from(FOREIGN)) * draw(st.integers(1, 4))
    for _ in range(draw(st.integers(0, 3))):
        place = draw(st.integers(0, len(data)))
        length = draw(st.sampled_from([1, 1, 2, 4, 16, 200]))
        piece = data[place : place + length]
        ways = ["byte", "number", "word", "word", "cut", "drop", "repeat", "foreign", "claim"]
        how = draw(st.sampled_from(ways))
        if how == "byte":
            data = data[:place] + bytes([draw(st.integers(0, 255))]) + data[place + 1 :]
        elif how == "number":
            data = data[:place] + draw(st.sampled_from(NUMBERS)) + data[place + 4 :]
        elif how == "word":  # put where one begins
            start = max(data.rfind(end, 0, place) for end in b" \n/,:[") + 1
            stop = re.compile(rb"[ \n/,:\]}]|\Z").search(data, start).start()
            data = data[:start] + draw(st.sampled_from(WORDS)) + data[stop:]
        elif how == "foreign":
            data = data[:place] + draw(st.sampled_from(FOREIGN)) + data[place:]
        elif how == "claim":  # among the numbers of the header
            place = draw(st.integers(0, min(len(data), 120)))
            data = data[:place] + draw(st.sampled_from(CLAIMS)) + data[place + 4 :]
        elif how == "cut":
            data = data[:place]
        elif how == "drop":
            data = data[:place] + data[place + length :]
        else:
            data = data[:place] + 2 * piece + data[place + length :]
    return data


def readable(path):
    """Read a file by means other than ours; raises if that fails."""
    ending = path.suffix
    if ending == ".npy":
        np.load(path)
    elif ending == ".tif":
        tifffile.imread(path)
    elif ending == ".exr":
        with OpenEXR.File(str(path)) as file:
            assert file.channels()
    elif ending in (".png", ".jpg", ".webp", ".bmp"):
        with Image.open(path) as image:
            image.load()
    else:
        assert read_document(path, SceneFile).faces.size


def is_readable(path):
    """Whether others, too, can read a mesh: damage in what our readers only copy stays."""
    try:
        readable(path)
    except (core.ShockError, OSError):
        return False
    return True


def contents_of(folder):
    return {path: path.read_bytes() for path in Path(folder).rglob("*") if path.is_file()}


def run(name, data, target, function, beside=()):
    """Write the bytes and filter the file; what fails must say so and write nothing.

    What is written can be read by others, and no file but the target is other than it was.
    """
    with tempfile.TemporaryDirectory() as folder:
        source, target = Path(folder, name), Path(folder, target)
        for other, text in dict(beside).items():
            Path(folder, other).parent.mkdir(exist_ok=True)
            Path(folder, other).write_bytes(text)
        source.write_bytes(data)
        before = contents_of(folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # those of the libraries that read the files
            expected = source.suffix in IMAGE_ENDINGS or is_readable(source)
            try:
                outcome = function(source, target)
            except (core.ShockError, OSError):
                assert contents_of(folder) == before
                return
            assert 0 <= outcome.changed <= outcome.total
            after = contents_of(folder)
            assert {path: after[path] for path in before if path != target} == {
                path: text for path, text in before.items() if path != target
            }
            if outcome.changed and expected:  # else it is as good, or as bad, as the source
                readable(target)


@examples(120)
@given(st.data())
def test_mesh_files(data):
    name = data.draw(st.sampled_from(list(MESHES)))
    ending = data.draw(st.sampled_from([Path(name).suffix] * 3 + [".ply", ".obj", ".glb"]))
    function = data.draw(st.sampled_from([sharpen_file, sharpen_file, sharpen_colors_file]))
    run(name, data.draw(damaged(MESHES[name])), f"out{ending}", function)


@examples(60)
@given(st.data())
def test_textured_mesh_files(data):
    name = data.draw(st.sampled_from(list(MESHES)))
    with tempfile.TemporaryDirectory() as folder:
        image = Path(folder, "image.png")
        image.write_bytes(IMAGES["deep.png"])
        run(name, data.draw(damaged(MESHES[name])), "out.png",
            lambda mesh, target: sharpen_texture_file(mesh, image, target))  # fmt: skip


NAMES = [
    "in.mtl", "a.png", "b.bin", "../outside", "%2e%2e/outside", "/dev/zero", "sub/a.png", "",
    "out.obj", "out.gltf", "in.gltf", "in.obj", ".", "a\\b", "http://x/y.png", "x" * 300,
]  # fmt: skip


@examples(60)
@given(st.data())
def test_side_files(data):
    """Files that name others: these are read where they may be, and none is replaced."""
    draw = data.draw
    names = [draw(st.sampled_from(NAMES)) for _ in range(4)]
    library = f"newmtl Paint\nmap_Kd {names[1]}\nmap_Bump {names[2]}\n".encode()
    beside = {"in.mtl": library, "a.png": IMAGES["gray.png"], "sub/a.png": b"none"}
    beside |= {"out.gltf.0.bin-": b"foreign", "out.mtl": b"foreign", "out.bin": b"foreign"}
    if draw(st.booleans()):
        text = f"mtllib {names[0]}\nusemtl Paint\n".encode() + MESHES["box.obj"]
        run("in.obj", text, draw(st.sampled_from(["out.obj", "out.glb"])), sharpen_file, beside)
        return
    tree = json.loads(MESHES["box.gltf"])
    size = tree["buffers"][0]["byteLength"] + draw(st.sampled_from([0, 0, -9, 9, 1 << 40]))
    buffer = base64.b64decode(tree["buffers"][0]["uri"].partition(",")[2])
    beside["b.bin"] = buffer
    tree["buffers"] = [{"uri": draw(st.sampled_from(["b.bin", names[0]])), "byteLength": size}]
    tree["images"] = [{"uri": names[1]}]
    target = draw(st.sampled_from(["out.gltf", "out.glb", "out.obj", "in.gltf"]))

    def function(source, target):
        return sharpen_file(source, target, overwrite=True)

    if target == "in.gltf":
        beside.pop("b.bin")  # its own, which may change
        tree["buffers"][0]["uri"] = names[0]
    run("in.gltf", json.dumps(tree).encode(), target, function, beside)


@examples(120)
@given(st.data())
def test_image_files(data):
    name = data.draw(st.sampled_from(list(IMAGES)))
    ending = data.draw(st.sampled_from([Path(name).suffix] * 3 + [".png", ".tif", ".exr"]))
    run(name, data.draw(damaged(IMAGES[name])), f"out{ending}", sharpen_image_file)
