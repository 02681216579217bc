# SPDX-License-Identifier: GPL-3.0-or-later
"""What a file holds arrives in the copy, or the note names it: for every pair of formats."""

import json
import struct
import zlib
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
import tifffile
import trimesh
from on_files import sharpen_image_file
from PIL import Image
from shock_filter import core
from shock_filter.core.files.meshes import filter_mesh_file
from test_files import ply_bytes
from test_image_files import PROFILE, picture

STRONG = core.ImageSettings(time=64)
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/">a packet</x:xmpmeta>'


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


# ------------------------------------------------------------------------------------------ images


def exif():
    tags = Image.Exif()
    tags[0x010F] = "a maker"
    return tags.tobytes()


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(name, dtype="uint8"):
    Image.fromarray(picture()).save(name, icc_profile=PROFILE, dpi=(72, 72), exif=exif())
    more = [
        chunk(b"tEXt", b"Title\0a title"),
        chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + XMP),
        chunk(b"gAMA", struct.pack(">I", 45455)),
        chunk(b"bKGD", bytes(6)),
    ]
    data = Path(name).read_bytes()
    Path(name).write_bytes(data[:33] + b"".join(more) + data[33:])


IPTC = b"8BIM\x04\x04\0\0\0\0\0\x10\x1c\x02\x78\0\x09a caption\0\0"


def jpeg(name):
    block = b"Photoshop 3.0\0" + IPTC
    extra = b"\xff\xed" + struct.pack(">H", len(block) + 2) + block
    extra += b"\xff\xeb" + struct.pack(">H", 12) + b"JP\0\1signed"
    words = {"icc_profile": PROFILE, "dpi": (72, 72), "exif": exif(), "xmp": XMP}
    Image.fromarray(picture()).save(name, comment=b"a comment", extra=extra, **words)


def tiff(name):
    tifffile.imwrite(
        name,
        picture(),
        photometric="rgb",
        description="Höhe ©".encode(),
        software="Kamera ö".encode(),
        iccprofile=PROFILE,
        resolution=(72, 72),
        resolutionunit="INCH",
        extratags=[
            (33432, 2, None, "© me".encode("latin-1"), True),
            (33550, 12, 3, (1.0, 2.0, 0.0), True),
            (700, 1, len(XMP), XMP, True),
            (37724, 7, 10, b"old layers", True),
        ],
    )


def webp(name):
    words = {"icc_profile": PROFILE, "exif": exif(), "xmp": XMP}
    Image.fromarray(picture()).save(name, lossless=True, **words)


def bmp(name):
    Image.fromarray(picture()).save(name, dpi=(72, 72))
    data = bytearray(Path(name).read_bytes())
    header = struct.pack("<I", 124) + data[18:54] + bytes(16) + b"DEBM" + bytes(64)
    struct.pack_into("<I", data, 10, 14 + len(header))
    Path(name).write_bytes(bytes(data[:14]) + header + bytes(data[54:]))


def exr(name):
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    header |= {"comments": "a remark"}
    OpenEXR.File(header, {"RGB": picture(3, "float32"), "Z": picture(1, "float32")}).write(name)


IMAGES = {".png": png, ".jpg": jpeg, ".tif": tiff, ".webp": webp, ".bmp": bmp, ".exr": exr}
IMAGE_ITEMS = {
    ".png": ["ICC", "resolution", "EXIF", "XMP", "tEXt", "gAMA", "bKGD"],
    ".jpg": ["ICC", "resolution", "EXIF", "XMP", "comment", "IPTC", "APP11"],
    ".tif": ["ICC", "resolution", "XMP", "ImageDescription", "Software", "Copyright",
             "ModelPixelScaleTag", "layers"],
    ".webp": ["ICC", "EXIF", "XMP"],
    ".bmp": ["resolution", "color profile"],
    ".exr": ["comments", "channels (Z)"],
}  # fmt: skip
CARRIED = {
    "tEXt": b"a title",
    "gAMA": b"gAMA",
    "comment": b"a comment",
    "IPTC": b"a caption",
    "APP11": b"signed",
    "ImageDescription": "Höhe ©".encode(),
    "Software": "Kamera ö".encode(),
    "Copyright": "© me".encode("latin-1"),
    "ModelPixelScaleTag": struct.pack("<3d", 1.0, 2.0, 0.0),
    "comments": b"a remark",
    "channels (Z)": b"Z\0",
    "EXIF": b"a maker",
    "XMP": b"a packet",
    "layers": b"old layers",
    "bKGD": b"bKGD",
}
"""What stands in a file that keeps an item."""


def arrives(item, target):
    if item in CARRIED:
        return CARRIED[item] in Path(target).read_bytes()
    if target.endswith(".tif"):
        with tifffile.TiffFile(target) as file:
            page = file.pages[0]
            return (
                page.iccprofile == PROFILE
                if item == "ICC"
                else np.allclose(page.resolution, 72, atol=0.1)
            )
    if not target.endswith((".png", ".jpg", ".webp", ".bmp")):
        return False
    with Image.open(target) as image:
        if item == "ICC":
            return image.info.get("icc_profile") == PROFILE
        return np.allclose(image.info.get("dpi", 0), 72, atol=0.1) and item == "resolution"


@pytest.mark.parametrize("target", [*IMAGES, ".npy"])
@pytest.mark.parametrize("source", IMAGES)
def test_images(source, target):
    if (source == ".exr") != (target == ".exr") and target != ".npy":
        source_of = (".exr", ".tif")
        if source != ".exr" or target not in source_of:
            return  # of other values
    IMAGES[source]("in" + source)
    outcome = sharpen_image_file("in" + source, "out" + target, STRONG)
    note = "; ".join(outcome.notes)
    lost = [name for name in IMAGE_ITEMS[source] if not arrives(name, "out" + target)]
    assert [name for name in lost if name not in note] == []
    assert {"bKGD", "layers"} & set(IMAGE_ITEMS[source]) <= set(lost)  # of the old pixels
    if source == target:
        assert set(lost) <= {"bKGD", "layers", "APP11", "color profile"}


def test_both_descriptions_of_a_tiff_are_kept():
    tifffile.imwrite("in.tif", picture(), photometric="rgb", description="mine")  # and its own
    sharpen_image_file("in.tif", "out.tif", STRONG)
    for name in ("in.tif", "out.tif"):
        with tifffile.TiffFile(name) as file:
            found = [tag.value for tag in file.pages[0].tags.values() if tag.code == 270]
        assert found == ["mine", '{"shape": [24, 30, 3]}'], name


@pytest.mark.parametrize("tag", [269, 270, 271, 272, 285, 305, 306, 315, 316, 337, 33432, 42112])
@pytest.mark.parametrize("coding", ["utf-8", "latin-1"])
def test_texts_of_a_tiff_may_hold_any_letters(tag, coding):
    text = "© Höhe".encode(coding)
    extra = [(tag, 2, None, text, True)]
    words = {"photometric": "rgb", "metadata": None, "software": False}
    tifffile.imwrite("in.tif", picture(), extratags=extra, **words)
    assert sharpen_image_file("in.tif", "out.tif", STRONG).notes == ()
    assert text + b"\0" in Path("out.tif").read_bytes()


# ------------------------------------------------------------------------------------------ meshes

BOX = trimesh.creation.box()
UV = BOX.vertices[:, :2] + 0.5


def obj(name):
    rows = ["# a remark", "mtllib in.mtl", "vp 0.1 0.2", "o Body", "g a_group"]
    rows += ["v {} {} {} 0.5 0.25 1".format(*v) for v in BOX.vertices]
    rows += ["vt {} {}".format(*v) for v in UV]
    rows += ["vn {} {} {}".format(*v) for v in BOX.vertex_normals]
    rows += ["usemtl paint", "s 1"]
    rows += [f"f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}" for a, b, c in BOX.faces + 1]
    Path(name).write_text("\n".join([*rows, "l 1 2", "p 3"]) + "\n")
    Image.fromarray(picture()).save("color.png")
    Image.fromarray(picture()).save("bump.png")
    Path("in.mtl").write_text("newmtl paint\nKd 1 0 0\nmap_Kd color.png\nmap_Bump bump.png\n")


def ply(name):
    rows = len(BOX.vertices)
    table = [(n, "float", "f4", BOX.vertex_normals[:, k]) for k, n in enumerate(("nx", "ny", "nz"))]
    table += [(n, "uchar", "u1", np.full(rows, 99)) for n in ("red", "green", "blue")]
    table += [(n, "float", "f4", UV[:, k]) for k, n in enumerate("st")]
    table += [("quality", "float", "f4", np.ones(rows))]
    data = ply_bytes(BOX.vertices, BOX.faces, table)
    edges = b"element edge 1\nproperty int vertex1\nproperty int vertex2\nend_header"
    Path(name).write_bytes(data.replace(b"end_header", edges) + struct.pack("<2i", 0, 1))


def stl(name):
    data = bytearray(BOX.export(file_type="stl"))
    data[:80] = b"a header".ljust(80)
    data[132:134] = b"\x1f\x80"
    Path(name).write_bytes(data)


def text_stl(name):
    Path(name).write_text("solid Body\n" + BOX.export(file_type="stl_ascii").partition("\n")[2])


def off(name):
    text = BOX.export(file_type="off")
    Path(name).write_text(text.replace("OFF\n", "OFF\n# a remark\n"))


def glb(name):
    mesh = BOX.copy()
    image = Image.fromarray(picture())
    material = trimesh.visual.material.PBRMaterial(
        name="paint", baseColorTexture=image, normalTexture=image
    )
    mesh.visual = trimesh.visual.TextureVisuals(uv=UV, material=material)
    data = trimesh.Scene({"Body": mesh}).export(file_type="glb", include_normals=True)
    length = struct.unpack_from("<I", data, 12)[0]
    tree, rest = json.loads(data[20 : 20 + length]), data[20 + length :]
    attributes = tree["meshes"][0]["primitives"][0]["attributes"]
    attributes |= {"TEXCOORD_1": attributes["TEXCOORD_0"], "_WEIGHT": attributes["NORMAL"]}
    attributes["COLOR_0"] = attributes["POSITION"]
    tree["meshes"][0]["primitives"] += [{"mode": 0, "attributes": {"POSITION": 1}}]
    tree["meshes"][0]["primitives"][0]["targets"] = [{"POSITION": attributes["NORMAL"]}]
    tree |= {
        "animations": [{"name": "a_spin", "channels": [], "samplers": []}],
        "skins": [{"name": "a_skin", "joints": [0]}],
        "cameras": [{"name": "a_camera", "type": "perspective"}],
        "extras": {"note": "an_extra"},
        "extensions": {"KHR_lights_punctual": {"lights": [{"name": "a_light"}]}, "EXT_own": {}},
        "extensionsUsed": ["KHR_lights_punctual", "EXT_own"],
    }
    tree["asset"]["copyright"] = "me_alone"
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    own = struct.pack("<I4s", 8, b"OWNP") + b"a_secret"
    size = 20 + len(text) + len(rest) + len(own)
    head = struct.pack("<4sIIII", b"glTF", 2, size, len(text), 0x4E4F534A)
    Path(name).write_bytes(head + text + rest + own)


def text_gltf(name):
    glb("once.glb")
    filter_mesh_file(lambda mesh, mask: mesh.vertices, "once.glb", name)


MESHES = {"in.obj": obj, "in.ply": ply, "in.stl": stl, "text.stl": text_stl, "in.off": off}
MESHES |= {"in.glb": glb, "in.gltf": text_gltf}
OF_GLTF = {
    "animations": b"a_spin", "skins": b"a_skin", "cameras": b"a_camera", "lights": b"a_light",
    "extras": b"an_extra", "copyright": b"me_alone", "morph targets": b"targets",
    "TEXCOORD_1": b"TEXCOORD_1", "_WEIGHT": b"_WEIGHT", "EXT_own": b"EXT_own",
    "lines and points": b'"mode":0', "UVs": b"TEXCOORD_0", "colors": b"COLOR_0",
    "normals": b"NORMAL", "materials": b'"materials"', "object names": b"Body",
    "textures of more than color": b"normalTexture",
}  # fmt: skip
OF_OBJ = {
    "comments": b"# a remark", "groups": b"g a_group", "curves and surfaces": b"vp ",
    "smoothing groups": b"s 1", "lines and points": b"\nl 1", "UVs": b"vt ", "normals": b"vn ",
    "materials": b"newmtl paint", "object names": b"o Body", "colors": b"0.5 0.25 1",
    "textures of more than color": b"map_Bump",
}  # fmt: skip
OF_PLY = {
    "comments": b"comment a scan", "quality": b"quality", "(edge)": b"edge", "normals": b"nx",
    "UVs": b"float s", "colors": b"red",
}  # fmt: skip
MESH_ITEMS = {
    "in.obj": OF_OBJ, "in.ply": OF_PLY, "in.off": {"comments": b"# a remark"},
    "in.stl": {"the header's text": b"a header", "colors": b"\x1f\x80"},
    "text.stl": {"object names": b"solid Body"}, "in.gltf": OF_GLTF,
    "in.glb": OF_GLTF | {"OWNP": b"a_secret"},
}  # fmt: skip
SPELT = {
    ".obj": {"UVs": b"vt ", "materials": b"newmtl paint", "normals": b"vn "},
    ".ply": {"UVs": b" s\nproperty", "colors": b"red", "normals": b"nx"},
}
"""How formats spell what others have, too."""


@pytest.mark.parametrize("target", [".obj", ".ply", ".stl", ".off", ".glb", ".gltf"])
@pytest.mark.parametrize("source", MESHES)
def test_meshes(folder, source, target):
    (folder / "out").mkdir()
    MESHES[source](source)
    outcome = filter_mesh_file(lambda mesh, mask: mesh.vertices * 1.5, source, f"out/out{target}")
    note = "; ".join(outcome.notes)
    data = b"".join(path.read_bytes() for path in sorted((folder / "out").iterdir()))
    spelt = MESH_ITEMS[source]
    converted = Path(source).suffix != target and not ("gl" in source and "gl" in target)
    if converted:
        spelt = {**spelt, **SPELT.get(target, {}), **(OF_GLTF if "gl" in target else {})}
    lost = {item for item in MESH_ITEMS[source] if spelt[item] not in data}
    if converted and target in (".obj", ".glb", ".gltf") and "colors" in MESH_ITEMS[source]:
        mesh = trimesh.load_scene(f"out/out{target}", process=False).to_mesh()
        lost |= {"colors"} if not has_colors(mesh) else set()
    assert sorted(item for item in lost if item.strip("()") not in note) == []
    if not converted and target not in (".stl", ".off"):
        assert lost <= {"OWNP"}


def has_colors(mesh):
    return mesh.visual.kind == "vertex" or "color" in mesh.vertex_attributes
